"""Batched runs on one core: each run is a lane of the vectors of compiled code."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

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
    ) -> list[xr.Dataset | None]:
        """Run to the end.

        Parameters
        ----------
        duration, not_finite
            As for `Simulator.run` [s, -].
        each : sequence of tuple of mapping
            Parameters and initial states of at most so many runs as there are lanes [as declared].

        Returns
        -------
        list of xarray.Dataset or None
            Results of `Simulator.run`, bit for bit; None for a failed run, whose error comes from a run alone.
        """
        found: list[xr.Dataset | None] = [None] * len(each)
        with contextlib.ExitStack() as stack:
            runs: dict[int, Run] = {}
            for lane, (parameters, initial) in enumerate(each):
                with contextlib.suppress(Exception):
                    opened = self._simulator.opened(
                        duration,
                        parameters=parameters,
                        initial=initial,
                        not_finite=not_finite,
                    )
                    runs[lane] = stack.enter_context(opened)
            if runs:
                with contextlib.suppress(_AllFailedError):
                    self._advance(runs)
            for lane, run in runs.items():
                with contextlib.suppress(Exception):
                    found[lane] = run.to_end()
        return found

    def _advance(self, runs: dict[int, Run]) -> None:
        """Advance all runs to just before the instant of their end; failed ones are removed from `runs`."""
        started = time.perf_counter()
        number = len(runs)
        first = next(iter(runs.values()))
        # Lanes without a run repeat the first run, so that their numbers stay finite.
        columns = [runs.get(lane, first) for lane in range(self.count)]
        x, d, p = (
            np.stack([getattr(run, name) for run in columns], axis=-1) for name in "xdp"
        )
        together = _RunsTogether(
            first.prepared,
            self._executor.fresh(),
            x,
            d,
            p,
            log=_LogOfEach(runs, self.count),
            log_step=first.log_step,
            origin=first.origin,
            runs=runs,
        )
        together.advance(first.end)
        for lane, run in runs.items():
            run.x[:] = x[:, lane]
            run.d[:] = d[:, lane]
            run.go_to(first.end)
            run.seconds = (time.perf_counter() - started) / number


class _AllFailedError(Exception):
    """No run is left to be advanced."""


class _LogOfEach(Log):
    """The logs of several runs, whose rows have a last axis of lanes."""

    def __init__(self, runs: dict[int, Run], count: int) -> None:
        super().__init__([], {})
        self._runs = runs
        self._count = count
        # All runs log the same channels, so there is one width.
        (self._row_width,) = {
            run.log.width for run in runs.values() if run.log is not None
        }
        self.width = self._row_width * count

    def reserve(self, number: int) -> Vector:
        self._rows = np.empty((number, self._row_width, self._count))
        return self._rows

    def keep(self, times: Vector | float, number: int = 1) -> None:
        """Keep the first reserved rows in the log of each run; a run whose log raises is removed."""
        for lane, run in [*self._runs.items()]:
            assert run.log is not None
            try:
                run.log.reserve(number)[:] = self._rows[:number, :, lane]
                run.log.keep(times, number)
            except Exception:  # noqa: BLE001 - alone, the run reports it
                del self._runs[lane]
        if not self._runs:
            raise _AllFailedError


@dataclass(slots=True)
class _RunsTogether(Run):
    """Several `runs`, by lane, as one whose arrays have a last axis of lanes."""

    runs: dict[int, Run] = field(default_factory=dict)

    def _failed(self, progress: Progress, k: int, is_logged: bool) -> None:
        """Remove the failed runs; the others repeat the step from tick `k` [-]."""
        if progress.bad is None:
            assert progress.error is not None
            raise progress.error
        good = np.isfinite(progress.bad.reshape(-1, self.x.shape[-1])).all(axis=0)
        for lane in np.flatnonzero(~good).tolist():
            self.runs.pop(lane, None)
            for array in (self.x, self.d, self.p):  # a copy of a good lane stays finite
                array[:, lane] = array[:, np.argmax(good)]
        if not self.runs:
            raise _AllFailedError
        self.go_to(self.origin + k * self.prepared.tick)
        # If a state failed, the sampled blocks of this tick have computed already.
        self.sampled = k if progress.fault == "x" else None
