"""Solver settings: integration method of the continuous states and backend of the equations."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self, TypedDict, TypeVar

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.support.validation import (
    meant,
    one_of,
    positive,
    positive_if_given,
)

F = TypeVar("F", bound=Callable[..., Any])


def _rk4(rate: Callable[[Any, Any], Any], times: Sequence[Any], h: Any, x: Any) -> Any:
    """Return the state after a step of the classical Runge-Kutta method."""
    k1 = rate(times[0], x)
    k2 = rate(times[1], x + h / 2 * k1)
    k3 = rate(times[1], x + h / 2 * k2)
    k4 = rate(times[2], x + h * k3)
    # Summed in the order of `tf_rk4` in fixed_step.h.
    return x + h / 6 * k1 + h / 3 * k2 + h / 3 * k3 + h / 6 * k4


def _euler(
    rate: Callable[[Any, Any], Any], times: Sequence[Any], h: Any, x: Any
) -> Any:
    """Return the state after a step of Euler's method."""
    return x + h * rate(times[0], x)


FIXED_STEP = {"rk4": _rk4, "euler": _euler}
"""Formulas of the solvers with fixed steps, of numbers or of expressions, in the order of their numbers in C.

Arguments are the rate of the state, a function of time and state; the times at the beginning, in the middle and
at the end of the step [s]; its length [s]; and the state before [as declared].
"""

MIN_RTOL = 100 * sys.float_info.epsilon
"""Smallest relative tolerance [-]."""

REPLACEMENTS = {"LSODA": "auto", "BDF": "Rodas5P", "Radau": "Rodas5P"}
"""Solvers that replace those of SciPy, by name."""

BACKENDS = ("auto", "compiled", "interpreted", "numpy")


class SolverSettings(TypedDict, total=False):
    """Settings of a `Solver`, as keywords of the functions that run a diagram."""

    step: float | None
    solver: str
    backend: str
    rtol: float
    atol: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Solver:
    """Integration method of the continuous states and backend of the equations.

    All functions and classes that run a diagram (`simulate`, `Session`...) take these as keywords.

    Attributes
    ----------
    step : float or None
        Step of a fixed-step solver [s]; not used by the others.
    solver : str
        With fixed steps ``"rk4"`` (classical Runge-Kutta) or ``"euler"``. With variable steps
        ``"RK45"`` or ``"DOP853"``, explicit methods of order 5 and 8; ``"Rodas5P"``, of order 5, for
        stiff equations; or ``"auto"``, DOP853 until equations are found to be stiff, then Rodas5P.
    backend : str
        ``"compiled"``, ``"interpreted"`` (CasADi), ``"numpy"`` (for debugging), or
        ``"auto"``: compiled where there is a C compiler.
    rtol, atol : float
        Tolerances of adaptive solvers [-, unit of the state].

    Raises
    ------
    SimulationError
        If a setting is invalid.
    """

    step: float | None = None
    solver: str = "rk4"
    backend: str = "auto"
    rtol: float = 1e-8
    atol: float = 1e-10

    def __post_init__(self) -> None:
        positive(rtol=self.rtol, atol=self.atol)
        positive_if_given(step=self.step)
        if not MIN_RTOL <= self.rtol < 1:
            raise SimulationError(
                f"rtol = {self.rtol!r} must be at least {MIN_RTOL:.2g} (round-off) and below 1"
            )
        # Not by the dictionary alone: a solver that is no text may have no hash.
        if self.solver in tuple(REPLACEMENTS):
            raise SimulationError(
                f"there is no solver '{self.solver}' any more: use '{REPLACEMENTS[self.solver]}'"
            )
        one_of("solver", self.solver, (*FIXED_STEP, *METHODS))
        one_of("backend", self.backend, BACKENDS)
        if self.is_fixed and self.step is None:
            raise SimulationError(
                f"solver '{self.solver}' needs a step, such as step=1e-3"
            )

    @property
    def is_fixed(self) -> bool:
        """Whether steps are fixed."""
        return self.solver in FIXED_STEP

    @classmethod
    def of(cls, settings: Mapping[str, Any], *others: str) -> Self:
        """Return the solver for the keywords of a user.

        Parameters
        ----------
        settings : mapping of str to object
            The keywords.
        *others : str
            Further settings of the caller, for the message.

        Raises
        ------
        SimulationError
            If a name is unknown; the message lists the known names.
        """
        refuse_unknown(settings, [*(f.name for f in fields(cls)), *others])
        return cls(**settings)


def spelled_out(
    settings: Any, method: Callable[..., Any] | None = None
) -> Callable[[F], F]:
    """List the ``**settings`` of a function in its signature, for `help` and completion.

    Parameters
    ----------
    settings : TypedDict
        The settings.
    method : callable, optional
        Function that receives some of them, and has their defaults.
    """
    defaults = {field.name: field.default for field in fields(Solver)}
    if method is not None:
        defaults |= {
            name: p.default for name, p in inspect.signature(method).parameters.items()
        }

    def decorated(function: F) -> F:
        there = inspect.signature(function)
        own = [p for p in there.parameters.values() if p.kind is not p.VAR_KEYWORD]
        more = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=defaults.get(name),
                annotation=kind,
            )
            for name, kind in settings.__annotations__.items()
        ]
        function.__signature__ = there.replace(parameters=own + more)  # type: ignore[attr-defined]
        return function

    return decorated


def refuse_unknown(settings: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse `settings` that are not among those `known`.

    Raises
    ------
    SimulationError
        If a name is unknown; the message lists the known names.
    """
    names = list(dict.fromkeys(known))
    for name in settings:
        if name not in names:
            raise SimulationError(
                f"unknown setting '{name}'; there are: {', '.join(names)}{meant(name, names)}"
            )
