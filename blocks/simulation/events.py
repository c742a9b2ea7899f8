"""Finding events: times at which an indicator loses its sign, and times known in advance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector

LOCATED_TO = 4.0
"""Width of the bracket to which an event is narrowed down, in units of the last place of time."""

MOST_EVENTS = 200
"""Events as good as at one time after which they are taken to go on for ever."""

CLOSE = 1000.0
"""How close, in units of the last place of time, events are as good as at one time."""


@dataclass(slots=True)
class EventWatch:
    """Looks for events step by step, at times `t` [s] with states `x` [as declared].

    An event is where an indicator that was positive or negative becomes zero or changes its sign.
    One that is zero after an event has an event again only with the opposite of the sign it had
    before: a ball that leaves the floor or lies there has none, one that falls through has.

    Attributes
    ----------
    indicators, accepted, handle : callable
        Functions of (t, x): the indicators; whether a block asks for an event after a step; the
        states after an event.
    next_time : callable
        Returns the time of the next time event [s].
    before : callable
        Function of (t, x): the signs of the indicators before inputs jumped there, or None.
    """

    indicators: Callable[[float, Vector], Vector]
    accepted: Callable[[float, Vector], bool]
    handle: Callable[[float, Vector], Vector]
    next_time: Callable[[], float]
    before: Callable[[float, Vector], Vector | None]
    _signs: Vector = field(default_factory=lambda: np.zeros(0))
    _sides: Vector = field(default_factory=lambda: np.zeros(0))
    _last: tuple[float, int] = (-np.inf, 0)

    def begin(self, t: float, x: Vector) -> Vector:
        """Start watching; handle what is due at once and return the states."""
        signs, before = np.sign(self.indicators(t, x)), self.before(t, x)
        self._signs = self._sides = signs if before is None else before
        if self._lost(signs):
            x = self.handle_event(t, x)
        else:
            self._keep(signs)
        return self.due(t, x)

    def due(self, t: float, x: Vector) -> Vector:
        """Handle time events that are due; return the states."""
        while self.next_time() <= t:
            x = self.handle_event(t, x)
        return x

    def handle_event(self, t: float, x: Vector) -> Vector:
        """Handle an event and return the states after it.

        Raises
        ------
        SimulationError
            If events follow each other without end.
        """
        close = t - self._last[0] <= CLOSE * np.spacing(abs(t))
        self._last = (t, self._last[1] + 1 if close else 1)
        if self._last[1] > MOST_EVENTS:
            raise SimulationError(
                f"more than {MOST_EVENTS} events at t = {t:g} s: on_event() or next_event() of a "
                "block asks for the same event again and again, or events follow each other ever "
                "faster, as of a ball that bounces ever lower; let on_event() bring it to rest"
            )
        x = self.handle(t, x)
        self._keep(np.sign(self.indicators(t, x)))
        return x

    def _keep(self, signs: Vector) -> None:
        self._signs, self._sides = signs, np.where(signs == 0, self._sides, signs)

    def _lost(self, signs: Vector) -> bool:
        """Tell whether any indicator has lost its sign."""
        lost = (self._signs != 0) & (signs != self._signs)
        return bool(np.any(lost | (signs * self._sides < 0)))

    def after_step(
        self, begin: float, end: float, x: Vector, state: Callable[[float], Vector]
    ) -> tuple[float, Vector] | None:
        """Return time and states of the first event within a step, if there is one.

        Parameters
        ----------
        begin, end : float
            The step [s].
        x : Vector
            States at its end [as declared].
        state : callable
            Returns the states at a time within the step.
        """
        signs = np.sign(self.indicators(end, x))
        if not self._lost(signs):
            self._keep(signs)
            return (end, x) if self.accepted(end, x) else None
        low, high, found = begin, end, x
        while high - low > LOCATED_TO * np.spacing(max(abs(low), abs(high))):
            middle = low + (high - low) / 2
            there = state(middle)
            if self._lost(np.sign(self.indicators(middle, there))):
                high, found = middle, there
            else:
                low = middle
        return high, found
