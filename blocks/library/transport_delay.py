"""Transport delay in continuous time."""

from __future__ import annotations

from math import comb, factorial, prod

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import (
    Attribute,
    Event,
    History,
    Mode,
    Parameter,
    Signals,
    State,
)
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.linear import realization
from trussflow.blocks.library.signals import finite
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, is_whole, shown
from trussflow.blocks.tracing.history import count, interpolated, search

MIN_STEPS_PER_DELAY = 5
"""Smallest number of steps in a delay, as the input is stored at steps only [-]."""

ROUND_OFF = 1e-15
"""Round-off of a time, relative to it [-]."""

SWITCHING_MARGIN = 1e-9
"""Distance of the delayed time from a jump of the input at which it is at the jump, in longest delays [-]."""


MAX_RATIO = 1e5
"""Largest ratio of the longest to the shortest delay [-]."""


class TransportDelay(Block):
    r"""Delay a signal by a fixed time, y(t) = u(t - τ), with y0 before the first input.

    In a run, the input is stored at each accepted step, and interpolated by cubic polynomials. So the error
    is of fourth order in the step for a smooth signal, regardless of the tolerances. Steps are at most a
    fifth of the delay. A jump of a source, of a sampled block or at an event is delayed exactly, with every
    solver. The block breaks algebraic loops.

    In linear models, the delay is a Padé approximant; `frequency_response` uses the exact delay.

    Parameters
    ----------
    delay : float
        τ > 0 [s].
    initial_value : array_like
        y_0 [unit]; its shape is that of the signal.
    pade : int
        Order of the approximant n, with a numerator of order n - 1 [-]; its phase is accurate up to about
        n / τ rad/s.
    points : int, optional
        Largest number of stored points [-]; with fixed steps the default is enough for the steps within the
        delay, with variable steps it is at least 1000.
    unit : str, tuple of str or None
        Unit of the signal, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the delay or the order is not allowed.
    """

    u = Input("shape", unit=Attribute("unit"), meaning="signal to delay")
    y = Output("shape", unit=Attribute("unit"), meaning="the signal, later")
    z = State(("pade", "size"), meaning="states of the approximant")
    piece = Mode(0.0, meaning="piece of the input between jumps that is the output")
    past = History("u", "delay", "longest_step")
    again = Event("time")
    initial_value = Parameter(shape="shape", meaning="y_0")
    _symbol = Symbol("e^(−{delay}·s)")

    def __init__(
        self,
        delay: float,
        initial_value: npt.ArrayLike = 0.0,
        *,
        pade: int = 6,
        points: int | None = None,
        unit: Unit = None,
    ) -> None:
        owner = type(self).__name__
        self.delay = finite(owner, "delay", delay, above=0.0)
        # A subclass has set the shortest one, if the delay varies.
        shortest = vars(self).setdefault("shortest", self.delay)
        self.longest_step = shortest / MIN_STEPS_PER_DELAY
        if not is_whole(pade) or not 1 <= pade <= 10:
            raise BlockError(
                f"'pade' of {owner} must be whole, from 1 to 10, not {shown(pade)}"
            )
        if points is not None:
            points = int(finite(owner, "points", points, minimum=20.0))
        self.pade, self.points, self.unit = int(pade), points, unit
        where = f"parameter 'initial_value' of {owner}"
        self.shape = finite_array(where, initial_value).shape
        self.size = prod(self.shape)
        # In units of the delay, so that the matrices are of moderate size; lowest power first.
        # The Padé approximant (n - 1, n) of exp(-s): a numerator of lower order has no
        # feedthrough, so that it breaks algebraic loops.
        n, whole = self.pade, factorial(2 * self.pade - 1)
        each = [factorial(2 * n - 1 - k) / whole for k in range(n + 1)]
        b = [(-1) ** k * comb(n - 1, k) * each[k] for k in range(n)]
        a = [comb(n, k) * each[k] for k in range(n + 1)]
        # `realization` takes the highest power first.
        self.A, self.B, self.C, _ = realization(owner, b[::-1], a[::-1])
        super().__init__(initial_value=initial_value)

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the approximant at rest, and no piece of the input."""
        return self.steady(p.initial_value) if name == "z" else super().initial(name, p)

    def steady(self, value: Array) -> Array:
        """Return the steady states of the approximant with an output `value` [as declared]."""
        return np.outer(-np.linalg.solve(self.A, self.B), value)

    def _delay(self, u: Signals) -> Array:
        """Return the delay [s]."""
        return np.float64(self.delay)

    def _late(
        self, t: Array, x: Signals, u: Signals, p: Signals, piece: Array
    ) -> Array:
        """Return the stored input of a `piece` at the delayed time."""
        then = t - self._delay(u)
        found = search(x.past, self.size, piece, then)
        late = interpolated(found, then, self.shape)
        return np.where(piece == 0, p.initial_value, late)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the stored input, or the output of the approximant where nothing is stored."""
        late = self._late(t, x, u, p, x.piece)
        linear = np.reshape(self.C @ x.z, self.shape)
        return {"y": np.where(count(x.past) == 0, linear, late)}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of the approximant, which are zero in a run."""
        rates = (self.A @ x.z + np.outer(self.B, u.u)) / self._delay(u)
        return {"z": np.where(count(x.past) == 0, rates, 0.0)}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the time of the next jump of the output, or of the next required stored input."""
        found = search(x.past, self.size, x.piece, t)
        required = found[1] + self.longest_step
        return {"again": np.minimum(required, found[0] + self.delay)}

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Go to the piece of the input at the delayed time, and set the approximant to the steady state."""
        then = t - self._delay(u)
        then = then + SWITCHING_MARGIN * self.delay + ROUND_OFF * np.abs(t)
        piece = search(x.past, self.size, x.piece, then)[2]
        return {"piece": piece, "z": self.steady(self._late(t, x, u, p, piece))}


class VariableDelay(TransportDelay):
    r"""Delay a signal by a time that varies, y(t) = u(t - τ(t)), with y0 before the first input.

    It stores and interpolates the input as `TransportDelay` does. A faster growing τ, above 1 s/s, plays the
    input backwards. Steps are at most a fifth of the shortest delay. Linear models have the Padé approximant of
    the present delay, also in `frequency_response`.

    Parameters
    ----------
    shortest, longest : float
        Limits of τ, to which the input `tau` is clipped; 0 < shortest <= longest <= 1e5 shortest [s].
    initial_value : array_like
        y_0 [unit]; its shape is that of the signal.
    pade : int
        Order of the approximant [-].
    points : int, optional
        Largest number of stored points [-], as for `TransportDelay`.
    unit : str, tuple of str or None
        Unit of the signal, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If a limit or the order is not allowed.
    """

    tau = Input(unit="s", meaning="τ, the delay")
    onwards, backwards = Event("rising"), Event("falling")
    _symbol = Symbol("e^(−τ·s)")

    def __init__(
        self,
        shortest: float,
        longest: float,
        initial_value: npt.ArrayLike = 0.0,
        *,
        pade: int = 6,
        points: int | None = None,
        unit: Unit = None,
    ) -> None:
        self.shortest = finite("VariableDelay", "shortest", shortest, above=0.0)
        limits = {"minimum": self.shortest, "maximum": MAX_RATIO * self.shortest}
        longest = finite("VariableDelay", "longest", longest, **limits)
        super().__init__(longest, initial_value, pade=pade, points=points, unit=unit)

    def _delay(self, u: Signals) -> Array:
        """Return the delay within its limits [s]."""
        return np.clip(u.tau, self.shortest, self.delay)

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return how far the delayed time is beyond the ends of the present piece of the input."""
        then = t - self._delay(u)
        # Called with a time that does not depend on an input, as a time event must not.
        found = search(x.past, self.size, x.piece, t)
        before = search(x.past, self.size, x.piece - 1.0, t)
        # Later than the other event, so that they do not alternate, and than `on_event` needs.
        margin = 2.0 * SWITCHING_MARGIN * self.delay
        return {
            "again": found[1] + self.longest_step,
            "onwards": np.maximum(then - found[0], -self.delay),
            "backwards": np.maximum(then - before[0], -self.delay) + margin,
        }
