"""Parameter sweeps: parallel runs of a diagram with varied values, as one dataset."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import inspect
import json
import os
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import cloudpickle

from trussflow.blocks.errors import Explained, SimulationError, SimulationInterrupted
from trussflow.blocks.results.channels import Chosen
from trussflow.blocks.results.dataset import provenance
from trussflow.blocks.results.log import NAN_POLICIES
from trussflow.blocks.simulation.lanes import most_lanes
from trussflow.blocks.simulation.simulator import Simulator, SimulatorSettings
from trussflow.blocks.simulation.solver import refuse_unknown
from trussflow.blocks.support.validation import (
    is_whole,
    one_of,
    positive,
    positive_if_given,
    positive_whole,
    shown,
)
from trussflow.blocks.sweeps.chunk_store import Pieces
from trussflow.blocks.sweeps.dispatch import Dispatch
from trussflow.blocks.sweeps.executors import Processes, Serial
from trussflow.blocks.sweeps.reductions import code_of, understood
from trussflow.blocks.sweeps.samples import (
    Model,
    Recipe,
    Runs,
    digest,
    known,
    refuse_settings,
)
from trussflow.blocks.sweeps.variations import Vary, drawn
from trussflow.blocks.tracing.compiler import lanes

if TYPE_CHECKING:
    import xarray as xr

MIN_BATCHED_STEPS = 2e6
"""Smallest number of steps of all samples and repeats for which code for several lanes is compiled [-].

The time to compile, like the time of a step, is proportional to the size of the diagram. The code stays in the
cache for later sweeps. Each worker must also get samples for half of the lanes: with fewer, single runs on all
cores are faster.
"""

INSTRUCTION_SECONDS = 1e-9
"""Wall time of one instruction of the equations [s]."""

START_SECONDS = 1.0
"""Wall time after which batches go to worker processes [s], whose start takes about as long."""

MAX_FIRST_SECONDS = 0.1
"""Largest estimated time of a run for which batches begin in this process [s]: no batch is interrupted."""

UNKNOWN_WORKERS = 64
"""Assumed number of workers of an executor with an unknown number [-]."""

EXECUTORS: dict[str, Callable[[int], Executor]] = {
    "processes": Processes,
    "threads": ThreadPoolExecutor,
    "serial": Serial,
}


def sweep(
    model: Model,
    duration: float,
    *,
    vary: Vary,
    samples: int | None = None,
    seed: int = 0,
    method: str = "random",
    keep: Any = "all",
    path: str | Path | None = None,
    executor: str | Executor = "processes",
    workers: int | None = None,
    time_limit: float | None = None,
    not_finite: str = "stop",
    progress: bool = True,
    repeats: int = 1,
    **settings: Unpack[SimulatorSettings],
) -> xr.Dataset:
    """Run a diagram many times in parallel with varied values.

    Fixed-step runs without Python blocks or a time limit are advanced in batches, with the same numbers. If it
    saves time, those without events and algebraic loops take 4 or 8 steps at once on each core. Short batches
    with reductions by name begin in this process, and go to worker processes after a second.

    Parameters
    ----------
    model : Diagram, System, Simulator or callable
        Model to run. If its structure varies, a function of this module or script that builds it from the
        varied arguments.
    duration : float
        Time to simulate [s].
    vary : mapping
        Frozen distributions of `scipy.stats`, or sequences of values, by name: parameters and initial
        states ``"block.name"``, single elements ``"block.name[0]"``, and, without a dot, arguments of the
        function. Several names in a tuple vary together: by rows with a value or an array for each name, or
        by a multivariate distribution. Sequences form a full grid, in which the last varies fastest.
        Distributions are sampled for each grid point.
    samples : int, optional
        Number of samples of the distributions [-].
    seed : int
        Seed of the random numbers [-].
    method : str
        Sampling method: ``"random"``, or ``"latin"``, ``"sobol"``, ``"halton"`` of `scipy.stats.qmc`.
    keep : mapping, sequence, callable or str
        Values to keep of each run, by name: a function of its result, the name of a reduction of the output
        with that name, or a pair of output and reduction. Reductions are max, min, peak, mean, rms, final,
        settling (the time after which it stays within 2 % of its final value) and all. A list keeps whole
        signals, ``"all"`` all signals, and a function all values that it returns by name.
    path : path, optional
        Folder for finished samples. After an interruption, the same call resumes the sweep.
    executor : str or concurrent.futures.Executor
        ``"processes"``, ``"threads"``, ``"serial"``, or an executor, such as that of a Dask client.
    workers : int, optional
        Number of parallel runs [-]; by default one per core, or the number of workers of the executor.
    time_limit : float, optional
        Wall time limit of each sample [s].
    not_finite : str
        As for `Simulator.run`.
    progress : bool
        Whether sweeps of more than a second show a progress bar.
    repeats : int
        Expected number of such sweeps [-], which share their compiled code.
    **settings
        As for `Simulator`: log, log_step, step, solver, backend, rtol, atol.

    Returns
    -------
    xarray.Dataset
        Kept values along ``sample``. Varied values, read back from the runs, are coordinates; a run that did
        not use its values failed. ``status`` is that of the run, or ``"lost"``. A sample that did not
        complete has a ``message``, and its values are NaN.

    Raises
    ------
    SimulationError
        If an argument is not allowed, or the folder contains another sweep or cannot be written.
    NameLookupError
        If there is no such parameter, state or argument.
    SimulationInterrupted
        On Ctrl-C; its `result` has the finished samples.
    """
    positive(duration=duration)
    positive_if_given(time_limit=time_limit)
    positive_whole(workers=1 if workers is None else workers, repeats=repeats)
    one_of("policy for values that are not finite", not_finite, NAN_POLICIES)
    own = inspect.getfullargspec(sweep).kwonlyargs
    refuse_unknown(settings, [*SimulatorSettings.__annotations__, *own])
    refuse_settings(model, settings, "the sweep")
    kept = understood(keep)
    if (
        settings.get("log") is None
        and not isinstance(model, Simulator)
        and kept.outputs is not None
    ):
        # Other outputs would be computed and stored for nothing.
        settings["log"] = kept.outputs
    columns = drawn(vary, samples, seed, method)
    recipe = Recipe(
        model, float(duration), dict(settings), not_finite, kept, time_limit
    )
    runs = Runs(recipe)
    # Wrong names and shapes are reported here, before any worker starts.
    simulator = runs.check({name: values[0] for name, values in columns.items()})
    logged = [channel.name for channel in simulator.prepared.channels]
    if missing := [name for name in kept.outputs or () if name not in logged]:
        raise SimulationError(
            f"cannot keep '{missing[0]}': logged are {', '.join(logged)}"
        )
    identity = {
        "diagram": simulator.prepared.plan.name,
        "model": digest(simulator),
        "duration": float(duration),
        "settings": settings_of(simulator),
        "log": logged,
        "not_finite": not_finite,
        "vary": {
            name: hashlib.sha256(values.tobytes()).hexdigest()[:16]
            for name, values in columns.items()
        },
        "keep": code_of(kept.function),
    }
    count = len(next(iter(columns.values())))
    begins_here = False
    step, side = simulator.prepared.step, _side_by_side(executor, workers)
    # A varied argument changes the structure, so there is no common code for a batch.
    if step is not None and time_limit is None and all("." in name for name in columns):
        size = sum(p.graph.n_instructions() for p in simulator.prepared.programs)
        steps = repeats * count * duration / float(step)
        enough = steps >= MIN_BATCHED_STEPS and 2 * count >= lanes() * side
        # Code of one lane is that of the simulator, compiled already.
        most = min(most_lanes(simulator.prepared), lanes() if enough else 1)
        runs.recipe = recipe = dataclasses.replace(recipe, lanes=most)
        run_seconds = INSTRUCTION_SECONDS * size * duration / float(step)
        # Functions of the user may end or change a process; compiled batches cannot.
        begins_here = (
            executor == "processes"
            and kept.outputs is not None
            and run_seconds < MAX_FIRST_SECONDS
        )
    explained = (
        f"cannot pickle '{identity['diagram']}' for workers: {{}}; check the attributes of its blocks and "
        "the variables of its functions"
    )
    with Explained(lambda error: SimulationError(explained.format(error))):
        pickled = cloudpickle.dumps(recipe)
    # Threads, and the serial executor, find the prepared model here.
    known[pickled] = runs
    pieces = Pieces(path, identity, count)
    attributes = provenance() | {
        k: v if isinstance(v, str) else json.dumps(v) for k, v in identity.items()
    }
    try:
        together = (
            None if pieces.finished.all() else runs.lanes
        )  # compiled once here, then in the cache of other processes
        opened: contextlib.AbstractContextManager[Executor] = (
            contextlib.nullcontext(executor)
            if isinstance(executor, Executor)
            else EXECUTORS[executor](side)
        )
        name = simulator.prepared.plan.name
        common = pickled, columns, pieces, together.count if together else 1
        if together and begins_here:
            Dispatch(Serial(1), *common).run(name, 1, progress, START_SECONDS)
        with opened as pool:
            # Two tasks for each worker, so that the next one is there when one is done.
            Dispatch(pool, *common).run(name, 2 * side, progress)
        return pieces.whole().assign_attrs(attributes)
    except KeyboardInterrupt:
        done = f"stopped after {pieces.finished.sum()} of {count} samples"
        kept_in = (
            f"; the same call continues with those in '{path}'"
            if path is not None
            else ""
        )
        result = (
            pieces.whole().assign_attrs(attributes) if pieces.finished.any() else None
        )
        raise SimulationInterrupted(
            f"{done}, which the result of this exception holds{kept_in}", result
        ) from None
    finally:
        known.pop(pickled, None)
        pieces.close()


def settings_of(simulator: Simulator) -> dict[str, Any]:
    """Return the settings of a simulator, without its log."""
    step = simulator.log_step
    return dataclasses.asdict(simulator.prepared.solver) | {
        "log_step": None if step is None else float(step)
    }


def rerun(
    model: Model, swept: xr.Dataset, sample: int, *, log: Chosen | None = None
) -> xr.Dataset:
    """Run one sample of a sweep again, with bitwise equal numbers, and return its complete result.

    Parameters
    ----------
    model : Diagram, System, Simulator or callable
        Model of the sweep.
    swept : xarray.Dataset
        Result of `sweep`, or a dataset that was read from its file.
    sample : int
        Index of the sample [-].
    log : mapping, sequence or None
        As for `Simulator`: None logs every output.

    Raises
    ------
    SimulationError
        If there is no such sample, or the diagram has changed.
    DivergenceError
        If the sample diverges, as in the sweep.
    """
    if "vary" not in getattr(swept, "attrs", ()):
        raise SimulationError(
            f"cannot rerun a sample of {shown(swept)}: give what sweep() returned"
        )
    if not is_whole(sample) or sample not in swept["sample"]:
        raise SimulationError(
            f"there is no sample {shown(sample)}; samples are those of swept['sample']"
        )
    one = swept.sel(sample=sample)
    values = {name: one[name].values[()] for name in json.loads(swept.attrs["vary"])}
    settings = json.loads(swept.attrs["settings"]) | {"log": log}
    recipe = Recipe(
        model, json.loads(swept.attrs["duration"]), settings, swept.attrs["not_finite"]
    )
    runs = Runs(recipe)
    # The digest of a sweep is that of the model of its first sample.
    first = swept.isel(sample=0)
    if (
        digest(runs.check({name: first[name].values[()] for name in values}))
        != swept.attrs["model"]
    ):
        raise SimulationError(
            f"'{swept.attrs['diagram']}' has changed since the sweep: its equations, parameters or "
            "initial states are different"
        )
    return runs.run(values)


def _side_by_side(executor: str | Executor, workers: int | None) -> int:
    """Return the number of samples, or batches of samples, that run in parallel [-]."""
    if isinstance(executor, Executor):
        return workers or int(getattr(executor, "_max_workers", UNKNOWN_WORKERS))
    one_of("executor", executor, tuple(EXECUTORS))
    return 1 if executor == "serial" else workers or os.cpu_count() or 1
