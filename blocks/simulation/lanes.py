"""Batched runs on one core: each run is a lane of the vectors of compiled code."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.results.dataset import dataset
from trussflow.blocks.simulation.executor import CompiledExecutor, Groups, Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.run import MIN_CHUNK, next_chunk
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.simulation.step_size_warnings import MIN_CHECKED_SIZE
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.compiler import lanes

if TYPE_CHECKING:
    import xarray as xr

BATCH_NUMBERS = 500_000
"""Largest number of logged numbers of a batch with more than one group [-]; 4 MB, which caches hold."""

BAD_STATE, BAD_VALUE = 1, 2
"""Faults of a step: states, or discrete values, that are not finite, as in ``events.h``."""


class Points(NamedTuple):
    """States `x`, discrete values `d` and parameters `p` of runs at the initial time.

    The first axis is that of the runs [as declared].
    """

    x: Vector
    d: Vector
    p: Vector

    def at(self, places: Any) -> Points:
        """Return those of the runs at these `places` [-]."""
        return Points(*(values[places] for values in self))


def most_lanes(prepared: Prepared) -> int:
    """Return the number of lanes of batched runs [-]; 0 if runs must go alone.

    Batches need fixed steps, and all equations compiled: Python blocks compute one run at a time. Runs with
    events or iterated loops have one lane, as they differ in the times of events and in iterations.
    """
    plan = prepared.plan
    compiled = prepared.traced.name == CompiledExecutor.name
    if not prepared.solver.is_fixed or not compiled or plan.python_blocks:
        return 0
    return 1 if plan.has_events or plan.guesses.size else lanes()


class Lanes:
    """Advances one run of a simulator in each lane, with the same numbers as a run alone.

    Parameters
    ----------
    simulator : Simulator
        Prepared diagram of the runs, with `most_lanes`.
    count : int
        Number of lanes [-].

    Raises
    ------
    CompilationError
        If it cannot be compiled.
    """

    def __init__(self, simulator: Simulator, count: int) -> None:
        self._simulator = simulator
        self.count = count
        prepared = simulator.prepared
        self._executor = CompiledExecutor(prepared.programs, prepared.plan, count)

    def run(
        self, duration: float, points: Points, not_finite: str
    ) -> Iterator[LaneRuns]:
        """Run to the end, in batches of groups of as many runs as there are lanes.

        Parameters
        ----------
        duration, not_finite
            As for `Simulator.run` [s, -].
        points : Points
            Initial points of the runs.

        Yields
        ------
        LaneRuns
            Runs with the numbers of `Simulator.run`, bit for bit. Those that failed, or logged a number that is
            not finite, are in none: a run alone reports the error.
        """
        simulator, count = self._simulator, self.count
        with simulator.opened(duration) as alone:
            executor = self._executor.fresh()  # threads share this object
            tick = alone.prepared.tick
            steps, every = int(alone.end / tick), int(alone.log_step / tick)
            times = alone.time_of(np.append(np.arange(0, steps, every), steps))
            assert alone.log is not None
            shape = times.size, alone.log.width, count
            most = count * max(1, BATCH_NUMBERS // max(1, math.prod(shape)))
            waiting = np.arange(len(points.x))
            while waiting.size:
                batch, waiting = waiting[:most], waiting[most:]
                started = time.perf_counter()
                # Lanes without a run repeat the last run.
                places = np.pad(batch, (0, -batch.size % count), "edge")
                groups = _groups(points, places.reshape(-1, count), shape)
                _advance(executor, groups, alone.prepared, steps, every)
                bad = _bad_lanes(groups, not_finite)
                failed = groups.faults[:, np.newaxis] != 0
                lanes = np.flatnonzero(~(bad | failed).ravel()[: batch.size])
                seconds = (time.perf_counter() - started) / batch.size
                yield LaneRuns(
                    simulator,
                    duration,
                    alone.log_step,
                    batch[lanes],
                    points.at(batch[lanes]),
                    times,
                    np.moveaxis(groups.log, 0, 2),
                    lanes,
                    seconds,
                )
                # Runs that shared a group with a failed one begin again.
                again = batch[(failed & ~bad).ravel()[: batch.size]]
                waiting = np.concatenate([waiting, again])


def _groups(points: Points, places: NDArray[np.intp], shape: tuple[int, ...]) -> Groups:
    """Return the arrays of the runs at `places` [-] of `points`, with logs of a `shape` for each group."""
    x, d, p = (np.ascontiguousarray(np.moveaxis(v[places], 1, 2)) for v in points)
    number, _, lanes = x.shape
    return Groups(
        x,
        d,
        p,
        np.empty((number, *shape)),
        np.zeros(number, np.int32),
        np.empty((number, 1 + max(x.shape[1], d.shape[1]), lanes)),
        np.zeros(number, np.int64),
    )


def _advance(
    executor: CompiledExecutor,
    groups: Groups,
    prepared: Prepared,
    steps: int,
    every: int,
) -> None:
    """Take all `steps` [-] in place, and log `every` so many of them, and the last instant."""
    chunk, k, row, size = MIN_CHUNK, 0, 0, 0
    while k <= steps and not groups.faults.all():
        started = time.perf_counter()
        size = min(chunk, steps + 1 - k)
        logged = np.zeros(size, dtype=np.uint8)
        # -k % every is the distance to the next multiple of `every`.
        logged[-k % every :: every] = 1
        logged[steps - k :] = 1
        due = prepared.schedule.due(k, size)
        solver = prepared.solver.solver
        span = Span(solver, prepared.tick, k, 0, size, due, logged)
        groups.taken.fill(-1)
        executor.advance_groups(span, groups._replace(log=groups.log[:, row:]))
        row += int(np.count_nonzero(logged))
        k += size
        chunk = next_chunk(chunk, started)
    # The last instant is logged before a step that no one needs, and that may fail.
    useless = (groups.faults != BAD_VALUE) & (groups.taken == size - 1) & (k > steps)
    groups.faults[useless] = 0


def _bad_lanes(groups: Groups, not_finite: str) -> NDArray[np.bool_]:
    """Return the lanes of each group that failed, or logged numbers that are not finite."""
    log = groups.log
    bad = np.zeros((len(log), log.shape[-1]), dtype=bool)
    with np.errstate(all="ignore"):
        # The sum is finite only if all numbers are, and takes a third of the time of a test of each.
        if not_finite != "ignore" and not np.isfinite(log.sum()):
            bad |= ~np.isfinite(log).all(axis=(1, 2))
    sizes = {BAD_STATE: groups.x.shape[1], BAD_VALUE: groups.d.shape[1]}
    for g in np.flatnonzero(groups.faults):
        size = sizes.get(int(groups.faults[g]), 0)
        # The log ends at the fault. An unknown cause is one of all lanes.
        finite = np.isfinite(groups.bad[g, :size]).all(axis=0)
        bad[g] = ~finite | finite.all()
    # A run alone warns of such a state if the steps are too long.
    return bad | (np.abs(groups.x) >= MIN_CHECKED_SIZE).any(axis=1)


class LaneRuns(NamedTuple):
    """Complete runs of a batch.

    Attributes
    ----------
    simulator : Simulator
        Simulator of the runs.
    duration : float
        Duration [s].
    log_step : Fraction
        Time between logged instants [s].
    runs : array of int
        Indices of the runs among all [-].
    start : Points
        Initial points of the runs.
    times : Vector
        Logged instants [s].
    rows : Vector
        Logged rows: axes of times, numbers in a row, groups and lanes [as declared].
    lanes : array of int
        Index of each run in the last two axes [-].
    wall_time : float
        Wall time of one run [s].
    """

    simulator: Simulator
    duration: float
    log_step: Fraction
    runs: NDArray[np.intp]
    start: Points
    times: Vector
    rows: Vector
    lanes: NDArray[np.intp]
    wall_time: float

    def reduced(
        self, output: str, function: Callable[[Vector, Vector], Vector]
    ) -> Vector:
        """Return a `function` of the times [s] and values [as declared] of the signal `output`, for each run."""
        channels = self.simulator.prepared.channels
        channel = next(one for one in channels if one.name == output)
        elements, rows = channel.port.elements(), self.rows[:, channel.columns]
        if not np.array_equal(elements.ravel(), np.arange(rows.shape[1])):
            rows = rows[:, elements.ravel()]
        lanes = rows.shape[2:]
        with np.errstate(all="ignore"):  # rows of failed groups were never written
            found = function(self.times, rows.reshape(-1, *elements.shape, *lanes))
        return np.moveaxis(found.reshape(*elements.shape, -1)[..., self.lanes], -1, 0)

    def dataset(self, k: int) -> xr.Dataset:
        """Return the result of run `k` of these, as `Simulator.run` does."""
        _, attributes = self.simulator.identified(
            self.duration, self.log_step, self.start.at(k)
        )
        attributes |= {"status": "complete", "wall_time": self.wall_time}
        rows = self.rows[:, :, *divmod(self.lanes[k], self.rows.shape[-1])]
        return dataset(self.simulator.prepared.channels, self.times, [rows], attributes)
