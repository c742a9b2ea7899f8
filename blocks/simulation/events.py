"""Events: location of zero crossings of indicators and of time events in a step, and their handling."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from trussflow.blocks.errors import DivergenceError, RunStoppedError, SimulationError
from trussflow.blocks.framework.declarations import (
    EITHER,
    FALLING,
    RISING,
    TERMINAL,
    TIMED,
)
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.history import store, too_short
from trussflow.blocks.tracing.plan import Plan

if TYPE_CHECKING:
    from trussflow.blocks.simulation.executor import Executor

MACHINE_EPSILON = float(np.finfo(float).eps)
"""Relative distance of neighbouring numbers [-]."""

LOCATION_TOLERANCE = 4 * MACHINE_EPSILON
"""Width of the bracket of a located event, relative to time [-]."""

MAX_EVENTS = 200
"""Maximum number of event iterations at one time [-]."""

SIMULTANEITY_TOLERANCE = 1000 * MACHINE_EPSILON
"""Tolerance below which events count as simultaneous, relative to the time and to the step [-]."""

TURNED_SIDE = 0.25
"""Modulus of the side of an indicator that turned back at its event [-]."""

DIRECTION_STEP = 1e-6
"""Distance from an event at which the direction of an indicator is evaluated, in steps [-]."""


class EventWatch:
    """Location and handling of the events of one run with these d and p.

    Its twin in C is ``tracing/events.h``, which defines `sides`: a change here needs one there.

    Parameters
    ----------
    executor : Executor
        Executor of the indicators and `on_event` of its plan.
    d, p : Vector
        Discrete values, which are changed here, and parameters [as declared].
    """

    def __init__(self, executor: Executor, d: Vector, p: Vector) -> None:
        self.executor = executor
        self.d = d
        self.p = p
        self._plan = plan = executor.plan
        kinds = plan.kinds
        self._timed = kinds == TIMED
        self._directed = np.abs(kinds) == RISING
        self._may_fall = kinds <= EITHER
        self._terminal = kinds == TERMINAL
        self._may_rise = (kinds == EITHER) | (kinds == RISING) | self._terminal
        self._first = np.where(kinds == FALLING, 0.5, -0.5)
        self._sides = d[plan.sides.span]
        self._fired = d[plan.fired.span]
        self._modes = d[plan.modes.span]
        self._g = np.zeros(0)
        self._quiet = np.zeros(len(kinds), dtype=bool)
        self.fresh = True  # whether d or p may have changed since the last step
        self._last = 0.0  # time of the last event [s]
        self._number = 0  # of simultaneous events

    def begin(self, t: float, x: Vector) -> Vector:
        """Handle events that are due, or result from a jump of d or p, at `t` [s]; return the states `x`."""
        self._number = 0
        fresh, self.fresh = self.fresh, True
        if not fresh:
            return x
        self._indicate(t, x)
        self._record(t, x)
        return self._settle(t, x)

    def next_time(self) -> float:
        """Return the time of the next time event [s]."""
        return float(self._g[self._timed].min(initial=np.inf))

    def after_step(
        self, begin: float, end: float, x: Vector, state: Callable[[float], Vector]
    ) -> tuple[float, Vector] | None:
        """Return time and states of the first event within a step, if there is one, for `handle`.

        Parameters
        ----------
        begin, end : float
            The step [s].
        x : Vector
            States at its end [as declared].
        state : callable
            Returns the states at a time within the step.
        """
        # The indicators at `begin`, from the last step or event.
        start = self._g
        self._indicate(end, x)
        if self._mark(end):
            end, x = self._locate(begin, end, x, state, start)
        self.executor.accepted(end, x, self.d, self.p)
        self._record(end, x, before=True)
        if self.executor.asking or self._fired.any():
            return end, x
        self._adopt()
        return None

    def handle(self, t: float, x: Vector, step: float) -> Vector:
        """Handle the event that `after_step` found in a `step` [s]; return the states `x` at `t` [s]."""
        self._indicate(t, x)
        return self._settle(t, x, step)

    # -- handling ------------------------------------------------------------------------

    def _indicate(self, t: float, x: Vector) -> None:
        self._g = self.executor.call("indicators", t, x, self.d, self.p)
        if np.isnan(self._g).any():
            not_a_number(self._plan, self._g, t, x, self.d, self.p)

    def _record(self, t: float, x: Vector, *, before: bool = False) -> None:
        """Store the signals that have a history at `t` [s], and before these those just before `t` if `before`."""
        plan, d = self._plan, self.d
        if not plan.histories.size:
            return
        for at in ([float(np.nextafter(t, -np.inf))] if before else []) + [t]:
            values = self.executor.call("stored", at, x, d, self.p)
            for e in plan.histories:
                size = int(d[e.start + 2])
                store(d[e.start : e.stop], t, values[:size])
                if too_short(d[e.start : e.stop]):
                    full(plan, t, d)
                values = values[size:]
        self._indicate(t, x)

    def _mark(self, t: float) -> bool:
        """Mark in d the events that fire with the present indicators; return whether any does."""
        g = self._g
        sides = self._sides
        # An indicator that turned back at its event is beyond zero by round-off only, and its
        # event was handled at this very time.
        self._quiet = (np.abs(sides) == TURNED_SIDE) & (t == self._last)
        falls = (
            self._may_fall & (sides > 0.0) & ((g < 0.0) | ((g == 0.0) & (sides == 1.0)))
        )
        rises = (
            self._may_rise
            & (sides < 0.0)
            & ((g > 0.0) | ((g == 0.0) & (sides == -1.0)))
        )
        self._fired[:] = ((falls | rises) & ~self._quiet) | (
            self._timed
            # A sample instant may differ from the time of an event by round-off.
            & (g <= t + LOCATION_TOLERANCE * abs(t))
        )
        return bool(self._fired.any())

    def _adopt(self) -> None:
        """Update the sides of indicators whose events did not fire."""
        sides = self._sides
        others = (self._fired == 0.0) & ~self._quiet
        # At zero, an indicator counts as crossed in its direction of motion; at the start, it
        # counts on the side from which its event can fire.
        at_zero = np.where(
            np.abs(sides) == 1.0,
            -0.5 * sides,
            np.where(sides == 0.0, self._first, sides),
        )
        sides[others] = np.where(self._g != 0.0, np.sign(self._g), at_zero)[others]

    def _settle(self, t: float, x: Vector, step: float | None = None) -> Vector:
        """Handle the events that fire, and the events that they cause, until no event fires.

        With a `step` [s], the first ones were located in a step of that length; the others follow a jump.
        """
        executor = self.executor
        d = self.d
        p = self.p
        sides = self._sides
        fired = self._fired
        while True:
            happens = self._mark(t)
            self._adopt()
            if not happens and not self.executor.asking:
                return x
            if self._fired[self._terminal].any():
                ended(self._plan, t, d)
            last = self._last
            close = t - last <= SIMULTANEITY_TOLERANCE * (abs(t) + (step or 0.0))
            self._last = t
            self._number = self._number + 1 if close else 1
            # A flight shorter than the location tolerance cannot be located.
            short = (
                t - last <= 2 * LOCATION_TOLERANCE * abs(t)
                and (fired * np.abs(sides) == TURNED_SIDE).any()
            )
            if self._number > MAX_EVENTS or short:
                endless(t)
            # A time event within round-off after t is handled at its own time, so that
            # on_event() does not see a time before it.
            times = self._g[self._timed & (fired > 0.0)]
            after = executor.call("on_event", float(times.max(initial=t)), x, d, p)
            x, self._modes[:] = after[: x.size], after[x.size :]
            refuse_not_finite(self._plan, t, x, d)
            self._indicate(t, x)
            self._record(t, x)
            g = self._g
            old = np.where(sides > 0.0, 1.0, -1.0)
            own = fired > 0.0
            if step is not None:
                # An indicator near zero after its event has crossed or turned back: its value
                # a short time ahead decides.
                soon = x + DIRECTION_STEP * step * executor.call(
                    "derivative", t, x, d, p
                )
                ahead = executor.call(
                    "indicators", t + DIRECTION_STEP * step, soon, d, p
                )
                near = own & self._directed & (g * old <= 0.0)
                on = np.where(ahead == g, g * old < 0.0, ahead * old < g * old)
                sides[near] = np.where(on, -0.5 * old, TURNED_SIDE * old)[near]
                own &= ~near
            # Moved back to its old side, left at zero, or left on the other side.
            sides[own] = np.where(
                g * old > 0.0, old, np.where(g == 0.0, -0.5 * old, -old)
            )[own]
            # The next events follow from the jump of these, not from a step.
            step = None

    # -- location --------------------------------------------------------------------------------

    def _locate(
        self,
        begin: float,
        end: float,
        x: Vector,
        state: Callable[[float], Vector],
        start: Vector,
    ) -> tuple[float, Vector]:
        """Find the first of the marked events in a step: by Illinois' variant of the false position.

        Every fourth time the bracket is halved.
        """
        crossing = np.flatnonzero((self._fired > 0.0) & ~self._timed)
        if not crossing.size:
            return end, x
        old = np.sign(self._sides[crossing])
        # An indicator that is at zero already fires when it leaves zero.
        strict = np.abs(self._sides[crossing]) < 1.0
        low = begin
        high = end
        # The first zero of the minimum of all marked indicators is the first event.
        a = float(np.min(old * start[crossing]))
        b = float(np.min(old * self._g[crossing]))
        width = LOCATION_TOLERANCE * max(abs(begin), abs(end))
        # which end of the bracket moved last (1: the upper), and the iteration
        kept, turn = (0, 1)
        while high - low > width:
            middle = low + (high - low) / 2
            if turn % 4 and a > 0.0 > b:
                middle = low + (high - low) * (a / (a - b))
                # Kept off the ends of the bracket, which otherwise might not shrink.
                middle = min(max(middle, low + width / 2), high - width / 2)
            there = state(middle)
            beyond = (
                old
                * self.executor.call("indicators", middle, there, self.d, self.p)[
                    crossing
                ]
            )
            nearest = float(beyond.min())
            if nearest < 0.0 or ((beyond == 0.0) & ~strict).any():
                high = middle
                x = there
                b = nearest
                # The Illinois rule: halve the value at the end that
                # stayed for the second time.
                a = a / 2 if kept == 1 else a
                kept = 1
            else:
                low = middle
                a = nearest
                b = b / 2 if kept == -1 else b
                kept = -1
            turn += 1
        # The upper end: the event condition holds there.
        return high, x


def refuse_not_finite(plan: Plan, t: float, x: Vector, d: Vector) -> None:
    """Check the states `x` and the modes in `d` [as declared] of a `plan` after an event at time `t` [s].

    Raises
    ------
    DivergenceError
        If one is not finite; modes may be infinite, such as the time of an event that never occurs.
    """
    modes = np.where(np.isinf(d), 0.0, d)
    if fault := plan.x.fault(x) or plan.modes.fault(modes) or plan.histories.fault(d):
        raise DivergenceError(
            f"{fault} stopped being finite at t = {t:g} s: on_event() of that block returned it; the "
            "log up to there is kept"
        )


def not_a_number(
    plan: Plan, g: Vector, t: float, x: Vector, d: Vector, p: Vector
) -> NoReturn:
    """Raise the error for indicators `g` of a `plan`, one of which is not a number.

    They are those at time `t` [s] with `x`, `d` and `p` [as declared].
    """
    if plan.loops:
        plan.evaluate(t, x, d, p)  # raises if a loop has no solution, the cause of NaN
    place = plan.sides.span.start + int(np.argmax(np.isnan(g)))
    raise SimulationError(
        f"indicator {plan.sides.describe(place)} is not a number at t = {t:g} s; look for a "
        "division by zero in indicators() of that block or in what it reads"
    )


def ended(plan: Plan, t: float, d: Vector) -> NoReturn:
    """End a run at the time `t` [s] of the first terminal event of a `plan` that is marked in `d`."""
    happens = (plan.kinds == TERMINAL) & (d[plan.fired.span] > 0.0)
    place = int(np.argmax(happens))
    path = next(e.path for e in plan.sides if place < e.stop - plan.sides.span.start)
    message = getattr(plan.system.blocks[path], "message", "")
    # A block of the user may have a parameter of that name.
    text = message if isinstance(message, str) else ""
    raise RunStoppedError(f"'{path}' ended the run at t = {t:.12g} s {text}".rstrip())


def full(plan: Plan, t: float, d: Vector) -> NoReturn:
    """Raise the error for a history of a `plan` in `d` that has no room for the points of its delay at `t` [s]."""
    e = next(e for e in plan.histories if too_short(d[e.start : e.stop]))
    raise SimulationError(
        f"'{e.path}' stores at most {d[e.start + 1]:g} points, which its delay exceeds at t = {t:g} s: "
        "give the block a larger number of points, such as points=10000, or a larger step"
    )


def endless(t: float) -> NoReturn:
    """Raise the error for endless events at time `t` [s]."""
    raise SimulationError(
        f"events without end at t = {t:g} s: on_event() of a block does not advance the "
        "time of its time event, or two modes call each other back (give the relay a hysteresis), or events follow each "
        "other ever faster, as of a ball that bounces ever lower; let on_event() bring it to rest"
    )
