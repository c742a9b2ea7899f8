"""Tuning: values of parameters that make a run best, by exact derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, NamedTuple, Unpack

import numpy as np

from trussflow.blocks.framework.described import Described, Description
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import DivergenceError, SimulationError
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.validation import by_name, finite_array, positive_whole, shown
from trussflow.blocks.simulation.simulator import Simulator, SimulatorSettings
from trussflow.blocks.sweeps.gradients import DifferentiatedRun, Run

WORSE = 10.0
"""How much more than the most that a run has cost a run costs that does not stay finite [-]."""

SATISFIED = 1e-6
"""How far a limit may be missed by round-off, relative to it or to one [-]."""

PRECISION = 1e-9
"""Change of the cost at which the search ends, relative to what it was at first [-]."""

COST = "the cost"
"""Its name among the functions of a run."""

Limit = tuple[Callable[[Any], Any], Any]
"""A function, and the most that it may return."""


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(Described):
    """What `tune` has found.

    Attributes
    ----------
    values : dict of array
        The best ones, by name [as declared].
    cost, before : float
        With these values, and with those it began with [as the cost].
    limits : dict of array
        What the functions of the limits return, the most of all samples [as they return].
    runs : int
        How many runs it took, derivatives included [-].
    message : str
        Why the optimizer ended; "" where it has found an optimum.
    """

    values: dict[str, Array]
    cost: float
    before: float
    limits: dict[str, Array]
    runs: int
    message: str

    def _described(self) -> Description:
        facts = {name: shown(value) for name, value in (self.values | self.limits).items()}
        ended = f" ({self.message})" if self.message else ""
        return Description(f"cost {self.cost:.6g}, from {self.before:.6g}, in {self.runs} runs{ended}", facts)


def tune(
    diagram: Diagram,
    duration: float,
    cost: Callable[[Run], Any],
    vary: Mapping[str, tuple[Any, Any]],
    *,
    limits: Mapping[str, Limit] | None = None,
    requirements: Mapping[str, Limit] | None = None,
    samples: Sequence[Mapping[str, Any]] = ({},),
    iterations: int = 100,
    **settings: Unpack[SimulatorSettings],
) -> Tuned:
    """Return the values of parameters and initial states at which a run costs least.

    By sequential quadratic programming (Kraft 1988; `scipy.optimize.minimize`, SLSQP) with exact derivatives;
    it finds a local optimum.

    Parameters
    ----------
    diagram : Diagram
        What runs: with fixed steps, without Python blocks or loops found by iteration. It begins with
        the values that its blocks have.
    duration : float
        Time to simulate [s].
    cost : callable
        Takes the run as of `gradient`, and returns a number.
    vary : mapping
        Least and greatest value, by ``"block.name"`` [as declared].
    limits : mapping, optional
        By name: a function of the run that returns numbers, and the most that they may be.
    requirements : mapping, optional
        By name: a function of the values by name, such as of poles or margins of the diagram linearized with
        them, and the most that it may return. These are differentiated by differences.
    samples : sequence of mapping
        Values of other parameters and initial states, for each run: the mean of what they cost counts, and
        limits hold in all.
    iterations : int
        At most [-].
    **settings
        As for `Simulator`: log, log_step, step, solver.

    Returns
    -------
    Tuned

    Raises
    ------
    SimulationError
        If an argument makes no sense, the run cannot be differentiated, or does not stay finite with the
        values it begins with.
    NameLookupError
        If there is no such parameter or state.
    TracingError
        If a function does not trace.
    """
    from scipy.optimize import minimize

    positive_whole(iterations=iterations)
    limits, requirements = (
        {name: _limit(name, limit) for name, limit in by_name(what, given).items()}
        for what, given in (("limits", limits), ("requirements", requirements))
    )
    search = _Search(diagram, duration, cost, vary, limits, samples, settings)

    def spare(x: Vector) -> Vector:
        values = search.values(x)
        return np.concatenate([np.ravel(most - function(values)) for function, most in requirements.values()])

    before = search.at(search.start).cost
    scale = abs(before) or 1.0
    constraints: list[Any] = []
    if limits:
        room: dict[str, Any] = {"fun": lambda x: search.at(x).room, "jac": lambda x: search.at(x).room_slope}
        constraints.append({"type": "ineq", **room})
    if requirements:
        constraints.append({"type": "ineq", "fun": spare})
    method: Any = {"method": "SLSQP", "options": {"maxiter": iterations, "ftol": PRECISION}}

    def scaled(x: Vector) -> tuple[float, Vector]:
        return search.at(x).cost / scale, search.at(x).slope / scale

    found = minimize(
        scaled,
        search.start,
        jac=True,
        bounds=[(0.0, 1.0)] * len(search.start),
        constraints=constraints,
        **method,
    )
    x = np.clip(found.x, 0.0, 1.0)
    message = "" if found.success else str(found.message)
    if any(np.min(constraint["fun"](x), initial=0.0) < -SATISFIED for constraint in constraints):
        message = f"limits are not met: {message or 'there is no way to meet them near here'}"
    best = search.at(x)
    return Tuned(search.values(x), best.cost, before, best.most, search.runs, message)


def _limit(name: str, limit: Any) -> Limit:
    """Return a function, and the most that it may return."""
    if not isinstance(limit, tuple | list) or len(limit) != 2 or not callable(limit[0]):
        raise SimulationError(f"the limit '{name}' is {shown(limit)}; give (function, most)")
    return limit[0], finite_array(f"the limit of '{name}'", limit[1])


class _Found(NamedTuple):
    """Cost, how much the limits leave, their derivatives, and what the limited functions return at most."""

    cost: float
    slope: Vector
    room: Vector
    room_slope: Vector
    most: dict[str, Array]


class _Search:
    """What the optimizer asks for, of numbers from 0 to 1 for what is between its bounds."""

    def __init__(
        self,
        diagram: Diagram,
        duration: float,
        cost: Callable[[Run], Any],
        vary: Mapping[str, tuple[Any, Any]],
        limits: Mapping[str, Limit],
        samples: Sequence[Mapping[str, Any]],
        settings: SimulatorSettings,
    ) -> None:
        tuned, others = by_name("what varies", vary), {name: 0 for sample in samples for name in sample}
        if not samples or others.keys() & tuned.keys() or any(s.keys() != others.keys() for s in samples):
            raise SimulationError("samples must be mappings of the same names, and of none that are tuned")
        functions = {COST: cost, **{name: function for name, (function, _) in limits.items()}}
        self._run = DifferentiatedRun(Simulator(diagram, **settings), duration, functions, [*tuned, *others])
        if prod(self._run.results[COST]) != 1:
            raise SimulationError(f"{COST} has the shape {self._run.results[COST]}, and must be one number")
        self._shapes = {name: self._run.shapes[name] for name in tuned}
        ends = [_ends(name, vary[name], shape) for name, shape in self._shapes.items()]
        self._low, high = (np.concatenate([np.ravel(end[k]) for end in ends]) for k in (0, 1))
        self._span, self._limits, self._samples, self.runs = high - self._low, limits, samples, 0
        own = np.concatenate([np.ravel(self._run.own[name]) for name in tuned])
        self.start = np.clip((own - self._low) / self._span, 0.0, 1.0)
        self._x, self._found = self.start, self._flown(self.start)
        self._worst = abs(self._found.cost)

    def values(self, x: Vector) -> dict[str, Array]:
        """Return what is tuned [as declared]."""
        flat = self._low + self._span * x
        places = zip(self._shapes.items(), spans(map(prod, self._shapes.values())), strict=True)
        return {name: flat[place].reshape(shape) for (name, shape), place in places}

    def at(self, x: Vector) -> _Found:
        """Return what is there; where a run does not stay finite, a cost that leads back."""
        if not np.array_equal(x, self._x):
            self._x = x.copy()
            try:
                self._found = self._flown(np.clip(x, 0.0, 1.0))
                self._worst = max(self._worst, abs(self._found.cost))
            except DivergenceError:
                self._found = self._found._replace(cost=WORSE * self._worst + 1.0)
        return self._found

    def _flown(self, x: Vector) -> _Found:
        self.runs += len(self._samples)
        runs = [self._run({**self.values(x), **sample}) for sample in self._samples]

        def slope(by: Mapping[str, Array]) -> Vector:
            """Return a row for each number that is differentiated."""
            columns = [by[n].reshape(-1, prod(shape)) for n, shape in self._shapes.items()]
            return np.asarray(np.hstack(columns) * self._span, dtype=float)

        cost = float(np.mean([results[COST] for results, _ in runs]))
        pairs = [(r[name], by[name], most) for r, by in runs for name, (_, most) in self._limits.items()]
        empty = np.zeros((0, len(x)))
        return _Found(
            cost,
            np.mean([slope(by[COST])[0] for _, by in runs], axis=0),
            np.concatenate([np.zeros(0), *(np.ravel(most - one) for one, _, most in pairs)]),
            np.vstack([empty, *(-slope(by) for _, by, _ in pairs)]),
            {name: np.max([results[name] for results, _ in runs], axis=0) for name in self._limits},
        )


def _ends(name: str, value: Any, shape: tuple[int, ...]) -> list[Array]:
    """Return least and greatest value of what is tuned."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise SimulationError(f"'{name}' is to be tuned within {shown(value)}; give (least, greatest)")
    ends = [finite_array(f"an end of the range of '{name}'", end) for end in value]
    if any(end.ndim and end.shape != shape for end in ends) or not np.all(ends[0] < ends[1]):
        raise SimulationError(
            f"'{name}' is to be tuned within {shown(value)}: two numbers, or two arrays of the shape "
            f"{shape}, the first one less"
        )
    return [np.broadcast_to(end, shape) for end in ends]
