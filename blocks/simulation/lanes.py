"""Batched runs on one core: each run is a lane of the vectors of compiled code."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trussflow.blocks.results.channels import Channel
from trussflow.blocks.results.dataset import dataset
from trussflow.blocks.results.log import Log
from trussflow.blocks.simulation.executor import CompiledExecutor, Progress
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.run import Run
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.compiler import lanes

if TYPE_CHECKING:
    import xarray as xr


def goes_in_lanes(prepared: Prepared) -> bool:
    """Return whether runs can be advanced in lanes: with fixed steps, and all equations compiled.

    Runs differ in the times of their events and in the iterations of their loops, and Python blocks compute
    one run at a time.
    """
    plan = prepared.plan
    alone = bool(plan.python_blocks or plan.has_events or plan.guesses.size)
    return (
        prepared.solver.is_fixed
        and prepared.traced.name == CompiledExecutor.name
        and not alone
    )


class Lanes:
    """Advances one run of a simulator in each lane, with the same numbers as a run alone.

    Parameters
    ----------
    simulator : Simulator
        Prepared diagram of the runs, accepted by `goes_in_lanes`.

    Attributes
    ----------
    count : int
        Number of runs [-].

    Raises
    ------
    CompilationError
        If it cannot be compiled.
    """

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator
        self.count = lanes()
        prepared = simulator.prepared
        self._executor = CompiledExecutor(prepared.programs, prepared.plan, self.count)

    def run(
        self,
        duration: float,
        each: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]],
        not_finite: str,
    ) -> Iterator[LaneRun | None]:
        """Run to the end, in groups of as many runs as there are lanes.

        Parameters
        ----------
        duration, not_finite
            As for `Simulator.run` [s, -].
        each : sequence of tuple of mapping
            Parameters and initial states of the runs [as declared].

        Yields
        ------
        LaneRun or None
            Each run, with the numbers of `Simulator.run`, bit for bit; None for a run that failed or logged a
            number that is not finite, which a run alone reports.
        """
        plan = self._simulator.prepared.plan
        with self._simulator.opened(duration) as alone:
            alone.executor = self._executor.fresh()  # threads share this object
            for first in range(0, len(each), self.count):
                group = each[first : first + self.count]
                points: dict[int, Point] = {}
                for lane, (parameters, initial) in enumerate(group):
                    with contextlib.suppress(Exception):
                        p = plan.parameters(parameters, alone.p)
                        points[lane] = (*plan.initial(p, initial), p)
                started = time.perf_counter()
                log, good = _advanced(alone, points, self.count)
                seconds = (time.perf_counter() - started) / len(group)
                for lane in range(len(group)):
                    if lane not in good:
                        yield None
                        continue
                    run = LaneRun(
                        self._simulator,
                        duration,
                        alone.log_step,
                        points[lane],
                        log,
                        lane,
                        seconds,
                    )
                    finite = not_finite == "ignore" or run.is_finite
                    yield run if finite else None


Point = tuple[Vector, Vector, Vector]
"""Continuous states, discrete values and parameters at the initial time [as declared]."""


def _advanced(
    alone: Run, points: Mapping[int, Point], count: int
) -> tuple[_LaneLog, set[int]]:
    """Return the log of runs from `points`, by lane, and the lanes that reach the end of the run `alone`."""
    log = _LaneLog(alone.prepared.channels, count)
    if not points:
        return log, set()
    # Lanes without a run repeat the first run, so that their numbers stay finite.
    filler = next(iter(points.values()))
    columns = [points.get(lane, filler) for lane in range(count)]
    x, d, p = (np.stack(arrays, axis=-1) for arrays in zip(*columns, strict=True))
    together = _RunsTogether(
        alone.prepared,
        alone.executor,
        x,
        d,
        p,
        log=log,
        log_step=alone.log_step,
        origin=alone.origin,
        good={*points},
    )
    try:
        together.advance(alone.end)
        together.finish()
    except _AllFailedError:
        return log, set()
    return log, together.good


class LaneRun(NamedTuple):
    """Complete run in one lane.

    Attributes
    ----------
    simulator : Simulator
        Simulator of the run.
    duration : float
        Duration [s].
    log_step : Fraction
        Time between logged instants [s].
    start : tuple of Vector
        States, discrete values and parameters at the initial time [as declared].
    log : Log
        Log of all lanes.
    lane : int
        Index of the lane [-].
    wall_time : float
        Wall time of the run [s].
    """

    simulator: Simulator
    duration: float
    log_step: Fraction
    start: Point
    log: _LaneLog
    lane: int
    wall_time: float

    @property
    def rows(self) -> list[Vector]:
        """Logged rows, in pieces [as declared]."""
        return [piece[:, :, self.lane] for piece in self.log.pieces]

    @property
    def is_finite(self) -> bool:
        """Whether all logged numbers are finite."""
        return all(np.isfinite(rows).all() for rows in self.rows)

    def signal(self, name: str) -> tuple[Vector, Vector]:
        """Return the times [s] and the values [as declared] of a logged signal."""
        channel = next(one for one in self.log.channels if one.name == name)
        return np.concatenate(self.log.times), channel.values(*self.rows)

    def dataset(self) -> xr.Dataset:
        """Return the result, as `Simulator.run` does."""
        _, attributes = self.simulator.identified(
            self.duration, self.log_step, self.start
        )
        attributes |= {"status": "complete", "wall_time": self.wall_time}
        times = np.concatenate(self.log.times)
        return dataset(self.log.channels, times, self.rows, attributes)


class _AllFailedError(Exception):
    """No run is left to be advanced."""


class _LaneLog(Log):
    """The log of several runs, whose rows have a last axis of lanes."""

    def __init__(self, channels: Sequence[Channel], count: int) -> None:
        super().__init__(channels, {})
        self._shape = self.width, count
        self.width *= count
        self.times: list[Vector] = []
        self.pieces: list[Vector] = []

    def reserve(self, number: int) -> Vector:
        self._rows = np.empty((number, *self._shape))
        return self._rows

    def keep(self, times: Vector | float, number: int = 1) -> None:
        """Keep the first reserved rows."""
        self.times.append(np.atleast_1d(times))
        self.pieces.append(self._rows[:number])


@dataclass(slots=True)
class _RunsTogether(Run):
    """Several runs as one whose arrays have a last axis of lanes; `good` are the lanes that go on."""

    good: set[int] = field(default_factory=set)

    def _failed(self, progress: Progress, k: int, is_logged: bool) -> None:
        """Remove the failed runs; the others repeat the step from tick `k` [-]."""
        if progress.bad is None:
            assert progress.error is not None
            raise progress.error
        self._remove(progress.bad.reshape(-1, self.x.shape[-1]))
        self.go_to(self.origin + k * self.prepared.tick)
        # If a state failed, the sampled blocks of this tick have computed already.
        self.sampled = k if progress.fault == "x" else None

    def _remove(self, bad: Vector) -> None:
        """Remove the runs with numbers in `bad` that are not finite."""
        finite = np.isfinite(bad).all(axis=0)
        self.good.difference_update(np.flatnonzero(~finite).tolist())
        if not self.good:
            raise _AllFailedError
        for array in (self.x, self.d, self.p):  # a copy of a good lane stays finite
            array[:, ~finite] = array[:, [np.argmax(finite)]]

    def finish(self) -> None:
        """Evaluate and log the instant of the end."""
        if number := self.due():
            updated = self.executor.instant(number, self.time, self.x, self.d, self.p)
            self._remove(updated)
            self.d[:] = updated
        self._log_now(self.time)
