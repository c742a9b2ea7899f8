"""Advancing a prepared diagram: instants, and integration between them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.errors import DivergenceError, SimulationError, TrussflowError
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.adaptive import AdaptiveError, integrate
from trussflow.blocks.simulation.executor import Progress, Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.progress import ProgressBar
from trussflow.blocks.simulation.results import Log

CHUNK_SECONDS = 0.1
"""Wall time [s] between two looks at the keyboard and the progress bar."""

CHUNK_NUMBERS = 2_000_000
"""Logged numbers between two such looks at most; 16 MB."""


@dataclass(slots=True)
class Run:
    """State of one run, or of a session: both are advanced by this code alone.

    A run stands before the instant of its present time: what is sampled then computes when it
    is advanced from there, or finished.

    Attributes
    ----------
    prepared : Preparation
        What it has in common with other runs.
    x, d, p : Vector
        Continuous states, what changes at instants, parameters.
    log : Log or None
        Takes the logged rows.
    log_step : Fraction
        Time between logged instants [s].
    now : Fraction
        Time reached [s].
    origin : Fraction
        Time at which it began, from which instants are counted [s].
    time : float
        Last good time [s].
    sampled : Fraction or None
        Time at which what is sampled has computed already, before time went on [s].
    """

    prepared: Prepared
    x: Vector
    d: Vector
    p: Vector
    log: Log | None = None
    log_step: Fraction = field(default=Fraction(1))
    now: Fraction = field(default=Fraction(0))
    origin: Fraction = field(default=Fraction(0))
    time: float = field(default=0.0)
    sampled: Fraction | None = field(default=None)

    def sample(self) -> None:
        """Let what is sampled at the present time compute now; `advance` does not do it again."""
        self._instant(self.due(), self.time)
        self.sampled = self.now

    def advance(self, until: Fraction, bar: ProgressBar | None = None) -> None:
        """Run on, from the instant of the present time to just before that of `until` [s].

        Raises
        ------
        DivergenceError
            If the solver gives up, or a state or sampled value stops being finite.
        """
        (self._fixed if self.prepared.is_fixed else self._adaptive)(until, bar)

    def before_jump(self) -> None:
        """Must be called before d or p changes; what is set at the very start is no jump."""
        if self.now != self.origin:
            self.prepared.executor.before_jump(float(self.now), self.x, self.d, self.p)

    def finish(self) -> None:
        """Let the blocks that are sampled at the present time compute, and log."""
        self._instant(self.due(), self.time)
        self._log_now(self.time)

    def _fixed(self, until: Fraction, bar: ProgressBar | None) -> None:
        """Advance with steps from tick to tick; those from or to a time in between are shorter."""
        prepared = self.prepared
        tick = prepared.tick
        if self.now % tick:
            self._part(min(until, (self.now // tick + 1) * tick))
        k, last, chunk = int(self.now // tick), int(until // tick), 16
        first = prepared.ticks(self.origin, "the start time")
        every = prepared.ticks(self.log_step, "log_step") if self.log is not None else 0
        width = 0 if self.log is None else self.log.width
        longest = max(16, CHUNK_NUMBERS * every // max(1, width)) if every else last
        while k < last:
            due = prepared.schedule.due(k - first, min(chunk, last - k))
            if self.sampled == k * tick:
                due[0] = 0
            if prepared.units.due(int(due[0])):
                self._instant(int(due[0]), float(k * tick))
                due[0] = 0
            due = due[: prepared.units.next_due(due)]
            logged = np.zeros(len(due), dtype=np.uint8)
            if every:
                logged[-k % every :: every] = 1
            rows = np.empty((np.count_nonzero(logged), width))
            started = time.perf_counter()
            span = Span(prepared.solver, tick, k, due, logged)
            progress = prepared.executor.advance(span, self.x, self.d, self.p, rows)
            elapsed = time.perf_counter() - started
            self.stop_if_diverged(progress, k, logged, rows)
            if self.log is not None:
                self.log.append(_times(k, logged, tick), rows)
            k += len(due)
            self.now = k * tick
            self.time = float(self.now)
            if bar is not None:
                bar.update(float(len(due) * tick))
            factor = min(4.0, CHUNK_SECONDS / max(elapsed, 1e-9))
            chunk = min(max(16, int(len(due) * factor)), longest)
        if self.now < until:
            self._instant(self.due(), float(self.now))
            self._part(until)

    def _part(self, end: Fraction) -> None:
        """Take a step that is shorter than a tick."""
        if end == self.now:
            return
        prepared, times = self.prepared, (float(self.now), float(end), float(end - self.now))
        state = prepared.executor.between(prepared.solver, times, self.x, self.d, self.p)
        if not np.isfinite(state).all():
            raise self._divergence("x", state, times[1])
        self.x[:] = state
        self.now, self.time = end, times[1]

    def stop_if_diverged(
        self, progress: Progress, first: int, logged: NDArray[np.uint8], rows: Vector
    ) -> None:
        """Keep what was logged and say what went wrong."""
        if not progress.fault or progress.bad is None:
            return
        tick, stop = self.prepared.tick, first + progress.steps
        times = _times(first, logged[: progress.steps + (progress.fault == "x")], tick)
        if self.log is not None:
            self.log.append(times, rows[: len(times)])
        self.time = float(stop * tick)
        after = float((stop + 1) * tick) if progress.fault == "x" else self.time
        raise self._divergence(progress.fault, progress.bad, after)

    def _divergence(self, fault: str, bad: Vector, after: float) -> DivergenceError:
        plan = self.prepared.plan
        layouts = (
            [(plan.x, bad)]
            if fault == "x"
            else [(plan.held, bad[plan.memory.size : plan.u_start]), (plan.memory, bad[: plan.memory.size])]
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
        self.before_jump()
        updated = prepared.units.instant(number, prepared.executor, t, self.x, self.d, self.p)
        if not np.isfinite(updated).all():
            raise self._divergence("d", updated, t)
        self.d[:] = updated

    def _log_now(self, t: float) -> None:
        if self.log is None:
            return
        row = self.prepared.executor.call("outputs", t, self.x, self.d, self.p)
        self.log.append(np.array([t]), row.reshape(1, -1))

    # -- adaptive -------------------------------------------------------------------------

    def _adaptive(self, until: Fraction, bar: ProgressBar | None) -> None:
        """Advance with an adaptive solver, which starts afresh at each instant."""
        every = self.log_step
        for end in list(self._events(until)):
            start = self.now
            self._instant(self.due(), float(start))
            if start % every == 0:
                self._log_now(float(start))
            first, stop = start // every + 1, -(-end // every)  # log instants strictly inside
            times = (float(i * every) for i in range(first, stop if self.log is not None else first))
            try:
                for t, x in self._integrate((float(start), float(end)), times):
                    self.x[:] = x
                    if bar is not None:
                        bar.update(t - self.time)
                    self.time = t
                    if t < float(end):
                        self._log_now(t)
            except AdaptiveError as error:
                raise self._gave_up(error) from error
            self.now = end

    def _integrate(self, span: tuple[float, float], times: Iterator[float]) -> Iterator[tuple[float, Vector]]:
        prepared, d, p = self.prepared, self.d, self.p

        # A signal that jumps where the span ends has not jumped yet for a stage at the end.
        last = float(np.nextafter(span[1], span[0]))

        def derivative(t: float, x: Vector) -> Vector:
            return prepared.executor.call("derivative", min(t, last), np.ascontiguousarray(x), d, p)

        def exact_jacobian(t: float, x: Vector) -> Vector:
            return prepared.jacobian(min(t, last), x, d, p)

        return integrate(
            prepared.solver,
            derivative,
            exact_jacobian if prepared.has_jacobian else None,
            span,
            times,
            self.x,
            prepared.tolerances,
            prepared.executor.watch(d, p),
        )

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

    def due(self) -> int:
        """Return the number of the set of clocks that ticks at the present time; 0 for none."""
        number = (self.now - self.origin) / self.prepared.tick
        if number.denominator != 1 or self.now == self.sampled:
            return 0
        return int(self.prepared.schedule.due(int(number), 1)[0])

    def _events(self, until: Fraction) -> Iterator[Fraction]:
        """Return the instants from now on at which the solver must stop, the end included."""
        blocks = self.prepared.plan.system.blocks.values()
        breaks = {b for block in blocks for b in _breakpoints(block)}
        now = self.now
        pending = sorted(b for b in breaks if now < b < until)
        clocks = [(self.origin + c.offset, c.period) for c in self.prepared.plan.system.clocks]
        while now < until:
            following = [
                first if now < first else first + ((now - first) // period + 1) * period
                for first, period in clocks
            ]
            now = min([until, *following, *pending[:1]])
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
