"""One run of a prepared diagram: instants, and integration between them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.adaptive import AdaptiveError, integrate
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact, ticks
from trussflow.blocks.framework.errors import DivergenceError, SimulationError, TrussflowError
from trussflow.blocks.framework.executor import Executor, Progress, Span
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.plan import Plan
from trussflow.blocks.framework.progress import ProgressBar
from trussflow.blocks.framework.python_units import PythonUnits
from trussflow.blocks.framework.results import Log
from trussflow.blocks.framework.schedule import Schedule
from trussflow.blocks.framework.types import Vector

CHUNK_SECONDS = 0.1
"""Wall time [s] between two looks at the keyboard and the progress bar."""

CHUNK_NUMBERS = 2_000_000
"""Logged numbers between two such looks at most; 16 MB."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """What all runs of one simulator share."""

    plan: Plan
    executor: Executor
    schedule: Schedule
    units: PythonUnits
    solver: str
    tick: Fraction
    log_step: Fraction | None
    tolerances: tuple[float, float]
    jacobian: Callable[[float, Vector, Vector, Vector], Vector] | None = None


@dataclass(slots=True)
class Run:
    """State of one run.

    Attributes
    ----------
    x, d, p : Vector
        Continuous states, what changes at instants, parameters.
    log : Log
        Takes the logged rows.
    duration : Fraction
        End time [s].
    time : float
        Last good time [s].
    """

    prepared: Prepared
    x: Vector
    d: Vector
    p: Vector
    log: Log
    duration: Fraction
    time: float = field(default=0.0)

    def fixed(self, bar: ProgressBar) -> None:
        """Run with fixed steps of one tick each.

        Raises
        ------
        DivergenceError
            If a state or sampled value stops being finite.
        """
        prepared = self.prepared
        tick = prepared.tick
        last = ticks(self.duration, tick, "the duration")
        every = ticks(prepared.log_step or tick, tick, "log_step")
        k, chunk = 0, 16
        longest = max(16, CHUNK_NUMBERS * every // max(1, self.log.width))
        while k < last:
            due = prepared.schedule.due(k, min(chunk, last - k))
            if prepared.units.due(int(due[0])):
                self._instant(int(due[0]), float(k * tick))
                due[0] = 0
            due = due[: prepared.units.next_due(due)]
            logged = np.zeros(len(due), dtype=np.uint8)
            logged[-k % every :: every] = 1
            rows = np.empty((np.count_nonzero(logged), self.log.width))
            started = time.perf_counter()
            span = Span(prepared.solver, tick, k, due, logged)
            progress = prepared.executor.advance(span, self.x, self.d, self.p, rows)
            elapsed = time.perf_counter() - started
            self._stop_if_diverged(progress, k, logged, rows)
            self.log.append(_times(k, logged, tick), rows)
            k += len(due)
            self.time = float(k * tick)
            bar.update(float(len(due) * tick))
            factor = min(4.0, CHUNK_SECONDS / max(elapsed, 1e-9))
            chunk = min(max(16, int(len(due) * factor)), longest)
        self._instant(int(prepared.schedule.due(last, 1)[0]), self.time)
        self._log_now(self.time)

    def _stop_if_diverged(
        self, progress: Progress, first: int, logged: NDArray[np.uint8], rows: Vector
    ) -> None:
        """Keep what was logged and say what went wrong."""
        if not progress.fault or progress.bad is None:
            return
        tick, stop = self.prepared.tick, first + progress.steps
        times = _times(first, logged[: progress.steps + (progress.fault == "x")], tick)
        self.log.append(times, rows[: len(times)])
        self.time = float(stop * tick)
        after = float((stop + 1) * tick) if progress.fault == "x" else self.time
        raise self._divergence(progress.fault, progress.bad, after)

    def _divergence(self, fault: str, bad: Vector, after: float) -> DivergenceError:
        plan = self.prepared.plan
        layouts = (
            [(plan.x, bad)]
            if fault == "x"
            else [
                (plan.held, bad[plan.memory.size : plan.u_start]),
                (plan.memory, bad[: plan.memory.size]),
            ]
        )  # held outputs first: they may be the cause of a bad update, never the other way round
        cause = self._cause(after) if fault == "x" else ""
        return DivergenceError(
            f"{_fault(layouts)} stopped being finite at t = {after:g} s{cause}; the last good step "
            f"is at t = {self.time:g} s and the log up to there is kept. Try a smaller step, a "
            "stiff solver (LSODA, BDF), or look for a division by zero in that block"
        )

    def _cause(self, after: float) -> str:
        """Name the first signal that is not finite during the step, if there is one."""
        plan = self.prepared.plan
        for t in (self.time, (self.time + after) / 2, after):
            with np.errstate(all="ignore"), contextlib.suppress(TrussflowError):
                evaluation = plan.evaluate(t, self.x, self.d, self.p)
                for port in plan.order(frozenset()):
                    if not np.isfinite(evaluation.output(port)).all():
                        return f", because '{port.path}' did"
        return ""

    def _instant(self, number: int, t: float) -> None:
        """Let the sampled blocks of one instant compute."""
        if not number:
            return
        prepared = self.prepared
        updated = prepared.units.instant(number, prepared.executor, t, self.x, self.d, self.p)
        if not np.isfinite(updated).all():
            raise self._divergence("d", updated, t)
        self.d[:] = updated

    def _log_now(self, t: float) -> None:
        row = self.prepared.executor.call("outputs", t, self.x, self.d, self.p)
        self.log.append(np.array([t]), row.reshape(1, -1))

    # -- adaptive -------------------------------------------------------------------------

    def adaptive(self, bar: ProgressBar) -> None:
        """Run with an adaptive solver, which starts afresh at each instant.

        Raises
        ------
        DivergenceError
            If the solver gives up, or a state or sampled value stops being finite.
        """
        prepared = self.prepared
        every = prepared.log_step or self.duration / 1000
        start = Fraction(0)
        for end in self._events():
            self._instant(self._due(start), float(start))
            if start % every == 0:
                self._log_now(float(start))
            first, stop = start // every + 1, -(-end // every)  # log instants strictly inside
            times = (float(i * every) for i in range(first, stop))
            try:
                for t, x in self._integrate((float(start), float(end)), times):
                    self.x[:] = x
                    bar.update(t - self.time)
                    self.time = t
                    if t < float(end):
                        self._log_now(t)
            except AdaptiveError as error:
                raise self._gave_up(error) from error
            start = end
        self._instant(self._due(start), self.time)
        self._log_now(self.time)

    def _integrate(
        self, span: tuple[float, float], times: Iterator[float]
    ) -> Iterator[tuple[float, Vector]]:
        prepared, d, p = self.prepared, self.d, self.p
        jacobian = prepared.jacobian

        # A signal that jumps where the span ends has not jumped yet for a stage at the end.
        last = float(np.nextafter(span[1], span[0]))

        def derivative(t: float, x: Vector) -> Vector:
            return prepared.executor.call("derivative", min(t, last), np.ascontiguousarray(x), d, p)

        def exact_jacobian(t: float, x: Vector) -> Vector:
            assert jacobian is not None
            return jacobian(min(t, last), x, d, p)

        return integrate(
            prepared.solver, derivative, None if jacobian is None else exact_jacobian,
            span, times, self.x, prepared.tolerances,
        )  # fmt: skip

    def _gave_up(self, error: AdaptiveError) -> DivergenceError:
        """Name the state that changes fastest, relative to its size, where the solver gave up."""
        plan = self.prepared.plan
        rate = self.prepared.executor.call("derivative", error.t, error.x, self.d, self.p)
        if not np.isfinite(rate).all():
            fault = f"the derivative of {_fault([(plan.x, rate)])} is not finite"
        else:
            worst = int(np.argmax(np.abs(rate) / (1e-12 + np.abs(error.x))))
            entry = next(e for e in plan.x if e.start <= worst < e.stop)
            fault = f"the fastest state is {entry.describe(worst - entry.start)}"
        return DivergenceError(
            f"solver {self.prepared.solver} gave up after t = {error.t:g} s: {error}; {fault}. "
            "The log up to there is kept. Try a stiff solver, or larger tolerances"
        )

    def _due(self, instant: Fraction) -> int:
        number = instant / self.prepared.tick
        if number.denominator != 1:
            return 0
        return int(self.prepared.schedule.due(int(number), 1)[0])

    def _events(self) -> Iterator[Fraction]:
        """Return the instants after 0 at which the solver must stop, the end included."""
        blocks = self.prepared.plan.system.blocks.values()
        breaks = {b for block in blocks for b in _breakpoints(block)}
        pending = sorted(b for b in breaks if 0 < b < self.duration)
        clocks = self.prepared.plan.system.clocks
        now = Fraction(0)
        while now < self.duration:
            following = [
                c.offset
                if now < c.offset
                else c.offset + ((now - c.offset) // c.period + 1) * c.period
                for c in clocks
            ]
            now = min([self.duration, *following, *pending[:1]])
            pending = [b for b in pending if b > now]
            yield now


def _times(first: int, logged: NDArray[np.uint8], tick: Fraction) -> Vector:
    """Return the times of the logged steps."""
    steps = (first + np.flatnonzero(logged)).astype(np.float64)
    return np.asarray(steps * float(tick.numerator) / float(tick.denominator))


def _breakpoints(block: Block) -> list[Fraction]:
    """Return the break points of a block.

    Raises
    ------
    SimulationError
        If they are no times.
    """
    points = block.breakpoints()
    try:
        return [exact(point) for point in points]
    except (TypeError, ValueError, OverflowError):
        raise SimulationError(
            f"breakpoints() of block '{block.path}' returned {points}; times must be finite numbers"
        ) from None


def _fault(layouts: list[tuple[Layout, Vector]]) -> str:
    """Name the first element that is not finite."""
    return next(filter(None, (layout.fault(flat) for layout, flat in layouts)))
