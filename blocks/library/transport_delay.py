"""Transport delay in continuous time."""

from __future__ import annotations

import math
from bisect import bisect_right
from math import comb, factorial, prod
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import (
    Attribute,
    Event,
    Parameter,
    Signals,
    State,
)
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.linear import realization
from trussflow.blocks.library.piecewise import NO_LIMIT
from trussflow.blocks.library.signals import finite
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, is_whole, shown

TIME_TOLERANCE, JUMP_TOLERANCE = 1e-9, 1e-7
"""Tolerance of equal times, relative to the delay; smallest relative change at equal times that is a jump."""

ROUND_OFF_PLACES = 4
"""Largest round-off of a sum of times [units in the last place]."""

MIN_STEPS_PER_DELAY = 5
"""Smallest number of steps in a delay, as the input is stored at steps only [-]."""


Piece = tuple[list[float], list[Vector]]
"""Times [s], and the inputs at these times."""


class TransportDelay(Block):
    r"""Delay a signal by a fixed time, y(t) = u(t - τ), with y0 before the first input.

    In a run, the input is stored at each accepted step, and interpolated by cubic polynomials. So the error
    is of fourth order in the step for a smooth signal, regardless of the tolerances. Steps are at most a
    fifth of the delay. A jump of a source, of a sampled block or at an event is delayed exactly, with every
    solver. The block breaks algebraic loops. Steps are taken in Python.

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
    unit : str, tuple of str or None
        Unit of the signal, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the delay or the order is not allowed.
    """

    traced: ClassVar[bool] = False

    u = Input("shape", unit=Attribute("unit"), meaning="signal to delay")
    y = Output("shape", unit=Attribute("unit"), meaning="the signal, later")
    z = State(("pade", "size"), meaning="states of the approximant")
    again = Event("time")
    initial_value = Parameter(shape="shape", meaning="y_0")
    _symbol = Symbol("e^(−{delay}·s)")

    def __init__(
        self,
        delay: float,
        initial_value: npt.ArrayLike = 0.0,
        *,
        pade: int = 6,
        unit: Unit = None,
    ) -> None:
        self.delay = finite("TransportDelay", "delay", delay, above=0.0)
        if not is_whole(pade) or not 1 <= pade <= 10:
            raise BlockError(
                f"'pade' of TransportDelay must be whole, from 1 to 10, not {shown(pade)}"
            )
        self.pade, self.unit = int(pade), unit
        where = "parameter 'initial_value' of TransportDelay"
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
        self.A, self.B, self.C, _ = realization("TransportDelay", b[::-1], a[::-1])
        super().__init__(initial_value=initial_value)

    def steady(self, value: Array) -> Vector:
        """Return the steady states of the approximant with an output `value` [as declared]."""
        found: Vector = np.outer(-np.linalg.solve(self.A, self.B), value)
        return found

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the approximant at rest."""
        return self.steady(p.initial_value)

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return that there is no direct feedthrough."""
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


class History(Running):
    """Stored inputs of a delay in one run; before the first event, the output is that of the approximant.

    The history consists of pieces, between which the input jumps. The output is interpolated in the first
    piece, which an event replaces by the next one, so that jumps are not smoothed.

    Parameters
    ----------
    block : TransportDelay
        The block.
    """

    sees_jumps = False

    def __init__(self, block: TransportDelay) -> None:
        self._block = block
        self._pieces: list[Piece] = []

    def _note(self, t: float, u: Vector) -> None:
        """Store the input at a time, and delete inputs that are no longer needed."""
        times, values = self._pieces[-1]
        if self._jumps(t, u):
            self._pieces.append(([t], [u.copy()]))
        elif t - times[-1] > TIME_TOLERANCE * self._block.delay:
            times.append(t)
            values.append(u.copy())
        times, values = self._pieces[0]
        # rows of this step are logged later
        # Two points before are kept for the cubic. Removal from the front moves the
        # whole list, so that it is done for 100 points at once.
        out = bisect_right(times, t - 2.0 * self._block.delay) - 2
        if out > 100:
            del times[:out], values[:out]

    def _jumps(self, t: float, u: Vector) -> bool:
        """Return whether the input differs from the stored one at the same time."""
        times, values = self._pieces[-1]
        size = np.abs(values[-4:]).max(initial=0.0)
        moved = np.abs(u - values[-1]).max(initial=0.0)
        return bool(
            t - times[-1] <= TIME_TOLERANCE * self._block.delay
            and moved > JUMP_TOLERANCE * size
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the delayed input, by cubic Lagrange interpolation of the four nearest points."""
        if not self._pieces:
            return {"y": np.reshape(self._block.C @ x.z, self._block.shape)}
        times, values = self._pieces[0]
        then = min(max(float(t) - self._block.delay, times[0]), times[-1])
        k = min(bisect_right(times, then), len(times) - 1)
        # Two points on each side; at the ends of a piece fewer, with a lower order.
        near = slice(max(0, k - 2), k + 2)
        points = np.array(times[near])
        # Lagrange weights: products of (then - p_j) / (p_i - p_j) over all j except i.
        # The identity avoids a division by zero for j = i.
        gaps = points[:, None] - points + np.eye(len(points))
        ratios = (then - points[None, :]) / gaps
        np.fill_diagonal(ratios, 1.0)
        return {"y": np.tensordot(ratios.prod(axis=1), np.array(values[near]), 1)}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of the approximant, which are zero in a run."""
        block = self._block
        rates = (block.A @ x.z + np.outer(block.B, u.u)) / block.delay
        return {"z": 0.0 * x.z if self._pieces else rates}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the time of the next jump of the output, or of the next required stored input."""
        if not self._pieces:
            # An event in the past is due at once: it starts the history.
            return {"again": np.float64(-NO_LIMIT)}
        if self._jumps(float(t), u.u):
            return {"again": t}
        known = self._pieces[-1][0][-1] + self._block.delay / MIN_STEPS_PER_DELAY
        return {"again": np.float64(min(known, self._next_jump()))}

    def _next_jump(self) -> float:
        """Return the time at which the next piece replaces the first [s]."""
        if not self._pieces[1:]:
            return math.inf
        return self._pieces[0][0][-1] + self._block.delay

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Store the input, and set the approximant to the steady state of the output."""
        now = float(t)
        if not self._pieces:
            # The first piece holds the initial value, until the delay has passed.
            self._pieces.append(([now], [np.array(p.initial_value)]))
            self._pieces.append(([now], [u.u.copy()]))
        self._note(now, u.u)
        # The event is at the rounded sum of a time and the delay. Without the
        # tolerance, the same jump could be due again at once.
        while self._next_jump() <= now + ROUND_OFF_PLACES * math.ulp(now):
            del self._pieces[0]
        return {"z": self._block.steady(self.output(t, x, u, p)["y"])}

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Store the input."""
        self._note(float(t), u.u)
        return False

    def save(self) -> Any:
        """Return the history."""
        return [(times[:], values[:]) for times, values in self._pieces]

    def restore(self, saved: Any) -> None:
        """Restore the history."""
        self._pieces = [(times[:], values[:]) for times, values in saved]
