"""What a block computes: pure functions of time, states, inputs and parameters."""

from __future__ import annotations

import math

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Array, Vector

Values = dict[str, Array]
"""What equations return: arrays by port or state name."""


class Equations:
    """The equations of a block, each called with ``(t, x, u, p)``.

    Every method takes the same arguments:

    * `t`, array of shape (): time [s];
    * `x`, `u`, `p`, `Signals`: states, inputs and parameters by name [units as declared].

    A `Block` states its own; what it keeps in one run besides its declared states is a `Running`,
    which states them in its place.

    Notes
    -----
    Continuous Python blocks may have **events**: jumps of their states, or changes of their
    equations. A bouncing ball overrides `indicators` (its height) and `on_event` (speed reversed);
    a block with a timetable `next_event` and `on_event`. The solver stops at an event, lets all
    blocks handle it, and starts afresh. At an instant, events come first: what is sampled and
    logged there sees the states after them.
    """

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs by name; see `Equations` for `t`, `x`, `u` and `p` [as declared]."""
        return {}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the time derivatives of the continuous states by name.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        raise NotImplementedError

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the next values of the discrete states by name.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        return {}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return initial states that depend on the inputs `u` at the start, by name.

        The parameters `p` are those of `output`.
        """
        return {}

    # -- events -------------------------------------------------------------------------------

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Vector:
        """Return the numbers whose zeros are state events.

        An event is where one that was positive or negative becomes zero or changes its sign, also
        by a jump of an input. It may be found slightly beyond zero or at zero itself, so let
        `on_event` ask for ``<= 0``. One that is zero after an event stays on the side it was on.
        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        return np.zeros(0)

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Handle an event; return the new values of the continuous states that jump.

        It is called at every event, also at those of other blocks. The arguments `t`, `x`, `u`
        and `p` are those of `output`.
        """
        return {}

    def next_event(self) -> float:
        """Return the time [s] of the next time event; asked at the start and after events."""
        return math.inf

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Take note of an accepted step; return True to have an event handled now.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        return False

    def states_own(self, name: str) -> bool:
        """Tell whether the class states the equation of that `name` itself."""
        return getattr(type(self), name) is not getattr(Equations, name)


EVENTS = ("indicators", "on_event", "next_event", "on_step")
"""The equations that only blocks with events state."""
