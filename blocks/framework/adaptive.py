"""Adaptive and stiff integration between instants, by SciPy."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.types import Vector

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

METHODS = ("RK45", "DOP853", "LSODA", "BDF", "Radau")
"""Explicit: RK45, DOP853. Stiff: BDF, Radau. Switching: LSODA."""

IMPLICIT = ("BDF", "Radau")
"""Given the exact Jacobian; LSODA asks for it so often that its own differences, by the compiled
derivative, are several times cheaper."""

Function = Callable[[float, Vector], Vector]


class AdaptiveError(ArithmeticError):
    """The solver gave up; carries the last good time and state."""

    def __init__(self, reason: str, t: float, x: Vector) -> None:
        super().__init__(reason)
        self.t, self.x = t, x


def integrate(
    method: str,
    derivative: Function,
    jacobian: Function | None,
    span: tuple[float, float],
    times: Iterator[float],
    x: Vector,
    tolerances: tuple[float, float],
) -> Iterator[tuple[float, Vector]]:
    """Integrate over a span; the solver starts afresh.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    derivative, jacobian : callable
        dx/dt and its exact derivative by x, as functions of (t, x).
    span : tuple of float
        Initial and final time [s].
    times : iterator of float
        Increasing times inside the span [s].
    x : Vector
        Initial state.
    tolerances : tuple of float
        Relative and absolute tolerance [-, unit of the state].

    Yields
    ------
    float, Vector
        Each of the `times`, as soon as it is reached, and the state then; last the end.

    Raises
    ------
    AdaptiveError
        If the solver gives up or the state stops being finite.
    """
    start, end = span
    if not x.size:
        yield from ((t, x) for t in times)
        yield end, x
        return
    if not np.isfinite(derivative(start, x)).all():
        raise AdaptiveError("no step can be taken", start, x)
    options = {"jac": jacobian} if method in IMPLICIT and jacobian is not None else {}
    from scipy import integrate as solvers  # takes a third of a second

    solver = getattr(solvers, method)(
        derivative, start, x.copy(), end, rtol=tolerances[0], atol=tolerances[1], **options
    )
    wanted = next(times, None)
    while solver.status == "running":
        before = solver.t, solver.y.copy()
        if fault := _step(solver):
            raise AdaptiveError(fault, *before)
        if wanted is not None and wanted <= solver.t:
            states = solver.dense_output()
            while wanted is not None and wanted <= solver.t:
                yield wanted, states(wanted)
                wanted = next(times, None)
    yield end, solver.y


def _step(solver: OdeSolver) -> str:
    """Take one step; say what went wrong, if anything."""
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what LSODA warns of, it also fails with
            fault = solver.step()
    except TrussflowError:
        raise
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:  # of not finite matrices
        return str(error)
    if solver.status == "failed":
        return str(fault or "no step is small enough")
    return "" if np.isfinite(solver.y).all() else "the state is not finite"
