"""Runs side by side: each is a lane of the vectors that compiled code computes with, on one core."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.blocks.simulation.executor import CompiledExecutor, Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.progress import paced
from trussflow.blocks.simulation.run import longest_chunk
from trussflow.blocks.simulation.simulator import Begun, Simulator
from trussflow.blocks.tracing.compiler import lanes

if TYPE_CHECKING:
    import xarray as xr


def goes_in_lanes(prepared: Prepared) -> bool:
    """Tell whether runs can be advanced side by side: by fixed steps alone, all of it compiled.

    Events happen in each run at another time, the solutions of loops take other numbers of iterations, and
    Python blocks compute one run at a time.
    """
    plan = prepared.plan
    alone = bool(plan.python_blocks or plan.has_events or plan.guesses.size)
    return prepared.solver.is_fixed and prepared.traced.name == CompiledExecutor.name and not alone


class Lanes:
    """Advances as many runs of a simulator at once as there are lanes, with the numbers of each alone.

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
        self._simulator, self.count = simulator, lanes()
        prepared = simulator.prepared
        self._executor = CompiledExecutor(prepared.programs, prepared.plan, self.count)

    def run(
        self, duration: float, each: Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]], not_finite: str
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
            What `Simulator.run` returns, bit for bit; None where it raises: alone, a run says best why.
        """
        found: list[xr.Dataset | None] = [None] * len(each)
        with contextlib.ExitStack() as stack:
            begun: dict[int, Begun] = {}
            for lane, (parameters, initial) in enumerate(each):
                with contextlib.suppress(Exception):
                    opened = self._simulator.begun(duration, parameters, initial, not_finite=not_finite)
                    begun[lane] = stack.enter_context(opened)
            if begun:
                self._advance(begun)
            for lane, one in begun.items():
                with contextlib.suppress(Exception):
                    found[lane] = one.to_end()
        return found

    def _advance(self, begun: dict[int, Begun]) -> None:
        """Advance all to their end but for its instant; those that cannot go on are taken out of `begun`."""
        started, number, executor = time.perf_counter(), len(begun), self._executor.fresh()
        first = next(iter(begun.values()))
        run, prepared = first.run, first.run.prepared
        tick, every = prepared.tick, prepared.ticks(run.log_step, "log_step")
        columns = [begun.get(lane, first).run for lane in range(self.count)]
        x, d, p = (np.stack([getattr(one, name) for one in columns], axis=-1) for name in "xdp")
        k, last, chunk, sampled = 0, int((first.end - run.origin) // tick), 16, False
        longest = longest_chunk(every, first.log.width * self.count)
        while k < last and begun:
            length = min(chunk, last - k)
            due, logged = prepared.schedule.due(k, length), np.zeros(length, dtype=np.uint8)
            logged[-k % every :: every] = 1
            if sampled:
                due[0] = 0
            rows = np.empty((int(logged.sum()), first.log.width, self.count))
            span = Span(prepared.solver.solver, tick, run.first + k, 0, length, due, logged)
            asked = time.perf_counter()
            progress = executor.advance(span, x, d, p, rows)
            steps = int(progress.steps)
            ticks = k + np.flatnonzero(logged[:steps])
            times = (run.first + ticks) * tick.numerator / tick.denominator
            for lane, one in [*begun.items()]:
                if not _kept(one, times, rows[: times.size, :, lane]):
                    del begun[lane]
            # What was sampled before a step that failed is not sampled again by those that go on.
            k, sampled = k + steps, progress.fault == "x"
            if progress.fault:
                assert progress.bad is not None
                good = np.isfinite(progress.bad.reshape(-1, self.count)).all(axis=0)
                for lane in np.flatnonzero(~good).tolist():
                    begun.pop(lane, None)
                    for array in (x, d, p):  # it goes on as another one, so that it stays finite
                        array[:, lane] = array[:, np.argmax(good)]
            elif length == chunk:
                chunk = paced(chunk, time.perf_counter() - asked, longest)
        for lane, one in begun.items():
            one.run.x[:], one.run.d[:] = x[:, lane], d[:, lane]
            one.run.go_to(first.end)
            one.seconds = (time.perf_counter() - started) / number


def _kept(one: Begun, times: Array, rows: Array) -> bool:
    """Log `rows` [as declared] of `times` [s]; False if the log ends the run."""
    with contextlib.suppress(Exception):
        one.log.reserve(len(rows))[:] = rows
        if len(rows):
            one.log.keep(times, len(rows))
        return True
    return False
