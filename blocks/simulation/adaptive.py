"""Adaptive and stiff integration between instants, by SciPy."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import cache
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.simulation.events import EventWatch
from trussflow.blocks.support.interrupts import uninterrupted
from trussflow.blocks.support.types import Vector

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver

METHODS = ("RK45", "DOP853", "LSODA", "BDF", "Radau")
"""Explicit: RK45, DOP853. Stiff: BDF, Radau. Switching: LSODA."""

IMPLICIT = ("BDF", "Radau")
"""Methods that use the exact Jacobian. LSODA would evaluate it so often that its own differences of
the compiled derivative are several times cheaper."""

Function = Callable[[float, Vector], Any]


class AdaptiveError(ArithmeticError):
    """The solver gave up; the arguments are the reason, and the last good time and state."""


def integrate(
    method: str,
    derivative: Function,
    jacobian: Function | None,
    span: tuple[float, float],
    times: Iterator[float],
    x: Vector,
    tolerances: tuple[float, float],
    watch: EventWatch | None,
    accepted: Callable[[float, Vector, float], Any],
) -> Iterator[tuple[float, Vector]]:
    """Integrate over a span; the solver starts anew in each span and after each event.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    derivative, jacobian : callable
        dx/dt and its exact derivative by x, as functions of (t, x); the derivative may be None.
    span : tuple of float
        Initial and final time [s].
    times : iterator of float
        Increasing times inside the span [s].
    x : Vector
        Initial state [as declared].
    tolerances : tuple of float
        Relative and absolute tolerance [-, unit of the state].
    watch : EventWatch or None
        Finds and handles events.
    accepted : callable
        Called with time, state and length of the step after each step.

    Yields
    ------
    float, Vector
        Each of the `times`, as soon as it is reached, and the state then; last the end.

    Raises
    ------
    AdaptiveError
        If the solver gives up or the state stops being finite.
    """
    now, end = span
    if not x.size:
        # Without states, events are checked at the output times.
        for t in chain(times, [end]):
            if watch is not None:
                watch.executor.between("euler", (now, t, t - now), x, watch.d, watch.p)
            accepted(t, x, np.inf)
            now = t
            yield now, x
        return
    options = {} if jacobian is None else {"jac": jacobian}
    x = x.copy()
    wanted = next(times, None)
    if watch is not None:
        x = watch.begin(now, x)
    while now < end:
        if not np.isfinite(derivative(now, x)).all():
            raise AdaptiveError("no step can be taken", now, x)
        # A time event ends the span, so that no step has to be cut at it.
        stop = end if watch is None else min(end, watch.next_time())
        for before, solver in _steps(
            method, derivative, (now, stop), x, tolerances, options
        ):
            states = _dense(solver)
            now = float(solver.t)
            x = solver.y
            step = now - before
            event = None if watch is None else watch.after_step(before, now, x, states)
            if event is not None:
                now, x = event
            while wanted is not None and wanted < now:
                yield wanted, states(wanted)
                wanted = next(times, None)
            if event is not None and watch is not None:
                x = watch.handle(now, x, step)
            accepted(now, x, step)
            # A jump makes the solver's step size and history invalid: a new one starts.
            if event is not None:
                break
        while wanted is not None and wanted <= now:  # at an event: the state after it
            yield wanted, x
            wanted = next(times, None)
    yield end, x


def _dense(solver: OdeSolver) -> Callable[[float], Vector]:
    """Return the solution within the last step, evaluated on demand."""
    # Made at most once a step, and only if needed: DOP853 evaluates three more stages.
    states = cache(solver.dense_output)
    return lambda t: np.asarray(states()(t))


def _steps(
    method: str,
    derivative: Function,
    span: tuple[float, float],
    x: Vector,
    tolerances: tuple[float, float],
    options: dict[str, Any],
) -> Iterator[tuple[float, OdeSolver]]:
    """Take steps; yield the time before each step, and the solver after it."""
    with uninterrupted():
        from scipy import integrate as solvers  # takes a third of a second

    solver = getattr(solvers, method)(
        derivative,
        span[0],
        x,
        span[1],
        rtol=tolerances[0],
        atol=tolerances[1],
        **options,
    )
    while solver.status == "running":
        before = float(solver.t), solver.y.copy()
        if fault := _step(solver):
            raise AdaptiveError(fault, *before)
        yield before[0], solver


def _step(solver: OdeSolver) -> str:
    """Take one step; return the reason if it failed, or an empty text."""
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # LSODA also reports its warnings as failures
            fault = solver.step()
    # Some of these errors are also ValueError or ArithmeticError.
    except TrussflowError:
        raise
    except (ValueError, ArithmeticError) as error:  # of matrices that are not finite
        return str(error)
    if solver.status == "failed":
        return str(fault or "no step is small enough")
    return "" if np.isfinite(solver.y).all() else "the state is not finite"
