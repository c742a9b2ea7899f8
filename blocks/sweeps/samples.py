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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import NameLookupError, SimulationError, TrussflowError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import Entry
from trussflow.blocks.framework.system import System
from trussflow.blocks.results.log import status_of
from trussflow.blocks.simulation.lanes import LaneRun, Lanes
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Vector
from trussflow.blocks.sweeps.reductions import Kept, reduced
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
class Sample:
    """Result of one sample.

    Attributes
    ----------
    number : int
        Index of the sample [-].
    varied : dict
        Varied values, read back from the run [as declared].
    status, message : str
        Status of the run, and its error message.
    values : dict
        Reduced results by name.
    """

    number: int
    varied: dict[str, Any]
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
    lanes : bool
        Whether the speed of batched runs justifies the time to compile their code.
    """

    model: Model
    duration: float
    settings: dict[str, Any]
    not_finite: str = "stop"
    keep: Kept | None = None
    time_limit: float | None = None
    lanes: bool = False


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
        """Executor of batched runs, if they are possible and worth compiling."""
        if not self.recipe.lanes:
            return None
        with contextlib.suppress(CompilationError):
            return Lanes(self.simulator({}))
        return None

    def together(
        self, samples: Sequence[tuple[int, dict[str, Any]]]
    ) -> Iterator[Sample]:
        """Yield the results of `samples`, which are indices and values [as declared]."""
        with self._building:  # threads share the code
            lanes = self.lanes
        # fewer samples are faster one by one
        if lanes is None or 2 * len(samples) < lanes.count:
            for number, values in samples:
                yield self.sample(number, values)
            return
        plan, recipe = self.simulator({}).prepared.plan, self.recipe
        good, alone = [], []
        for number, values in samples:
            try:
                good.append((number, values, self.overrides(plan, values)))
            except Exception:  # noqa: BLE001 - the run of this sample alone reports the error
                alone.append((number, values))
        runs = lanes.run(recipe.duration, [one[2] for one in good], recipe.not_finite)
        for (number, values, _), run in zip(good, runs, strict=True):
            # None for a failed run, which `sample` repeats alone for its error.
            yield self.sample(number, values, run)
        for number, values in alone:
            yield self.sample(number, values)

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
        # Parameters first, as initial states may depend on them; whole arrays before their elements.
        places.sort(key=lambda one: (not one[0].is_parameter, bool(one[0].element)))
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
        self, number: int, values: dict[str, Any], lane: LaneRun | None = None
    ) -> Sample:
        """Return sample `number` [-], run with `values` [as declared], or from its `lane`."""
        try:
            self.simulator(values)  # built before the time limit of the sample starts
            with _watched(self.recipe.time_limit):
                result = self.run(values) if lane is None else lane
                found = Sample(number, self._read_back(result, values))
                found.values = (
                    reduced(result, self.recipe.keep)
                    if self.recipe.keep is not None
                    else {}
                )
        except (Exception, SystemExit) as error:  # noqa: BLE001 - a failed sample is a result
            found = Sample(number, dict(values), status_of(error))
            logged: Any = getattr(error, "result", None)
            try:
                if logged is not None:
                    found.varied = self._read_back(logged, values)
            except SimulationError as unused:
                # The run did not use the values: that is worse than how it ended.
                error, found.status = unused, "failed"
            kind = (
                "" if isinstance(error, TrussflowError) else f"{type(error).__name__}: "
            )
            found.message = f"{kind}{error}"
        return found

    def _read_back(
        self, result: xr.Dataset | LaneRun, values: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return the values that a run used, from its start or from the attributes of its result."""
        plan = self.simulator(values).prepared.plan
        if isinstance(result, LaneRun):
            return {
                name: self._place(plan, name).value_in(result.start) for name in values
            }
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

    def value_in(self, start: tuple[Vector, Vector, Vector]) -> Any:
        """Return the value at the `start` of a run, x, d and p [as declared]."""
        flat = start[self.vector][self.entry.start : self.entry.stop]
        return np.reshape(flat, self.entry.shape)[self.element]


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
    recipe: bytes, samples: Sequence[tuple[int, dict[str, Any]]]
) -> tuple[list[Sample], float]:
    """Return the results of `samples`, indices and values, by a pickled `recipe`, and the time taken [s]."""
    begun, runs = time.perf_counter(), runs_of(recipe)
    found = [*runs.together(samples)]
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
