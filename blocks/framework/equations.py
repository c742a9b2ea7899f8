"""Equations of a block: pure functions of time, states, inputs and parameters."""

from __future__ import annotations

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.support.types import Array

Values = dict[str, Array]
"""Results of equations: arrays by port or state name."""


class Equations:
    """Equations of a block, each called with ``(t, x, u, p)``.

    Every method takes the same arguments:

    * `t`, array of shape (): time [s];
    * `x`, `u`, `p`, `Signals`: states, inputs and parameters by name [units as declared].

    A `Block` defines its own equations. If it has internal state, a `Running` object for each run
    defines them instead.

    Notes
    -----
    Continuous blocks may have **events**, each declared as an `Event`. `indicators` determines their
    times, and `on_event` changes states (they jump) and modes (declared as `Mode`). The height of a
    bouncing ball is a falling indicator, and the event reverses its speed. A relay has two indicators
    and one mode. The solver stops at an event, calls `on_event`, and restarts. At an instant, events
    are handled first: sampled blocks and the log see the states after them.
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
        """Return the initial states that depend on the inputs `u` at the initial time, by name.

        The parameters `p` are those of `output`.
        """
        return {}

    # -- events -------------------------------------------------------------------------------

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the indicator of each declared `Event` by name: a number that crosses zero, or a time.

        A jump of an input or of a state at another event may also make an indicator cross zero. A condition
        that already holds at the initial time does not trigger its event. The arguments `t`, `x`, `u` and
        `p` are those of `output`.
        """
        return {}

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Handle events of this block; return the new values of the states and modes that change.

        The method is called when at least one event is triggered. Simultaneous events are handled
        together, and all blocks see the values before the events. The arguments `t`, `x`, `u` and `p` are
        those of `output`.

        Parameters
        ----------
        fired : Signals
            Triggered events by name: true or false, in the declared shapes.
        """
        return {}

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Handle an accepted step (Python blocks only); return True to request a call of `on_event`.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        return False

    def states_own(self, *names: str) -> bool:
        """Return whether the class, or the object itself, overrides an equation with one of the `names`."""
        return any(
            name in vars(self)
            or getattr(type(self), name) is not getattr(Equations, name)
            for name in names
        )


EVENTS = ("indicators", "on_event", "on_step")
"""Methods that only blocks with events override."""
