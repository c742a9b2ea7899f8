"""Finding events: times at which an indicator loses its sign, and times known in advance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector

LOCATED_TO = 4.0
"""Width of the bracket to which an event is narrowed down, in units of the last place of time."""

MOST_EVENTS = 1000
"""Events at one and the same time after which they are taken to go on for ever."""


@dataclass(slots=True)
class EventWatch:
    """Looks for events step by step.

    An event is where an indicator that was positive or negative becomes zero or changes its sign.
    One that is zero afterwards has no sign until it is something else.

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
    _last: tuple[float, int] = (-np.inf, 0)

    def begin(self, t: float, x: Vector) -> Vector:
        """Start watching; handle what is due at once and return the states."""
        self._signs = np.sign(self.indicators(t, x))
        before = self.before(t, x)
        if before is not None and _lost(before, self._signs):
            x = self.handle_event(t, x)
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
        self._last = (t, self._last[1] + 1 if t == self._last[0] else 1)
        if self._last[1] > MOST_EVENTS:
            raise SimulationError(
                f"more than {MOST_EVENTS} events at t = {t:g} s: on_event() or next_event() of a "
                "block asks for the same event again and again"
            )
        x = self.handle(t, x)
        self._signs = np.sign(self.indicators(t, x))
        return x

    def after_step(
        self, begin: float, end: float, x: Vector, state: Callable[[float], Vector]
    ) -> tuple[float, Vector] | None:
        """Return time and states of the first event within a step, if there is one.

        Parameters
        ----------
        begin, end : float
            The step [s].
        x : Vector
            States at its end.
        state : callable
            Returns the states at a time within the step.
        """
        signs = np.sign(self.indicators(end, x))
        if not _lost(self._signs, signs):
            self._signs = signs
            return (end, x) if self.accepted(end, x) else None
        low, high, found = begin, end, x
        while high - low > LOCATED_TO * np.spacing(max(abs(low), abs(high))):
            middle = low + (high - low) / 2
            there = state(middle)
            if _lost(self._signs, np.sign(self.indicators(middle, there))):
                high, found = middle, there
            else:
                low = middle
        return high, found


def _lost(before: Vector, signs: Vector) -> bool:
    """Tell whether any indicator that had a sign has it no longer."""
    return bool(np.any((before != 0) & (signs != before)))
