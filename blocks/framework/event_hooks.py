"""What a continuous Python block may do at events: jumps of its states, found while it runs."""

from __future__ import annotations

import math

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Array, Vector


class EventHooks:
    """Hooks of continuous Python blocks whose states jump, or whose equations change, at events.

    A bouncing ball overrides `indicators` (its height) and `on_event` (speed reversed); a block
    with a timetable `next_event` and `on_event`. The solver stops at an event, lets all blocks
    handle it, and starts afresh. At an instant, events come first: what is sampled and logged there
    sees the states after them.
    """

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Vector:
        """Return the numbers whose zeros are state events.

        An event is where one that was positive or negative becomes zero or changes its sign, also
        by a jump of an input. It may be found slightly beyond zero or at zero itself, so let
        `on_event` ask for ``<= 0``. One that is zero after an event stays on the side it was on.

        Parameters
        ----------
        t : array, shape ()
            Time [s].
        x, u, p : Signals
            States, inputs and parameters by name [units as declared].
        """
        return np.zeros(0)

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals) -> dict[str, Array]:
        """Handle an event; return the new values of the continuous states that jump.

        The arguments are those of `indicators`. It is called at every event, also at those of
        other blocks.
        """
        return {}

    def next_event(self) -> float:
        """Return the time [s] of the next time event; asked at the start and after events."""
        return math.inf

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Take note of an accepted step; return True to have an event handled now.

        The arguments are those of `indicators`.
        """
        return False

    @property
    def has_events(self) -> bool:
        """Whether the block overrides any of these hooks."""
        own = type(self)
        return any(getattr(own, hook) is not getattr(EventHooks, hook) for hook in _HOOKS)


_HOOKS = ("indicators", "on_event", "next_event", "on_step")
