"""Tuning: optimization of parameters and initial states, with exact derivatives or without derivatives."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from trussflow.blocks.errors import (
    DivergenceError,
    SimulationError,
    SimulationInterrupted,
)
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.system import System
from trussflow.blocks.simulation.simulator import Simulator, SimulatorSettings
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import (
    by_name,
    finite_array,
    positive_whole,
    shown,
    yes_or_no,
)
from trussflow.blocks.sweeps.objective import Becoming, Trials, differentiated, swept
from trussflow.blocks.sweeps.samples import own_values, refuse_settings

DIVERGED_COST_FACTOR = 10.0
"""Cost of a run that diverges, relative to the largest cost so far [-]."""

LIMIT_TOLERANCE = 1e-6
"""Largest violation of a limit that counts as round-off, relative to the limit, or to 1 if it is zero [-]."""

COST_TOLERANCE = 1e-9
"""Change of the cost at which the search ends, relative to the initial cost [-]."""

INITIAL_RADIUS, FINAL_RADIUS = 0.1, 1e-4
"""Initial and final trust-region radius without derivatives, relative to the ranges [-]."""

COST_NAME = "the cost"
"""Name of the cost among the functions of a run."""

Limit = tuple[Callable[[Any], Any], Any]
"""A function, and the largest value that it may return."""

Ranges = Mapping[str, tuple[Array, Array, Array]]
"""Smallest, initial and largest value, all of one shape, by name."""


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(Described):
    """Result of `tune`.

    Attributes
    ----------
    values : dict of array
        Best values by name [as declared].
    cost, before : float
        Cost with these values, and with the initial ones [as the cost].
    limits : dict of array
        Largest values of the limited functions over all samples [as they return].
    runs : int
        Number of runs, derivatives included [-].
    message : str
        Reason why the optimizer ended without an optimum, or an empty text.
    """

    values: dict[str, Array]
    cost: float
    before: float
    limits: dict[str, Array]
    runs: int
    message: str

    def _described(self) -> Description:
        facts = {
            name: shown(value) for name, value in (self.values | self.limits).items()
        }
        ended = f" ({self.message})" if self.message else ""
        return Description(
            f"cost {self.cost:.6g}, from {self.before:.6g}, in {self.runs} runs{ended}",
            facts,
        )


def tune(
    model: Diagram | System | Simulator,
    duration: float,
    cost: Callable[[Any], Any],
    vary: Mapping[str, tuple[Any, ...]],
    *,
    becoming: Becoming | None = None,
    limits: Mapping[str, Limit] | None = None,
    requirements: Mapping[str, Limit] | None = None,
    samples: Sequence[Mapping[str, Any]] = ({},),
    derivatives: bool = True,
    iterations: int = 100,
    path: str | Path | None = None,
    executor: str | Executor | None = None,
    workers: int | None = None,
    **settings: Unpack[SimulatorSettings],
) -> Tuned:
    """Return the values of parameters and initial states that minimize the cost of a run.

    With exact derivatives, the method is sequential quadratic programming (Kraft 1988;
    `scipy.optimize.minimize`, SLSQP). Without derivatives, it is a trust-region method with quadratic models
    (Ragonneau 2022, *Model-Based Derivative-Free Optimization Methods and Software*; COBYQA). Both find a
    local optimum.

    Parameters
    ----------
    model : Diagram, System or Simulator
        Model to run. With derivatives, it must have fixed steps, no Python blocks, and no iterated loops.
    duration : float
        Time to simulate [s].
    cost : callable
        Function from the run to a number. With derivatives, the run is that of `gradient`, otherwise the
        dataset that `simulate` returns.
    vary : mapping
        Ranges by ``"block.name"``: smallest and largest value, with the value of the block as the initial
        one; or smallest, initial and largest value [as declared].
    becoming : callable, optional
        Function from the names in `vary` as keywords to parameters and initial states of the diagram, if
        one number changes several of them. With derivatives, it must trace.
    limits : mapping, optional
        Pairs by name: a function from the run to numbers, and their largest allowed values.
    requirements : mapping, optional
        Pairs by name: a function of the values, such as poles or margins of the linearized diagram, and
        its largest allowed value. These functions are differentiated by finite differences.
    samples : sequence of mapping
        Other parameters and initial states of each run. The mean cost is minimized, and the limits hold for
        all samples.
    derivatives : bool
        Whether runs are differentiated. If not, any model and any function is allowed, and each trial is
        a `sweep` over the samples without tracing or compilation.
    iterations : int
        Largest number of iterations, or of trials without derivatives [-].
    path : path, optional
        Without derivatives: folder for finished runs. The same call resumes there.
    executor, workers
        Without derivatives: as of `sweep`; by default ``"threads"`` [workers: -].
    **settings
        As for `Simulator`: log, log_step, step, solver, backend, rtol, atol.

    Returns
    -------
    Tuned

    Raises
    ------
    SimulationError
        If an argument is not allowed, the run cannot be differentiated, or a run fails.
    DivergenceError
        If a run diverges with the initial values.
    NameLookupError
        If there is no such parameter or state.
    TracingError
        If a function does not trace.
    SimulationInterrupted
        On Ctrl-C; its `result` is the best trial so far.
    """
    from scipy.optimize import minimize

    positive_whole(iterations=iterations)
    yes_or_no("tune", "derivatives", derivatives)
    refuse_settings(model, settings, "tune")
    if derivatives and (path, executor, workers) != (None, None, None):
        raise SimulationError("path, executor and workers are for derivatives=False")
    limits, requirements = (
        {name: _limit(name, limit) for name, limit in by_name(what, given).items()}
        for what, given in (("limits", limits), ("requirements", requirements))
    )
    if COST_NAME in limits:
        raise SimulationError(
            f"no limit may be called '{COST_NAME}'; give it another name"
        )
    functions = {
        COST_NAME: cost,
        **{name: function for name, (function, _) in limits.items()},
    }
    simulator = model if isinstance(model, Simulator) else Simulator(model, **settings)
    ranges = _ranges(simulator, vary, becoming is not None)
    # dict(**values) returns the values themselves.
    becoming = dict if becoming is None else becoming
    start = {name: begin for name, (_, begin, _) in ranges.items()}
    made = by_name("tuned values", becoming(**start))
    samples = [by_name("a sample", sample) for sample in samples]
    others = {name for sample in samples for name in sample}
    if (
        not samples
        or others & made.keys()
        or any(sample.keys() != others for sample in samples)
    ):
        raise SimulationError(
            "samples must be mappings of the same names, and of none that are tuned"
        )
    if not made:
        raise SimulationError("becoming returns no parameters or initial states")
    run = simulator, duration, functions, becoming
    if derivatives:
        trials = differentiated(*run, start, samples)
    else:
        executor = executor or "threads"
        how: dict[str, Any] = {"workers": workers, "repeats": iterations}
        trials = swept(*run, samples, path, executor=executor, **how)
    search = _Search(trials, ranges, limits, len(samples))

    @functools.cache  # called several times in each trial
    def spare(point: bytes) -> Vector:
        values = search.values(np.frombuffer(point))
        found = [
            _spare(function(values), most) for function, most in requirements.values()
        ]
        return np.concatenate([np.ravel(one) for one in found])

    before = search.at(search.start).cost
    # Relative to the initial cost, as the tolerances of the optimizers are absolute.
    scale = abs(before) or 1.0
    method: dict[str, Any] = {"method": "SLSQP" if derivatives else "COBYQA"}
    room: dict[str, Any] = {"type": "ineq", "fun": lambda x: search.at(x).room}
    if derivatives:
        room["jac"] = lambda x: search.at(x).room_slope
        method["jac"] = lambda x: search.at(x).slope / scale
        method["options"] = {"maxiter": iterations, "ftol": COST_TOLERANCE}
    else:
        radii = {"initial_tr_radius": INITIAL_RADIUS, "final_tr_radius": FINAL_RADIUS}
        method["options"] = {"maxfev": iterations, **radii}
    constraints: list[Any] = [room] if limits else []
    if requirements:
        constraints.append({"type": "ineq", "fun": lambda x: spare(x.tobytes())})

    def scaled(x: Vector) -> float:
        return search.at(x).cost / scale

    def missing(x: Vector) -> float:
        # A requirement that is NaN, as the poles of an impossible
        # design, counts as not met.
        least = np.min(
            [np.min(one["fun"](x), initial=0.0) for one in constraints], initial=0.0
        )
        return (
            0.0
            if least >= -LIMIT_TOLERANCE
            else float(np.nan_to_num(-least, nan=np.inf))
        )

    def tuned(x: Vector, message: str) -> Tuned:
        best = search.at(x)
        return Tuned(
            search.values(x), best.cost, before, best.most, search.runs, message
        )

    bounds = [(0.0, 1.0)] * len(search.start)
    try:
        found = minimize(
            scaled, search.start, bounds=bounds, constraints=constraints, **method
        )
    except KeyboardInterrupt:
        # First the smallest violation of limits, then the smallest cost.
        best = min(search.tried, key=lambda x: (missing(x), search.at(x).cost))
        kept = (
            f"; the same call continues with the runs in '{path}'"
            if path is not None
            else ""
        )
        raise SimulationInterrupted(
            f"stopped after {len(search.tried)} trials; the best is the result of this exception{kept}",
            tuned(
                best,
                "stopped" if not missing(best) else "stopped before limits were met",
            ),
        ) from None
    message = "" if found.success else str(found.message)
    if missing(found.x):
        message = f"limits are not met: {message or 'no values near these meet them'}"
    return tuned(found.x, message)


def _limit(name: str, limit: Any) -> Limit:
    """Return the checked pair of a function and its largest value."""
    if not isinstance(limit, tuple | list) or len(limit) != 2 or not callable(limit[0]):
        raise SimulationError(
            f"the limit '{name}' is {shown(limit)}; give (function, most)"
        )
    return limit[0], finite_array(f"the limit of '{name}'", limit[1])


def _spare(found: Any, most: Array) -> Array:
    """Return the distance to a limit, relative to the limit, or to 1 if it is zero [-]."""
    return (most - found) / _size(most)


def _size(most: Array) -> Array:
    """Return the scale of a limit [as limited]."""
    return np.where(most == 0.0, 1.0, np.abs(most))


class _Found(NamedTuple):
    """Cost, distance to the limits, their derivatives, and largest values of the limited functions."""

    cost: float
    slope: Vector
    room: Vector
    room_slope: Vector
    most: dict[str, Array]


class _Search:
    """Scaled objective of the optimizer: values are mapped from their ranges to 0 to 1."""

    def __init__(
        self, trials: Trials, ranges: Ranges, limits: Mapping[str, Limit], samples: int
    ) -> None:
        self._trials, self._limits, self._samples, self.runs = (
            trials,
            limits,
            samples,
            0,
        )
        self._shapes = {name: begin.shape for name, (_, begin, _) in ranges.items()}
        low, begin, high = (
            np.concatenate([np.ravel(one) for one in each])
            for each in zip(*ranges.values(), strict=True)
        )
        self._low, self._span = low, high - low
        self.start = np.clip((begin - low) / self._span, 0.0, 1.0)
        self._last = self._flown(self.start)
        self._known, self._worst = (
            {self._flat(self.start).tobytes(): self._last},
            abs(self._last.cost),
        )
        self.tried = [self.start]

    def _flat(self, x: Vector) -> Vector:
        # Clipped, as optimizers may leave the bounds by round-off.
        return np.asarray(self._low + self._span * np.clip(x, 0.0, 1.0))

    def values(self, x: Vector) -> dict[str, Array]:
        """Return the tuned values by name [as declared]."""
        flat = self._flat(x)
        places = zip(
            self._shapes.items(), spans(map(prod, self._shapes.values())), strict=True
        )
        return {name: flat[place].reshape(shape) for (name, shape), place in places}

    def at(self, x: Vector) -> _Found:
        """Return the results at a point; if a run diverges, a large cost with the last derivatives."""
        # Cost, limits and derivatives are asked for separately, but
        # come from one trial.
        key = self._flat(x).tobytes()
        if key not in self._known:
            try:
                self._last = self._flown(x)
                self.tried.append(np.array(x))
                self._worst = max(self._worst, abs(self._last.cost))
            except DivergenceError:
                # An exception would end the search; a large cost lets the
                # optimizer turn back.
                self._last = self._last._replace(
                    cost=DIVERGED_COST_FACTOR * self._worst + 1.0
                )
            self._known[key] = self._last
        return self._known[key]

    def _flown(self, x: Vector) -> _Found:
        self.runs += self._samples
        found, slopes = self._trials(self.values(x))
        if found[COST_NAME].size != self._samples:
            raise SimulationError(
                f"{COST_NAME} has the shape {found[COST_NAME].shape[1:]}, and must be one number"
            )
        rooms, room_slopes = [np.zeros(0)], [np.zeros((0, len(x)))]
        for name, (_, most) in self._limits.items():
            rooms.append(np.ravel(_spare(found[name], most)))
            if slopes:
                # The sign of (most - found), and the scales of limits and
                # ranges, by the chain rule.
                sizes = np.broadcast_to(_size(most), found[name].shape).reshape(-1, 1)
                room_slopes.append(
                    -slopes[name].reshape(-1, len(x)) * self._span / sizes
                )
        return _Found(
            float(np.mean(found[COST_NAME])),
            np.mean(slopes[COST_NAME], axis=(0, 1)) * self._span
            if slopes
            else np.zeros(0),
            np.concatenate(rooms),
            np.vstack(room_slopes),
            {name: np.max(found[name], axis=0) for name in self._limits},
        )


def _ranges(simulator: Simulator, vary: Mapping[str, Any], free: bool) -> Ranges:
    """Return the ranges of the varied values; if `free`, names need not be those of the diagram."""
    given, plan = by_name("varied values", vary), simulator.prepared.plan
    if not given:
        raise SimulationError(
            "nothing varies: name parameters or initial states, such as 'block.name'"
        )
    own = {} if free else own_values(plan)
    for name in () if free else given:
        plan.p.find(name, "parameter or state", plan.x, plan.memory)
    return {name: _range(name, value, own.get(name)) for name, value in given.items()}


def _range(
    name: str, value: Any, own: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return smallest, initial and largest value; the initial one is by default the diagram's `own`."""
    number = len(value) if isinstance(value, tuple | list) else 0
    if number != 3 and (number != 2 or own is None):
        raise SimulationError(
            f"the range of '{name}' is {shown(value)}; give (smallest, initial, largest), or, for a value "
            "of the diagram, (smallest, largest)"
        )
    low, *begin, high = (finite_array(f"the range of '{name}'", one) for one in value)
    shape = begin[0].shape if own is None else own.shape
    fits = all(not one.ndim or one.shape == shape for one in (low, *begin, high))
    if not (
        fits
        and np.all(low < high)
        and all(np.all((low <= b) & (b <= high)) for b in begin)
    ):
        raise SimulationError(
            f"the range of '{name}' is {shown(value)}: give numbers, or arrays of the shape "
            f"{shape}, in increasing order, the first one less than the last"
        )
    start: Array = begin[0] if begin else np.clip(np.asarray(own), low, high)
    return (
        np.broadcast_to(low, shape),
        np.broadcast_to(start, shape),
        np.broadcast_to(high, shape),
    )
