"""What a block computes: pure functions of time, states, inputs and parameters."""

from __future__ import annotations

from typing import ClassVar

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Array

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
    Continuous blocks may have **events**, each declared as an `Event`: `indicators` says when they
    happen, `on_event` what changes then, states (they jump) and modes (declared as `Mode`). A bouncing
    ball has its height as a falling indicator and turns its speed around; a relay has two indicators
    and one mode. The solver stops at an event, lets the blocks handle it, and starts afresh. At an
    instant, events come first: what is sampled and logged there sees the states after them.
    """

    sees_jumps: ClassVar[bool] = True
    """Whether `on_step` sees inputs of sources that jump as a step ends after their jump."""

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

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return, for each declared `Event` by name, the number whose zero it is, or its time.

        An event is also where an input jumps, or another event makes a state jump. What an indicator is
        at the start is no event. The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        return {}

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        """Handle events of this block; return the new values of the states and modes that change.

        It is called when one of them happens; those that happen at one time are handled at once, and all
        blocks see what was before. The arguments `t`, `x`, `u` and `p` are those of `output`.

        Parameters
        ----------
        fired : Signals
            Which events happen, by name: true or false, in the shapes declared.
        """
        return {}

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Take note of an accepted step (Python blocks only); return True to have `on_event` called now.

        The arguments `t`, `x`, `u` and `p` are those of `output`; see `sees_jumps`.
        """
        return False

    def states_own(self, name: str) -> bool:
        """Tell whether the class states the equation of that `name` itself."""
        return getattr(type(self), name) is not getattr(Equations, name)


EVENTS = ("indicators", "on_event", "on_step")
"""The equations that only blocks with events state."""
