"""One run of a prepared diagram: instants, and integration between them.

At an instant, and from there to the next one::

    located and time events at t are handled          x jumps
    the sampled blocks due at t compute together       d jumps: Python blocks in the order in which
                                                       they need each other, then the traced ones
    the signals of t are logged
    events that the jump of d causes are handled       x jumps
    x is integrated to the next instant, d held        events on the way: x jumps
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import lcm
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from trussflow.blocks.errors import DivergenceError, SimulationError, TrussflowError
from trussflow.blocks.framework.clock import ticks, written
from trussflow.blocks.results.log import Log
from trussflow.blocks.results.state_file import Snapshot
from trussflow.blocks.simulation.adaptive import (
    AUTOMATIC_START,
    AdaptiveError,
    Control,
    VariableSpan,
)
from trussflow.blocks.simulation.executor import (
    CHUNK_SECONDS,
    Executor,
    NumPyExecutor,
    Progress,
    Span,
)
from trussflow.blocks.simulation.pacing import PACED_SECONDS, Pacer
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.step_size_warnings import (
    breakpoints_of,
    warn_of_coarse_steps,
)
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.progress import RunBar
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.quantities import derivative
from trussflow.blocks.tracing.tableaus import METHODS as TABLEAUS

if TYPE_CHECKING:
    import xarray as xr

CHUNK_NUMBERS = 500_000
"""Maximum number of logged numbers between two checks for Ctrl-C; 4 MB."""

MIN_CHUNK = 16
"""Minimum number of ticks between two checks for Ctrl-C [-]."""

MAX_CHUNK_GROWTH = 4.0
"""Maximum growth of the number of ticks from one check to the next [-]."""

WINDOW_TICKS = 1024
"""Number of ticks in a window, whose due blocks are determined in one call [-]."""

SHORT_STEP = 1e-6
"""Steps of an adaptive solver below this part of the run are short [-]."""

MAX_SHORT_STEPS = 1000
"""Number of successive short steps after which further ones are tested for jumps of a derivative [-]."""

TESTED_STEPS = 100
"""Number of steps tested for jumps [-]."""

MIN_JUMPS = 50
"""Number of tested steps with a jump at which the run ends [-].

A solver that is stuck at a jump crosses it in 63 to 100 of 100 steps. If it advances from one jump to the
next, small steps follow each jump, and at most 27 of 100 steps cross one.
"""

JUMP_TOLERANCE = 1e-9
"""Relative change of a derivative that is round-off, not a jump [-]."""

JUMP_HALVINGS = 10
"""Halvings of a step in which a change that is no jump becomes small [-]."""

SWITCH_ADVICE = (
    "Declare a Mode for a quantity that switches (a sign, an absolute value, a comparison), and an Event "
    "at the switch; if nothing switches, try the stiff solver Rodas5P"
)
"""Advice if steps become too small."""

NO_ROWS = np.empty((0, 0))


def next_chunk(chunk: int, started: float) -> int:
    """Return the number of steps to the next check, after a `chunk` of steps since wall time `started` [-, s]."""
    seconds = max(time.perf_counter() - started, 1e-9)
    growth = min(MAX_CHUNK_GROWTH, CHUNK_SECONDS / seconds)
    return max(MIN_CHUNK, int(chunk * growth))


@dataclass(slots=True)
class Run:
    """State of one run or session, and the only code that advances it.

    At time t, the sampled blocks due at t have not computed yet: they compute when the run is
    advanced from t, or finished.

    Attributes
    ----------
    prepared : Prepared
        Data shared with other runs.
    executor : Executor
        Executor of this run.
    x, d, p : Vector
        Continuous states, discrete values, parameters [as declared].
    log : Log or None
        Receiver of the logged rows.
    log_step : Fraction
        Time between logged instants [s].
    origin : Fraction
        Start time, from which instants are counted [s].
    first : int
        Initial time in ticks from time 0, from which fixed steps are counted [-].
    k : int
        Ticks since then [-].
    beyond : Fraction
        Time since the last tick [s].
    end : Fraction
        Final time of a run, for `to_end` [s].
    checkpoint_every : Fraction or None
        Simulated time between checkpoints [s].
    identity : mapping
        Identity that checkpoints of this run must have.
    seconds : float
        Wall time spent on the run before `to_end` [s].
    time : float
        Last good time [s].
    sampled : int or None
        Tick whose sampled blocks have computed already, or None [-].
    bar : RunBar or None
        Progress bar.
    statistics : dict
        Numbers of steps, and the method, with a solver of variable steps.
    jumps : int
        Number of tested short steps with a jump of a derivative [-].
    pacer : Pacer or None
        Pacer of a run in real time.
    """

    prepared: Prepared
    executor: Executor
    x: Vector
    d: Vector
    p: Vector
    log: Log | None = None
    log_step: Fraction = field(default=Fraction(1))
    origin: Fraction = field(default=Fraction(0))
    first: int = 0
    k: int = 0
    beyond: Fraction = field(default=Fraction(0))
    end: Fraction = field(default=Fraction(0))
    checkpoint_every: Fraction | None = None
    identity: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0
    time: float = 0.0
    sampled: int | None = None
    bar: RunBar | None = None
    statistics: dict[str, Any] = field(default_factory=dict)
    jumps: int = 0
    pacer: Pacer | None = None

    def __post_init__(self) -> None:
        self.begin_at(self.origin)
        self.go_to(self.origin)
        plan = self.prepared.plan
        # A loop that cannot be solved is refused before the run starts. With external inputs,
        # the loop may become solvable later.
        if plan.loops and not plan.python_blocks and not plan.system.external:
            plan.evaluate(
                self.time,
                self.x,
                self.d,
                self.p,
                self.prepared.schedule.sets[self.due()],
            )

    @property
    def now(self) -> Fraction:
        """Time reached [s]."""
        return self.origin + self.k * self.prepared.tick + self.beyond

    def time_of(self, k: Any) -> Any:
        """Return the time [s] of tick `k` [-], or of several."""
        tick = self.prepared.tick
        # Multiplied first, as in driver.c: tick 3 of 1/10 s
        # is 0.3, while 3 * 0.1 is not.
        return (self.first + k) * tick.numerator / tick.denominator

    def begin_at(self, origin: Fraction) -> None:
        """Set the time from which instants are counted [s]."""
        self.origin, self.first = origin, int(origin // self.prepared.tick)

    def go_to(self, now: Fraction) -> None:
        """Set the present time [s]; nothing is computed."""
        # Exact fractions: now = origin + k ticks + beyond, with 0 <= beyond < 1 tick.
        whole, self.beyond = divmod(now - self.origin, self.prepared.tick)
        self.k = int(whole)
        self.time = float(now)

    def save(self) -> Snapshot:
        """Return all data needed to continue from the present time.

        Raises
        ------
        SimulationError
            If a Python block cannot save its state.
        """
        return Snapshot(
            layout=self.prepared.layout,
            now=self.now,
            origin=self.origin,
            x=self.x.copy(),
            d=self.d.copy(),
            p=self.p.copy(),
            hidden=self.executor.blocks.save(),
            sampled=self.sampled == self.k,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go to the time of a snapshot of an equal diagram; the run continues from there bit by bit."""
        # In place: event watch and Python blocks hold views of these arrays.
        self.x[:] = snapshot.x
        self.d[:] = snapshot.d
        self.p[:] = snapshot.p
        self.executor.blocks.call_each("restore", snapshot.hidden)
        # The snapshot's parameters may differ from those that the blocks last read.
        self.executor.blocks.call_each("tuned")
        self.begin_at(snapshot.origin)
        self.go_to(snapshot.now)
        self.sampled = self.k if snapshot.sampled else None
        if self.pacer is not None:
            self.pacer.begin(self.time)

    def check(self, found: Snapshot) -> None:
        """Raise `SimulationError` if a field of a snapshot `found` in a file cannot be of this run."""
        plan = self.prepared.plan
        kept = self.executor.blocks.kept()
        # Beyond this time neighbouring ticks round to the same float.
        latest = 2**53 * self.prepared.tick
        fits = {}
        for name in "xdp":
            own, value = getattr(self, name), getattr(found, name)
            alike = isinstance(value, np.ndarray) and value.dtype == own.dtype
            alike = alike and value.shape == own.shape
            # Infinity is allowed: a mode may be the infinite time
            # of an event that never occurs.
            fits[name] = alike and not np.isnan(value).any()
        if fits["d"]:
            # C code trusts the sizes of histories, which follow the number of points.
            starts = [e.start for e in plan.histories]
            sizes = np.add.outer(starts, [1, 2, 3]).astype(int)
            number = found.d[starts]
            fits["d"] = np.array_equal(found.d[sizes], self.d[sizes]) and bool(
                ((number >= 0.0) & (number < 2**53)).all()
            )
        times = found.origin, found.now
        are_times = all(isinstance(time, Fraction) for time in times)
        fits["origin, now"] = are_times and -latest < found.origin <= found.now < latest
        fits["hidden"] = isinstance(found.hidden, dict)
        fits["hidden"] = fits["hidden"] and found.hidden.keys() == kept.keys()
        fits["sampled"] = isinstance(found.sampled, bool)
        if wrong := [name for name, fit in fits.items() if not fit]:
            raise SimulationError(
                f"cannot restore '{plan.name}': {', '.join(wrong)} of the snapshot cannot be of this "
                "diagram: the file was changed"
            )
        # Raises if a block does not allow one of these values.
        plan.parameters(plan.p.named(found.p))

    def sample(self) -> None:
        """Evaluate the sampled blocks due at the present time; `advance` does not repeat this."""
        self._instant(self.due(), self.time)
        self.sampled = self.k

    def advance(self, until: Fraction) -> None:
        """Run from the instant of the present time to just before the instant of `until` [s].

        Raises
        ------
        DivergenceError
            If the solver gives up, or a state or sampled value stops being finite.
        """
        if not self.prepared.solver.is_fixed:
            self._adaptive(until)
            return
        tick = self.prepared.tick
        last = int((until - self.origin) // tick)
        # A session may be between two ticks: it first returns to the grid.
        if self.beyond:
            self._part(min(until, self.origin + (self.k + 1) * tick))
        self.step_to(last)
        # `until` lies between two ticks: sample at the tick
        # before, then take a short step.
        if self.now < until:
            self._instant(self.due(), self.time)
            self._part(until)

    def to_end(
        self,
        progress: bool = False,
        limit: float | None = None,
        pace: float | None = None,
    ) -> xr.Dataset:
        """Run to the end; finish the log in any case.

        Parameters
        ----------
        progress : bool
            Whether a bar is shown if the run takes more than a second.
        limit : float, optional
            Wall time limit [s].
        pace : float, optional
            Simulated seconds in a second of wall time [-].

        Returns
        -------
        xarray.Dataset
            Logged data.
        """
        assert self.log is not None
        log = self.log
        blocks = self.executor.blocks
        started = time.perf_counter()
        try:
            if log.finished:
                return log.finish({})
            if log.resumed is not None:
                self._resume(log.resumed)
            name = self.prepared.plan.name
            length = float(self.end - self.now)
            if pace is not None:
                self.pacer = Pacer(pace, self.time)
            with interruptible(), RunBar(name, length, progress, limit) as self.bar:
                if self.checkpoint_every is not None:
                    self._advance_with_checkpoints(log, self.checkpoint_every)
                # `advance` stops just before the instant of the
                # end, which belongs to the run.
                self.advance(self.end)
                self._instant(self.due(), self.time)
                self._log_now(self.time)
            if self.pacer is not None:
                self.statistics |= self.pacer.counts
                self.pacer.warn(name)
            wall_time = self.seconds + time.perf_counter() - started
            result = log.complete(
                blocks.messages, wall_time=wall_time, **self.statistics
            )
            warn_of_coarse_steps(self)  # only now: a diverged log is the better message
            return result
        except BaseException as error:  # noqa: BLE001 - raised again with the log
            return log.abandon(error, self.time, blocks.messages, **self.statistics)

    def _resume(self, checkpoint: Snapshot) -> None:
        """Restore a checkpoint of the same run."""
        self.check(checkpoint)
        if checkpoint.now > self.end:
            raise SimulationError(
                f"cannot resume '{self.prepared.plan.name}' to end at t = {written(self.end)} s: its "
                f"checkpoint is of t = {written(checkpoint.now)} s; give a longer duration, or leave out "
                "resume=True to start again"
            )
        self.restore(checkpoint)

    def _advance_with_checkpoints(self, log: Log, every: Fraction) -> None:
        """Advance to the end, and write the state to the disk at each multiple of a time `every` [s]."""
        if log.resumed is None:
            self.sample()  # all blocks have started: a state that cannot be saved is reported now
        while self.now < self.end:
            log.checkpoint(self.save(), self.identity)
            # Counted from the origin, so that a resumed run stops at the same times. An
            # adaptive solver restarts there; other times would change the result.
            following = (self.now - self.origin) // every + 1
            self.advance(min(self.end, self.origin + following * every))

    def step_to(self, last: int) -> None:
        """Advance by fixed steps, from tick to tick, to the instant of the `last` one [-].

        Raises
        ------
        DivergenceError
            If a state or sampled value stops being finite.
        """
        prepared = self.prepared
        log = self.log
        tick = self.prepared.tick
        every = (
            ticks(self.log_step, prepared.tick, "log_step") if log is not None else 0
        )
        longest = last
        if log is not None:
            # So many ticks, of which one in `every` is logged,
            # give CHUNK_NUMBERS numbers.
            longest = max(MIN_CHUNK, CHUNK_NUMBERS * every // max(1, log.width))
        if self.pacer is not None:
            paced = min(longest, PACED_SECONDS * self.pacer.pace / tick)
            longest = max(1, int(paced))
        chunk = min(MIN_CHUNK, longest)
        # Equal to k, so that the first pass computes a window.
        stop = self.k
        while self.k < last:
            k = self.k
            if k == stop:
                base = k
                stop = min(last, k + max(WINDOW_TICKS, chunk))
                due = prepared.schedule.due(base, stop - base)
                logged = np.zeros(stop - base, dtype=np.uint8)
                if every:
                    # -base % every is the distance to the next multiple of `every`.
                    logged[-base % every :: every] = 1
                if self.sampled == base:
                    due[0] = 0
            end = min(k + chunk, stop)
            flags = logged[k - base : end - base]
            number = int(np.count_nonzero(flags)) if every else 0
            rows = log.reserve(number) if log is not None and number else NO_ROWS
            span = Span(
                prepared.solver.solver,
                tick,
                self.first + k,
                k - base,
                end - base,
                due,
                logged,
            )
            # Only full chunks are timed: a shorter span would let chunks grow too much.
            started = time.perf_counter() if end - k == chunk else 0.0
            progress = self.executor.advance(span, self.x, self.d, self.p, rows)
            taken = np.flatnonzero(flags[: progress.steps])
            if log is not None and taken.size:
                log.keep(self.time_of(k + taken), taken.size)
            if progress.fault:
                self._failed(
                    progress,
                    k + progress.steps,
                    bool(logged[k - base + progress.steps]),
                )
            end = k + progress.steps
            self.k = end
            self.time = self.time_of(end)
            if started:
                chunk = min(next_chunk(end - k, started), longest)
            if self.bar is not None:
                self.bar.update((end - k) * tick.numerator / tick.denominator)
            if self.pacer is not None:
                self.pacer.wait(self.time)

    def _part(self, end: Fraction) -> None:
        """Take a step that is shorter than a tick."""
        if end == self.now:
            return
        times = (self.time, float(end), float(end - self.now))
        state = self.executor.between(
            self.prepared.solver.solver, times, self.x, self.d, self.p
        )
        if not np.isfinite(state).all():
            raise self._divergence("x", state, times[1])
        self.x[:] = state
        self.go_to(end)
        if self.pacer is not None:
            self.pacer.wait(self.time)

    def _failed(self, progress: Progress, k: int, is_logged: bool) -> NoReturn:
        """Raise the error of the step from tick `k` [-], at which a row was reserved if it `is_logged`."""
        self.time = self.time_of(k)
        if progress.fault != "d" and is_logged and self.log is not None:
            self.log.keep(self.time)  # the row before the step is good
        if progress.bad is None:
            assert progress.error is not None
            raise progress.error
        after = self.time_of(k + 1) if progress.fault == "x" else self.time
        raise self._divergence(progress.fault, progress.bad, after)

    def _divergence(self, fault: str, bad: Vector, after: float) -> DivergenceError:
        plan = self.prepared.plan
        if plan.loops:
            self._blame_loop(fault, after)
        cause = self._cause(after) if fault == "x" else ""
        # Held outputs first: they may be the cause of a bad update, never the other way round. No instant
        # changes modes, which may be infinite.
        layouts = (
            [plan.x]
            if fault == "x"
            else [plan.u, plan.held, plan.memory, plan.guesses, plan.histories]
        )
        name = next(filter(None, (layout.fault(bad) for layout in layouts)))
        return DivergenceError(
            f"{name} stopped being finite at t = {after:g} s{cause}; the last good step "
            f"is at t = {self.time:g} s and the log up to there is kept. Try a smaller step, a "
            "stiff solver (Rodas5P), or look for a division by zero in that block"
        )

    def _blame_loop(self, fault: str, after: float) -> None:
        """Repeat the failed evaluation in NumPy, which raises the error of an algebraic loop if one fails."""
        prepared = self.prepared
        if fault == "x":
            times = self.time, after, after - self.time
            executor = NumPyExecutor(prepared.plan, [derivative()])
            executor._step(prepared.solver.solver, times, self.x, self.d, self.p)
        else:
            tick = round((after - float(self.origin)) / prepared.tick_seconds)
            active = prepared.schedule.sets[int(prepared.schedule.due(tick, 1)[0])]
            prepared.plan.evaluate(after, self.x, self.d, self.p, active)

    def _cause(self, after: float) -> str:
        """Name the first signal that is not finite during the step, if there is one."""
        plan = self.prepared.plan
        # The times of the stages of RK4, with the states at the start of the step.
        for t in (self.time, (self.time + after) / 2, after):
            with np.errstate(all="ignore"), contextlib.suppress(TrussflowError):
                evaluation = plan.evaluate(t, self.x, self.d, self.p)
                for port in (
                    port for stage in plan.order(frozenset()) for port in stage.ports
                ):
                    if not np.isfinite(evaluation.output(port)).all():
                        return f"; the first non-finite signal is '{port.path}'"
        return ""

    def _instant(self, number: int, t: float) -> None:
        """Evaluate the sampled blocks of one instant."""
        if not number:
            return
        updated = self.executor.instant(number, t, self.x, self.d, self.p)
        if updated is self.d:
            return
        if not self.prepared.plan.sound(updated):
            raise self._divergence("d", updated, t)
        self.d[:] = updated

    def _log_now(self, t: float) -> None:
        if self.log is None:
            return
        self.log.reserve(1)[0] = self.executor.call(
            "outputs", t, self.x, self.d, self.p
        )
        self.log.keep(t)

    # -- adaptive -------------------------------------------------------------------------

    def _adaptive(self, until: Fraction) -> None:
        """Advance with variable steps; the solver starts anew at each instant."""
        every = self.log_step
        solver = self.prepared.solver
        control = Control.of(
            solver.solver,
            solver.rtol,
            solver.atol,
            SHORT_STEP * float(until - self.origin),
        )
        try:
            for end in self._ends(until):
                start = self.now
                self._instant(self.due(), float(start))
                if (start - self.origin) % every == 0:
                    self._log_now(float(start))
                control.begin(float(start), float(end))
                self._vary(control, self._logged_inside(start, end))
                self.go_to(end)
        except AdaptiveError as error:
            raise self._gave_up(*error.args) from error
        finally:
            self._count(control)

    def _logged_inside(self, start: Fraction, end: Fraction) -> range:
        """Return the numbers of the logged instants strictly between `start` and `end` [-]."""
        if self.log is None:
            return range(0)
        every = self.log_step
        first = (start - self.origin) // every + 1
        # Rounded up, so that the last of the instants lies before `end`.
        return range(first, -((self.origin - end) // every))

    def _logged_times(self, numbers: range) -> Vector:
        """Return the times of the logged instants with these `numbers` [s]."""
        every = self.log_step
        # A quotient of two integers is rounded once.
        common = lcm(self.origin.denominator, every.denominator)
        begin, step = int(self.origin * common), int(every * common)
        return np.array([(begin + step * i) / common for i in numbers])

    def _vary(self, control: Control, due: range) -> None:
        """Advance to the end of a span by variable steps; log at the instants with the numbers `due` [-]."""
        log = self.log
        width = log.width if log is not None else 0
        chunk, most = MIN_CHUNK, max(1, CHUNK_NUMBERS // (1 + width))
        times = np.empty(0)
        while True:
            # In pieces, as those of a long run fill the memory. The solver also looks at the time after the
            # last row that has room.
            if len(times) < min(2, len(due)):
                times = self._logged_times(due[: most + 1])
            control.due_rows = len(due)
            control.room = len(times) - (len(times) < len(due))
            rows = log.reserve(control.room) if log is not None else NO_ROWS
            # Steps that stay short are taken one by one, to find jumps of the derivative.
            tested = control.short_steps > MAX_SHORT_STEPS
            control.max_steps = 1 if tested or self.pacer is not None else chunk
            before = control.t, self.x.copy() if tested else self.x
            taken = control.steps
            started = time.perf_counter()
            try:
                self.executor.vary(
                    VariableSpan(control, self.x, self.d, self.p, times, rows)
                )
            finally:
                if log is not None and control.rows:
                    log.keep(times[: control.rows], control.rows)
                reached = control.t - self.time
                self.time = control.t
            if self.bar is not None:
                self.bar.update(reached)
            if self.pacer is not None:
                self.pacer.wait(self.time)
            times, due = times[control.rows :], due[control.rows :]
            if control.t >= control.end:
                return
            if tested:
                self._test_short_step(control, *before)
                continue
            control.short_steps = min(control.short_steps, MAX_SHORT_STEPS + 1)
            if control.steps - taken == chunk:
                chunk = next_chunk(chunk, started)

    def _test_short_step(self, control: Control, t: float, x: Vector) -> None:
        """Test the last step, from time `t` [s] and states `x` [as declared], for a jump of a derivative.

        Raises
        ------
        DivergenceError
            If most of the tested steps have a jump.
        """
        if control.t > t:
            self.jumps += (jump := self._jump(t, x)) != ""
            if self.jumps == MIN_JUMPS:
                raise self._crawling(control.t - t, jump)
        if control.short_steps in (0, MAX_SHORT_STEPS + TESTED_STEPS):
            control.short_steps = self.jumps = 0

    def _count(self, control: Control) -> None:
        """Add up the numbers of a `control`, and describe the method for the result."""
        found = self.statistics
        for name in ("steps", "rejected", "evaluations", "factorizations"):
            label = "rejected_steps" if name == "rejected" else name
            found[label] = found.get(label, 0) + getattr(control, name)
        method = TABLEAUS[control.method]
        if control.automatic:
            switched = np.isfinite(control.switched)
            limit = "no step was limited by stability"
            if switched:
                limit = f"since t = {control.switched:.3g} s, as stability limited the steps of {AUTOMATIC_START}"
            method = f"{method}: {limit}"
            # Each checkpoint starts anew; a part without a change does not undo the last change.
            if not switched:
                method = found.get("method", method)
        found["method"] = method

    def _jump(self, t: float, x: Vector) -> str:
        """Describe the derivative that jumps in the last step, from time `t` [s] and states `x`; or return ""."""
        solver = self.prepared.solver
        slope = self.executor.call("derivative", t, x, self.d, self.p)

        # Sampled along the tangent: the states at both ends of the step may lie on one side of
        # the jump, while the solver's stages see both sides.
        def rate(h: float) -> Vector:
            return self.executor.call(
                "derivative", t + h, x + h * slope, self.d, self.p
            )

        low, high = 0.0, self.time - t
        before, after = slope, rate(high)
        change = np.abs(after - before)
        # The state whose rate changes most relative to its tolerance.
        i = int(np.argmax(change / (solver.atol + solver.rtol * np.abs(x))))
        # Of both halves the one in which that rate changes more: a smooth change becomes small there.
        for _ in range(JUMP_HALVINGS):
            middle = (low + high) / 2
            between = rate(middle)
            if abs(between[i] - before[i]) > abs(after[i] - between[i]):
                high, after = middle, between
            else:
                low, before = middle, between
        if abs(after[i] - before[i]) <= max(
            change[i] / 2, JUMP_TOLERANCE * abs(after[i])
        ):
            return ""
        name = self.prepared.plan.x.describe(i)
        return f"{name} jumps between {before[i]:.3g} and {after[i]:.3g}"

    def _crawling(self, step: float, jump: str) -> DivergenceError:
        """Return the error for steps that shrink to `step` [s], because of a `jump` of a derivative."""
        return DivergenceError(
            f"the steps of solver {self.prepared.solver.solver} have shrunk to {step:.2g} s at "
            f"t = {self.time:g} s, because the derivative of {jump}. The log up to there is kept. {SWITCH_ADVICE}"
        )

    def _gave_up(self, failed: float, there: Vector | None) -> DivergenceError:
        """Return the error of a solver that gave up; it names the fastest state, relative to its size.

        The derivative was not finite at the time `failed` [s] with the states `there` [as declared], or
        `there` is None.
        """
        plan = self.prepared.plan
        t, x = self.time, self.x
        if plan.loops and there is not None:
            # Raises the error of an algebraic loop if one has no solution there.
            plan.evaluate(failed, there, self.d, self.p)
        rate = self.executor.call("derivative", t, x, self.d, self.p)
        if not np.isfinite(rate).all():
            fault = f"the derivative of {plan.x.fault(rate)} is not finite"
        else:
            # 1e-12 avoids a division by zero for states at zero.
            worst = int(np.argmax(np.abs(rate) / (1e-12 + np.abs(x))))
            fault = f"the fastest state is {plan.x.describe(worst)}"
        return DivergenceError(
            f"solver {self.prepared.solver.solver} gave up after t = {t:g} s: no step is small enough; "
            f"{fault}. The log up to there is kept. Try larger tolerances. {SWITCH_ADVICE}"
        )

    def due(self) -> int:
        """Return the number of the set of clocks that ticks at the present time; 0 for none."""
        if self.beyond or self.k == self.sampled or not self.prepared.has_clocks:
            return 0
        return int(self.prepared.schedule.due(self.k, 1)[0])

    def _ends(self, until: Fraction) -> Iterator[Fraction]:
        """Return the instants from now on at which the solver must stop, the end included."""
        blocks = self.prepared.plan.system.blocks.values()
        breaks = {b for block in blocks for b in breakpoints_of(block)}
        now = self.now
        pending = sorted(b for b in breaks if now < b < until)
        clocks = [
            (self.origin + c.offset, c.period) for c in self.prepared.plan.system.clocks
        ]
        while now < until:
            # The next tick of each clock strictly after `now`,
            # but not before its first one.
            following = [
                first + max(0, (now - first) // period + 1) * period
                for first, period in clocks
            ]
            now = min([until, *following, *pending[:1]])
            pending = [b for b in pending if b > now]
            yield now
