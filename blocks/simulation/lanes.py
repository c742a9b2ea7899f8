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
from trussflow.blocks.simulation.executor import CompiledExecutor, Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.run import MIN_CHUNK, Run, next_chunk
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.simulation.step_size_warnings import MIN_CHECKED_SIZE
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.compiler import lanes

if TYPE_CHECKING:
    import xarray as xr

BATCH_NUMBERS = 500_000
"""Largest number of logged numbers of a batch of several groups of runs [-]; 4 MB, which caches hold."""


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
            # A fresh executor, as threads share this object.
            steps = _Steps(self._executor.fresh(), alone)
            times = alone.time_of(steps.logged)
            assert alone.log is not None
            shape = times.size, alone.log.width, count
            most = count * max(1, BATCH_NUMBERS // max(1, math.prod(shape)))
            waiting = np.arange(len(points.x))
            while waiting.size:
                batch, waiting = waiting[:most], waiting[most:]
                started = time.perf_counter()
                # Lanes without a run repeat the last run.
                padded = np.pad(batch, (0, -batch.size % count), "edge")
                number = padded.size // count
                # The lanes of an element follow one another.
                x, d, p = (
                    v[padded.reshape(number, count)].swapaxes(1, 2).reshape(number, -1)
                    for v in points
                )
                log = np.empty((number, *shape))
                good = np.ones((number, count), dtype=bool)
                again = ~good
                for g, group in enumerate(zip(x, d, p, log, strict=True)):
                    if (others := steps.take(*group)) is not None:
                        good[g], again[g] = False, others
                # A run alone warns of such a state if the steps are too long.
                large = np.abs(x) >= MIN_CHECKED_SIZE
                good &= ~large.reshape(number, -1, count).any(axis=1)
                with np.errstate(all="ignore"):
                    # The sum is finite only if all numbers are, and takes a third of the time of a test of each.
                    if not_finite != "ignore" and not np.isfinite(log.sum()):
                        good &= np.isfinite(log).all(axis=(1, 2))
                seconds = (time.perf_counter() - started) / batch.size
                lanes = np.flatnonzero(good.ravel()[: batch.size])
                yield LaneRuns(
                    simulator,
                    duration,
                    alone.log_step,
                    batch[lanes],
                    points.at(batch[lanes]),
                    times,
                    np.moveaxis(log, 0, 2),
                    lanes,
                    seconds,
                )
                waiting = np.append(waiting, batch[again.ravel()[: batch.size]])


class _Steps:
    """Takes all steps of one group of runs after the other.

    Parameters
    ----------
    executor : CompiledExecutor
        Executor of the groups.
    alone : Run
        Run with their settings.

    Attributes
    ----------
    logged : array of int
        Ticks that are logged [-].
    """

    def __init__(self, executor: CompiledExecutor, alone: Run) -> None:
        self._executor, self._prepared = executor, alone.prepared
        tick = self._prepared.tick
        self._last, self._every = int(alone.end / tick), int(alone.log_step / tick)
        self.logged = np.append(np.arange(0, self._last, self._every), self._last)
        self._chunk = MIN_CHUNK
        self._span = self._span_of(0, MIN_CHUNK)

    def _span_of(self, k: int, size: int) -> Span:
        """Return the span of `size` ticks from tick `k` [-]."""
        ticks = np.arange(k, k + size)
        logged = (ticks % self._every == 0) | (ticks == self._last)
        prepared = self._prepared
        due = prepared.schedule.due(k, size)
        return Span(
            prepared.solver.solver,
            prepared.tick,
            k,
            0,
            size,
            due,
            logged.view(np.uint8),
        )

    def take(
        self, x: Vector, d: Vector, p: Vector, log: Vector
    ) -> NDArray[np.bool_] | None:
        """Take the steps of a group in place, and fill its `log` [as declared].

        Returns
        -------
        array of bool or None
            If the run of a lane failed: other lanes, whose runs must begin again.
        """
        k = row = 0
        while k <= self._last:
            started = time.perf_counter()
            size = min(self._chunk, self._last + 1 - k)
            if (self._span.first, self._span.end) != (k, size):
                self._span = self._span_of(k, size)
            steps, fault, bad, _ = self._executor.advance(
                self._span, x, d, p, log[row:]
            )
            # The last instant is logged before a step that no one needs, and that may fail.
            if fault == "d" or (fault and k + steps < self._last):
                finite = np.isfinite(np.empty(0) if bad is None else bad)
                good: NDArray[np.bool_] = np.logical_and.reduce(
                    finite.reshape(-1, log.shape[-1])
                )
                # An unknown cause is one of all lanes.
                return ~good if good.all() else good
            row += int(np.count_nonzero(self._span.logged))
            k += size
            if size == self._chunk:
                self._chunk = next_chunk(size, started)
        return None


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
