"""Delays in continuous time, fixed and as a signal: what comes in goes out later."""

from __future__ import annotations

import math
from bisect import bisect_right
from math import comb, factorial, prod
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Event, Parameter, Signals, State
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.running import Running
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.framework.validation import finite_array, is_whole, shown
from trussflow.blocks.library.linear import realization
from trussflow.blocks.library.piecewise import NO_LIMIT
from trussflow.blocks.library.signals import finite

CLOSE, JUMP = 1e-9, 1e-7
"""Times are the same within this part of the delay; a signal that then moves by this part of itself jumps."""

PLACES = 4
"""Last places of a time by which sums of times may differ [-]."""

PER_DELAY = 5
"""Into how many steps a delay is divided at least: what comes in is known at steps only."""


Piece = tuple[list[float], list[Vector]]
"""Times [s], and what came in then."""


class DelayLine(Block):
    """Base of the delays: a history in runs, a Padé approximant in linear models.

    Parameters
    ----------
    shortest, longest : float
        Between which the delay is [s].
    initial_value : array_like
        What comes out before the first input does [unit].
    pade : int
        Order of the approximant [-].
    unit : str, tuple of str or None
        Unit of the signal.

    Raises
    ------
    BlockError
        If the order makes no sense.
    """

    traced: ClassVar[bool] = False

    u = Input("shape", unit=Attribute("unit"), meaning="signal to delay")
    y = Output("shape", unit=Attribute("unit"), meaning="the signal, later")
    z = State(("pade", "size"), meaning="states of the approximant")
    again = Event("time")
    initial_value = Parameter(shape="shape", meaning="y_0")

    def __init__(
        self, shortest: float, longest: float, initial_value: npt.ArrayLike, pade: int, unit: Unit
    ) -> None:
        name = type(self).__name__
        if not is_whole(pade) or not 1 <= pade <= 10:
            raise BlockError(f"'pade' of {name} must be whole, from 1 to 10, not {shown(pade)}")
        self.shortest, self.longest, self.pade, self.unit = shortest, longest, int(pade), unit
        self.shape = finite_array(f"parameter 'initial_value' of {name}", initial_value).shape
        self.size = prod(self.shape)
        # In units of the delay, so that the matrices are of moderate size; lowest power first.
        n, whole = self.pade, factorial(2 * self.pade - 1)
        each = [factorial(2 * n - 1 - k) / whole for k in range(n + 1)]
        b = [(-1) ** k * comb(n - 1, k) * each[k] for k in range(n)]
        a = [comb(n, k) * each[k] for k in range(n + 1)]
        self.A, self.B, self.C, _ = realization(name, b[::-1], a[::-1])
        super().__init__(initial_value=initial_value)

    def length(self, u: Signals) -> float:
        """Return how long the delay is now, with the inputs `u` [s]."""
        return self.longest

    def steady(self, value: Array) -> Vector:
        """Return the states of the approximant at rest that give an output `value` [as declared]."""
        found: Vector = np.outer(-np.linalg.solve(self.A, self.B), value)
        return found

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the approximant at rest."""
        return self.steady(p.initial_value)

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return that nothing comes out at once."""
        return {"y": ()}

    @property
    def continuous(self) -> bool:
        """Whether there are continuous states: those of the approximant."""
        return True

    @property
    def has_events(self) -> bool:
        """Whether there are events: at the start, and where steps would be longer than the delay."""
        return True

    def open(self, p: Signals) -> History:
        """Return the history of one run."""
        return History(self)


class TransportDelay(DelayLine):
    r"""Delay a signal by a fixed time: :math:`y(t) = u(t - \tau)`, and y_0 before the first input comes out.

    In a run the input of each accepted step is kept, and read between two steps by cubic interpolation, so
    the error is of fourth order in the step for a smooth signal, whatever the tolerances; steps are no
    longer than a fifth of the delay. A jump, of a source, a sampled block or at an event, comes out as a
    jump, at its time, with every solver. It breaks algebraic loops. Steps are taken in Python.

    In linear models it is a Padé approximant, whose states are integrated beside it; `frequency_response`
    has the exact delay.

    Parameters
    ----------
    delay : float
        τ > 0 [s].
    initial_value : array_like
        y_0 [unit]; its shape is that of the signal.
    pade : int
        Order of the approximant n, with a numerator of order n - 1 [-]; its phase is right up to about
        n / τ rad/s.
    unit : str, tuple of str or None
        Unit of the signal, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the delay or the order makes no sense.
    """

    def __init__(
        self, delay: float, initial_value: npt.ArrayLike = 0.0, *, pade: int = 6, unit: Unit = None
    ) -> None:
        self.delay = finite("TransportDelay", "delay", delay, above=0.0)
        super().__init__(self.delay, self.delay, initial_value, pade, unit)


class VariableDelay(DelayLine):
    r"""Delay a signal by a time that is a signal, too: :math:`y(t) = u(t - \tau(t))`.

    A delay that is shorter or longer than allowed counts as the shortest or the longest. While it grows at
    a rate of :math:`\dot\tau`, what comes out is slower by the factor :math:`1 - \dot\tau`, as a tone is
    lower; if it grows faster than time goes on, what has come out comes out again. For the rest it is as
    `TransportDelay`, but that jumps are at their time within a step only, while the delay changes; steps
    are no longer than a fifth of the shortest delay, and what came in is kept for twice the longest.

    In linear analysis the delay is frozen at the operating point, where changes of the delay have no
    influence at rest. Linear models have a Padé approximant, and `frequency_response` the exact delay.

    Parameters
    ----------
    shortest, longest : float
        Bounds of τ, 0 < shortest < longest [s].
    initial_value : array_like
        What comes out before the first input does [unit]; its shape is that of the signal.
    pade : int
        Order of the approximant, as for `TransportDelay` [-].
    unit : str, tuple of str or None
        Unit of the signal, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the times or the order make no sense.
    """

    delay = Input(unit="s", meaning="τ: how long ago")

    def __init__(
        self,
        shortest: float,
        longest: float,
        initial_value: npt.ArrayLike = 0.0,
        *,
        pade: int = 6,
        unit: Unit = None,
    ) -> None:
        shortest = finite("VariableDelay", "shortest", shortest, above=0.0)
        longest = finite("VariableDelay", "longest", longest, above=shortest)
        super().__init__(shortest, longest, initial_value, pade, unit)

    def length(self, u: Signals) -> float:
        """Return the delay within its bounds, with the inputs `u` [s]."""
        return float(np.clip(u.delay, self.shortest, self.longest))

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return that the delay matters at once, the signal later."""
        return {"y": ("delay",)}


class History(Running):
    """What came into a delay in one run; before the first event it is the approximant.

    It is kept in pieces, between which the input jumps. What comes out is read from the first of them, which
    gives way to the next at an event: so a jump comes out as a jump. A delay that grows faster than time goes
    on leads back to pieces that had given way.

    Parameters
    ----------
    block : DelayLine
        The block.
    """

    sees_jumps = False

    def __init__(self, block: DelayLine) -> None:
        self._block = block
        self._pieces: list[Piece] = []
        self._past: list[Piece] = []

    def _note(self, t: float, u: Vector) -> None:
        """Keep the input at a time, and forget what has come out long ago."""
        times, values = self._pieces[-1]
        if self._jumps(t, u):
            self._pieces.append(([t], [u.copy()]))
        elif t - times[-1] > CLOSE * self._block.shortest:
            times.append(t)
            values.append(u.copy())
        times, values = self._pieces[0]
        out = bisect_right(times, t - 2.0 * self._block.longest) - 2  # rows of this step are logged later
        if out > 100:
            del times[:out], values[:out]
        while self._past[1:] and self._past[1][0][0] < t - 2.0 * self._block.longest:
            del self._past[0]

    def _jumps(self, t: float, u: Vector) -> bool:
        """Return whether the input is another than it was at that very time."""
        times, values = self._pieces[-1]
        size = np.abs(values[-4:]).max(initial=0.0)
        moved = np.abs(u - values[-1]).max(initial=0.0)
        return bool(t - times[-1] <= CLOSE * self._block.shortest and moved > JUMP * size)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what came in before, by a cubic through the four points around it."""
        if not self._pieces:
            return {"y": np.reshape(self._block.C @ x.z, self._block.shape)}
        then = float(t) - self._block.length(u)
        times, values = self._pieces[0]
        for earlier in reversed(self._past):
            if self._is_in(then, times):
                break
            times, values = earlier
        then = min(max(then, times[0]), times[-1])
        k = min(bisect_right(times, then), len(times) - 1)
        near = slice(max(0, k - 2), k + 2)
        points = np.array(times[near])
        gaps = points[:, None] - points + np.eye(len(points))
        ratios = (then - points[None, :]) / gaps
        np.fill_diagonal(ratios, 1.0)
        return {"y": np.tensordot(ratios.prod(axis=1), np.array(values[near]), 1)}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of the approximant, which rests in a run."""
        block = self._block
        rates = (block.A @ x.z + np.outer(block.B, u.u)) / block.length(u)
        return {"z": 0.0 * x.z if self._pieces else rates}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return when what comes out jumps next, or up to when enough of what comes in is known."""
        if not self._pieces:
            return {"again": np.float64(-NO_LIMIT)}
        if self._jumps(float(t), u.u):
            return {"again": t}
        known = self._pieces[-1][0][-1] + self._block.shortest / PER_DELAY
        return {"again": np.float64(min(known, self._next_jump(u)))}

    def _next_jump(self, u: Signals) -> float:
        """Return when the first piece gives way to the next [s]."""
        return self._pieces[0][0][-1] + self._block.length(u) if self._pieces[1:] else math.inf

    def _is_in(self, then: float, times: list[float]) -> bool:
        """Return whether a time is not before a piece of these times."""
        return then >= times[0] - CLOSE * self._block.shortest

    def _go_back(self, now: float, u: Signals) -> None:
        """Read from a piece again that had given way."""
        while self._past and not self._is_in(now - self._block.length(u), self._pieces[0][0]):
            self._pieces.insert(0, self._past.pop())

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        """Keep the input, and let the approximant rest where the output is."""
        now = float(t)
        if not self._pieces:
            self._pieces.append(([now], [np.array(p.initial_value)]))
            self._pieces.append(([now], [u.u.copy()]))
        self._note(now, u.u)
        self._go_back(now, u)
        while self._next_jump(u) <= now + PLACES * math.ulp(now):
            self._past.append(self._pieces.pop(0))
        return {"z": self._block.steady(self.output(t, x, u, p)["y"])}

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Keep the input."""
        self._note(float(t), u.u)
        self._go_back(float(t), u)
        return False

    def save(self) -> Any:
        """Return the history."""
        return _copied(self._past), _copied(self._pieces)

    def restore(self, saved: Any) -> None:
        """Take it back."""
        self._past, self._pieces = map(_copied, saved)


def _copied(pieces: list[Piece]) -> list[Piece]:
    return [([*times], [v.copy() for v in values]) for times, values in pieces]
