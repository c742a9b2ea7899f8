"""Execution of samples in the process of a worker."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import json
import multiprocessing
import os
import pickle
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import NameLookupError, SimulationError, TrussflowError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import VIOLATED
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import Entry
from trussflow.blocks.framework.system import System
from trussflow.blocks.results.log import status_of
from trussflow.blocks.simulation.lanes import Lanes, Points
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Vector
from trussflow.blocks.sweeps.reductions import Kept, reduced, reduced_together
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.plan import Plan

if TYPE_CHECKING:
    import xarray as xr

Model = Diagram | System | Simulator | Callable[..., Any]
"""Model to run, or a function that builds it from varied arguments."""

ELEMENT = re.compile(r"(.+?)\[([\d, ]+)\]")
"""An element of an array, such as ``block.parameter[2]``."""

PARAMETER_INDEX = 2
"""Index of the parameters in (x, d, p) [-]."""

MAX_CACHED_SIMULATORS = 8
"""Largest number of cached simulators, if a function builds the model."""


@dataclass(slots=True)
class Samples:
    """Results of one sample, or of several that completed; all arrays have a first axis of samples.

    Attributes
    ----------
    numbers : array of int
        Indices of the samples [-].
    varied : dict of array
        Varied values, read back from the runs [as declared].
    status, message : str
        Status of the runs, and their error message.
    values : dict of array
        Reduced results by name.
    """

    numbers: NDArray[np.intp]
    varied: dict[str, NDArray[Any]]
    status: str = "complete"
    message: str = ""
    values: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Recipe:
    """Data to run any sample of a sweep.

    Attributes
    ----------
    model : Diagram, System, Simulator or callable
        Model to run.
    duration : float
        Duration of each run [s].
    settings : dict
        Settings of the `Simulator`.
    not_finite : str
        As for `Simulator.run`.
    keep : Kept or None
        Reduction of each result.
    time_limit : float or None
        Wall time limit of each sample [s].
    lanes : int
        Number of lanes of batched runs [-]; 0 if each run goes alone.
    """

    model: Model
    duration: float
    settings: dict[str, Any]
    not_finite: str = "stop"
    keep: Kept | None = None
    time_limit: float | None = None
    lanes: int = 0


class Runs:
    """Executor of the samples of a `recipe`, which prepares each model structure once."""

    def __init__(self, recipe: Recipe) -> None:
        import xarray  # noqa: F401 - here, so that the time of the first sample does not include it

        self.recipe = recipe
        # Reentrant, as `together` holds it while `lanes` calls `simulator`.
        self._building = threading.RLock()
        # A cache of this object, not of the class: it is released with the object.
        self._built = functools.lru_cache(MAX_CACHED_SIMULATORS)(self._build)
        self._place = functools.lru_cache(_Place.of)

    def _build(self, arguments: tuple[tuple[str, Any], ...]) -> Simulator:
        model = self.recipe.model
        if not isinstance(model, Diagram | System | Simulator):
            model = model(**dict(arguments))
        return (
            model
            if isinstance(model, Simulator)
            else Simulator(model, **self.recipe.settings)
        )

    def simulator(self, values: Mapping[str, Any]) -> Simulator:
        """Return the simulator of a sample; `values` whose names have no dot are arguments of the model."""
        arguments = {
            # Arguments are Python numbers or text, which can be keys of the cache.
            name: value.item()
            for name, value in values.items()
            if "." not in name
        }
        with self._building:  # threads share the simulators
            return self._built(tuple(arguments.items()))

    @functools.cached_property
    def lanes(self) -> Lanes | None:
        """Executor of batched runs, if they are possible."""
        if not self.recipe.lanes:
            return None
        with contextlib.suppress(CompilationError):
            return Lanes(self.simulator({}), self.recipe.lanes)
        return None

    def together(
        self, numbers: NDArray[np.intp], columns: Mapping[str, NDArray[Any]]
    ) -> Iterator[Samples]:
        """Yield the results of the samples with these `numbers` and varied values, `columns` [as declared]."""
        with self._building:  # threads share the code
            lanes = self.lanes
        alone = np.ones(len(numbers), dtype=bool)
        # fewer samples are faster one by one
        if lanes is not None and 2 * len(numbers) >= lanes.count:
            # The batch begins with the default values, which may be wrong where those of the samples are not.
            with contextlib.suppress(TrussflowError):
                for chosen, samples in self._batches(lanes, numbers, columns):
                    alone[chosen] = False
                    yield from samples
        # These report the errors of values that are not allowed, and of runs that failed.
        for i in np.flatnonzero(alone).tolist():
            yield self.sample(*_row(numbers, columns, i))

    def _batches(
        self,
        lanes: Lanes,
        numbers: NDArray[np.intp],
        columns: Mapping[str, NDArray[Any]],
    ) -> Iterator[tuple[NDArray[np.intp], Iterable[Samples]]]:
        """Yield indices and results of samples that complete in `lanes`, by `numbers` and `columns` [as declared]."""
        points, good = self._points(len(numbers), columns)
        among, recipe = np.flatnonzero(good), self.recipe
        points = points.at(good)
        for runs in lanes.run(recipe.duration, points, recipe.not_finite):
            chosen = among[runs.runs]
            if recipe.keep is not None and recipe.keep.words is not None:
                varied = {n: v[chosen].astype(float) for n, v in columns.items()}
                kept = reduced_together(runs, recipe.keep.words)
                yield chosen, [Samples(numbers[chosen], varied, values=kept)]
                continue
            results = (functools.partial(runs.dataset, k) for k in range(len(chosen)))
            rows = (_row(numbers, columns, i) for i in chosen.tolist())
            yield (
                chosen,
                [self.sample(*row, of) for row, of in zip(rows, results, strict=True)],
            )

    def _points(
        self, count: int, columns: Mapping[str, NDArray[Any]]
    ) -> tuple[Points, NDArray[np.bool_]]:
        """Return the initial points of `count` runs [-] with these varied values, and whether each is allowed."""
        plan = self.simulator({}).prepared.plan
        default = plan.parameters(None)
        first = Points(*plan.initial(default, None), default)
        x, d, p = points = Points(*(np.tile(v, (count, 1)) for v in first))
        varied = [(self._place(plan, n), values) for n, values in columns.items()]
        varied.sort(key=lambda one: one[0].order)
        if _are_plain(plan, varied):
            good = _put(plan, points, varied)
        else:
            good = np.zeros(count, dtype=bool)
            for i in range(count):
                with contextlib.suppress(Exception):
                    parameters, initial = self.overrides(
                        plan, {name: values[i] for name, values in columns.items()}
                    )
                    p[i] = plan.parameters(parameters, default)
                    x[i], d[i] = plan.initial(p[i], initial)
                    good[i] = True
        # An array and one of its elements may contradict each other.
        for place, values in varied:
            same = place.values_in(points) == values
            good &= same.reshape(count, -1).all(axis=1)
        return points, good

    def check(self, values: Mapping[str, NDArray[Any]]) -> Simulator:
        """Return the simulator of a sample, after a check of the varied names and shapes.

        Raises
        ------
        NameLookupError
            If there is no such parameter, state or argument.
        SimulationError
            If a value has another shape.
        """
        arguments, model = (
            {name for name in values if "." not in name},
            self.recipe.model,
        )
        if not isinstance(model, Diagram | System | Simulator):
            if not callable(model):
                raise SimulationError(
                    f"cannot sweep a {type(model).__name__}: give a diagram, a Simulator, or a function that "
                    "returns a diagram"
                )
            try:
                # Checks the names only: the model itself is built below.
                inspect.signature(model).bind(**dict.fromkeys(arguments))
            except TypeError as error:
                raise NameLookupError(
                    f"the function that builds the diagram: {error}"
                ) from None
        elif arguments:
            example = f"'block.{min(arguments)}'"
            raise NameLookupError(
                f"no parameter or state '{min(arguments)}': write {example}"
            )
        simulator = self.simulator(values)
        for name, value in values.items():
            wanted = (
                ()
                if name in arguments
                else self._place(simulator.prepared.plan, name).shape
            )
            if value.shape != wanted:
                hint = (
                    f"; name one element, '{name}[0]', or give arrays" if wanted else ""
                )
                raise SimulationError(
                    f"'{name}' has shape {wanted}, its values have {value.shape}{hint}"
                )
        return simulator

    def overrides(
        self, plan: Plan, values: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the parameters and initial states of a run in a `plan` with `values` [as declared]."""
        places = [(self._place(plan, n), v) for n, v in values.items() if "." in n]
        places.sort(key=lambda one: one[0].order)
        parameters, initial = dict[str, Any](), dict[str, Any]()
        for place, value in places:
            own = parameters if place.is_parameter else initial
            if not place.element:
                own[place.reference] = value
                continue
            if (
                place.reference not in own
            ):  # the other elements keep the values of the run
                p = plan.parameters(parameters)
                named = plan.p.named(p) if place.is_parameter else _states(plan, p)
                own[place.reference] = named[place.reference]
            # A copy: the array may be a row of the varied values,
            # which must not change.
            own[place.reference] = np.array(own[place.reference])
            own[place.reference][place.element] = value
        return parameters, initial

    def run(self, values: Mapping[str, Any]) -> xr.Dataset:
        """Return the result of the run with these `values` [as declared]."""
        simulator, recipe = self.simulator(values), self.recipe
        parameters, initial = self.overrides(simulator.prepared.plan, values)
        return simulator.run(
            recipe.duration,
            parameters=parameters,
            initial=initial,
            progress=False,
            not_finite=recipe.not_finite,
            time_limit=recipe.time_limit,
        )

    def sample(
        self,
        number: int,
        values: dict[str, Any],
        result_of: Callable[[], xr.Dataset] | None = None,
    ) -> Samples:
        """Return sample `number` [-] with `values` [as declared], from its run or from `result_of`, if given."""
        varied, status, message, kept = dict(values), "complete", "", dict[str, Any]()
        try:
            self.simulator(values)  # built before the time limit of the sample starts
            with _watched(self.recipe.time_limit):
                result = self.run(values) if result_of is None else result_of()
                varied = self._read_back(result, values)
                if self.recipe.keep is not None:
                    kept = reduced(result, self.recipe.keep)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a failed sample is a result
            varied, status, kept = dict(values), status_of(error), {}
            logged: Any = getattr(error, "result", None)
            try:
                if logged is not None:
                    varied = self._read_back(logged, values)
            except SimulationError as unused:
                # The run did not use the values: that is worse than how it ended.
                error, status = unused, "failed"
            kind = (
                "" if isinstance(error, TrussflowError) else f"{type(error).__name__}: "
            )
            message = f"{kind}{error}"
        return one_sample(number, varied, status, message, kept)

    def _read_back(
        self, result: xr.Dataset, values: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return the values that a run used, from the attributes of its result."""
        plan = self.simulator(values).prepared.plan
        had = {
            kind: json.loads(result.attrs[kind])
            for kind in ("parameters", "initial_states")
        }
        found = {name: value for name, value in values.items() if "." not in name}
        for name in values.keys() - found.keys():
            place = self._place(plan, name)
            listed = had["parameters" if place.is_parameter else "initial_states"][
                place.reference
            ]
            found[name] = np.reshape(listed, place.entry.shape)[place.element]
            if not (found[name] == values[name]).all():
                raise SimulationError(
                    f"'{name}' was to be {values[name]}, but the run had {found[name]}"
                )
        return {name: found[name] for name in values}


def one_sample(
    number: int,
    varied: Mapping[str, Any],
    status: str,
    message: str,
    values: Mapping[str, Any] | None = None,
) -> Samples:
    """Return the result of one sample.

    Parameters
    ----------
    number : int
        Index of the sample [-].
    varied, status, message, values
        As for `Samples`, without the axis of samples [as declared].
    """
    return Samples(
        np.array([number]),
        {name: np.asarray(value)[np.newaxis] for name, value in varied.items()},
        status,
        message,
        {
            name: value.expand_dims("sample")
            if hasattr(value, "expand_dims")
            else value[np.newaxis]
            for name, value in (values or {}).items()
        },
    )


def _row(
    numbers: NDArray[np.intp], columns: Mapping[str, NDArray[Any]], i: int
) -> tuple[int, dict[str, Any]]:
    """Return the number and the varied values of sample `i` of these."""
    return numbers[i].item(), {name: values[i] for name, values in columns.items()}


class _Place(NamedTuple):
    """Place of a varied value in a plan; an empty `element` selects the whole array.

    `vector` is the index of its vector in (x, d, p), and `entry` its place there.
    """

    reference: str
    element: tuple[int, ...]
    vector: int
    entry: Entry
    shape: tuple[int, ...]

    @property
    def is_parameter(self) -> bool:
        """Whether it is in the vector of parameters."""
        return self.vector == PARAMETER_INDEX

    @property
    def order(self) -> tuple[bool, bool]:
        """Parameters come first, as initial states may depend on them, and whole arrays before their elements."""
        return not self.is_parameter, bool(self.element)

    @staticmethod
    def of(plan: Plan, name: str) -> _Place:
        """Return the place of the value with this name."""
        match = ELEMENT.fullmatch(name)
        reference, words = match.groups() if match else (name, "")
        hint = plan.structural(reference)
        entry = plan.p.find(
            reference, "parameter or initial state", plan.x, plan.memory, hint=hint
        )
        element = tuple(int(word) for word in words.split(",") if word)
        try:
            # NumPy checks the index, and gives the shape of the element.
            shape = np.empty(entry.shape)[element].shape
        except IndexError:
            raise NameLookupError(
                f"there is no '{name}': '{reference}' has shape {entry.shape}"
            ) from None
        layouts = plan.x, plan.memory, plan.p
        vector = next(
            k
            for k, layout in enumerate(layouts)
            if layout.entries.get((entry.path, entry.name)) is entry
        )
        return _Place(reference, element, vector, entry, shape)

    def values_in(self, points: Points) -> NDArray[Any]:
        """Return a view of the values of all runs in `points` [as declared]."""
        whole: Vector = points[self.vector][:, self.entry.start : self.entry.stop]
        every: tuple[Any, ...] = (slice(None), *self.element)
        values: NDArray[Any] = whole.reshape(-1, *self.entry.shape)[every]
        return values


Varied = Sequence[tuple[_Place, NDArray[Any]]]
"""Varied values of all samples [as declared], in the order of `_Place.order`."""


def _are_plain(plan: Plan, varied: Varied) -> bool:
    """Return whether only rules of `Parameter` and `State` are between varied values and initial states."""
    blocks = plan.system.blocks
    changed = {place.entry.path for place, _ in varied if place.is_parameter}
    rules = "parameter_value", "initial"
    return (
        all(values.dtype.kind in "biuf" for _, values in varied)
        and not any(block.states_own("initial_state") for block in blocks.values())
        and not any(
            getattr(type(blocks[path]), rule) is not getattr(Block, rule)
            for path in changed
            for rule in rules
        )
        and all(start.shape == state.shape for state, start in _named(plan, changed))
    )


def _named(plan: Plan, paths: Set[str]) -> list[tuple[Entry, Entry]]:
    """Return the states of the blocks at these `paths` that start at a parameter, and these parameters."""
    found = []
    for entry in (entry for layout in plan.stored for entry in layout):
        start = plan.system.blocks[entry.path]._declared[entry.name].initial
        if entry.path in paths and isinstance(start, str):
            found.append((entry, plan.p.entries[entry.path, start]))
    return found


def _put(plan: Plan, points: Points, varied: Varied) -> NDArray[np.bool_]:
    """Put varied values into `points` [as declared]; return the runs whose values are allowed."""
    x, d, p = points
    good = np.ones(len(p), dtype=bool)
    parameters = [one for one in varied if one[0].is_parameter]
    for place, values in parameters:
        place.values_in(points)[...] = values
    changed = {place.entry.path for place, _ in parameters}
    for state, start in _named(plan, changed):
        target = x if (state.path, state.name) in plan.x.entries else d
        target[:, state.start : state.stop] = p[:, start.start : start.stop]
    for place, values in varied[len(parameters) :]:
        place.values_in(points)[...] = values
    for place, _ in varied:
        values = points[place.vector][:, place.entry.start : place.entry.stop]
        bad = ~np.isfinite(values)
        block = plan.system.blocks[place.entry.path]
        if place.is_parameter:
            for word, bound in block._declared[place.entry.name].bounds.items():
                bad |= VIOLATED[word](values, bound)
        good &= ~bad.any(axis=1)
    for path in changed:
        block = plan.system.blocks[path]
        if type(block).check_parameters is Block.check_parameters:
            continue
        for i in np.flatnonzero(good):
            try:
                block.check_parameters(plan.p.signals(path, p[i]))
            except Exception:  # noqa: BLE001 - the run of this sample alone reports it
                good[i] = False
    return good


def _states(plan: Plan, p: Vector) -> dict[str, Any]:
    """Return the initial states with parameters `p`."""
    x, d = plan.initial(p, None)
    return plan.x.named(x) | plan.memory.named(d)


def own_values(plan: Plan) -> dict[str, Any]:
    """Return the default parameters and initial states of a `plan` by name [as declared]."""
    return plan.p.named(p := plan.parameters(None)) | _states(plan, p)


def digest(simulator: Simulator) -> str:
    """Return a hash of the equations and default values of a simulator, without its settings."""
    numbers = {
        name: value.tolist()
        for name, value in own_values(simulator.prepared.plan).items()
    }
    return hashlib.sha256(
        f"{simulator.prepared.fingerprint} {json.dumps(numbers)}".encode()
    ).hexdigest()[:16]


def refuse_settings(model: Model, settings: Mapping[str, Any], what: str) -> None:
    """Check that there are no `settings` [as of `Simulator`] for `what` if the `model` is a `Simulator`.

    Raises
    ------
    SimulationError
        If there are any.
    """
    if isinstance(model, Simulator) and settings:
        raise SimulationError(
            f"a Simulator has its settings: give {', '.join(settings)} to it, not to {what}"
        )


known: dict[bytes, Runs] = {}
"""Executor of the samples of each pickled recipe in this process."""

_loading = threading.Lock()


def runs_of(recipe: bytes) -> Runs:
    """Return the executor of the samples of a pickled `recipe`, built once per process."""
    # Tasks of several threads may start at once; unpickled once, the
    # model is compiled once.
    with _loading:
        if recipe not in known:
            known.clear()  # releases the last sweep of this worker
            known[recipe] = Runs(pickle.loads(recipe))
        return known[recipe]


END_TIMEOUT = 2.0
"""Wall time after the time limit of a sample at which its process is ended [s]."""

HUNG_EXIT_CODE = 75
"""Exit code of a worker whose sample does not end at its time limit [-]."""

_deadlines: dict[int, float] = {}
"""Deadline of the running sample of each thread [s]."""


def run_samples(
    recipe: bytes, numbers: NDArray[np.intp], columns: Mapping[str, NDArray[Any]]
) -> tuple[list[Samples], float]:
    """Return the results of `Runs.together` for `numbers` and `columns`, by a `recipe`, and the time taken [s]."""
    begun, runs = time.perf_counter(), runs_of(recipe)
    found = [*runs.together(numbers, columns)]
    return found, time.perf_counter() - begun


@contextlib.contextmanager
def _watched(limit: float | None) -> Iterator[None]:
    """Set the deadline of this thread for the watchdog during the body."""
    own = threading.get_ident()
    if limit is not None:
        _deadlines[own] = time.monotonic() + limit + END_TIMEOUT
        if multiprocessing.parent_process() is not None:  # such as Dask's workers
            watch()
    try:
        yield
    finally:
        _deadlines.pop(own, None)


@functools.cache
def watch() -> None:
    """Start the watchdog, which ends this process if a sample exceeds its deadline."""

    def look() -> None:
        while True:
            time.sleep(END_TIMEOUT / 10)
            # A copy of the values, as other threads add and remove deadlines.
            if any(time.monotonic() > until for until in list(_deadlines.values())):
                # No exception can stop compiled code; only the end of the process does.
                os._exit(HUNG_EXIT_CODE)

    threading.Thread(target=look, daemon=True).start()
