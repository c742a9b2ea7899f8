"""Switching blocks: relays, switches, pulses, limited integrators, stop conditions.

They declare events and modes, so every solver locates the switching times.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError, ParameterError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import (
    Attribute,
    Event,
    Mode,
    Parameter,
    Signals,
)
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.continuous import Integrator
from trussflow.blocks.library.piecewise import NO_LIMIT, limited
from trussflow.blocks.library.signals import Shaped, ShapeLike, finite, per_time
from trussflow.blocks.library.sources import Source
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array, shown, yes_or_no


class Relay(Shaped):
    r"""Relay with hysteresis: on above an upper level, off below a lower level.

    .. math:: y = y_1 \text{ once } u \ge h, \qquad y = y_0 \text{ once } u \le l

    Between the levels, the output does not change; `start_on` determines its initial value there.

    Parameters
    ----------
    upper, lower : array_like
        h ≥ l [unit of the input]; one number, or one per element.
    on, off : array_like
        y_1 and y_0 [unit of the output].
    start_on : bool
        Whether it is on at the start, if the input is between the levels.
    unit : str, tuple of str or None
        Unit of the output; None leaves it unchecked.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the levels, or from the wires.

    Raises
    ------
    ParameterError
        If the levels contradict each other, or shapes disagree.
    """

    u = Input(INFERRED, meaning="signal to compare with the levels")
    y = Output(INFERRED, unit=Attribute("unit"), meaning="one of two values")
    is_on = Mode(0.0, INFERRED, meaning="whether it is on")
    rises = Event("rising", INFERRED)
    falls = Event("falling", INFERRED)
    upper = Parameter(shape=None, meaning="h: level at which it switches on")
    lower = Parameter(shape=None, meaning="l: level at which it switches off")
    on = Parameter(shape=None, meaning="y_1: output while on")
    off = Parameter(shape=None, meaning="y_0: output while off")

    def __init__(
        self,
        upper: npt.ArrayLike = 0.0,
        lower: npt.ArrayLike | None = None,
        *,
        on: npt.ArrayLike = 1.0,
        off: npt.ArrayLike = 0.0,
        start_on: bool = False,
        unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        yes_or_no("Relay", "start_on", start_on)
        self.unit, self.start_on = unit, bool(start_on)
        super().__init__(
            shape, upper=upper, lower=upper if lower is None else lower, on=on, off=off
        )

    @property
    def _symbol(self) -> Symbol:
        falls = np.all(self.parameters["on"] < self.parameters["off"])
        return Symbol(
            curve="M2 4h20V20M14 4V20h20" if falls else "M2 20h20V4M14 20V4h20",
            caption="{on} above {upper}\n{off} below {lower}",
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value of the on or off state."""
        return {"y": np.where(x.is_on > 0.5, p.on, p.off)}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return the initial mode from the input."""
        return {
            "is_on": np.where(
                u.u >= p.upper, 1.0, np.where(u.u <= p.lower, 0.0, float(self.start_on))
            )
        }

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the distance of the input above the levels."""
        return {"rises": u.u - p.upper, "falls": u.u - p.lower}

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Switch."""
        return {
            "is_on": np.where(fired.rises, 1.0, np.where(fired.falls, 0.0, x.is_on))
        }


class Switch(Shaped):
    r"""Select one of several signals by a control signal.

    .. math:: y = u_{1 + n}, \qquad n = \text{number of thresholds that } c \text{ has reached}

    Parameters
    ----------
    thresholds : float or sequence of float
        Increasing thresholds [unit of the control], one less than the signals ``u1``, ``u2``, ... One
        threshold selects between two signals; 0.5, 1.5 and 2.5 among four by the number 0, 1, 2 or 3.
    shape : int, tuple of int or None
        Shape of the signals [-]; None takes it from the wires.

    Raises
    ------
    BlockError
        If the thresholds do not increase.

    Notes
    -----
    If the control jumps (it is sampled, or an external input), the switch follows at the same time, but the
    log of that instant still has the signal before.
    """

    control = Input(meaning="c: control signal")
    y = Output(INFERRED, unit=INFERRED, frame=INFERRED, meaning="the selected signal")
    reached = Mode(0.0, "number", meaning="whether each threshold is reached")
    rises, falls = Event("rising", "number"), Event("falling", "number")
    _symbol = Symbol(
        curve="M0 4h10L26 11M0 20h10M27 12h9", caption="control at {thresholds}"
    )

    def __init__(
        self, thresholds: float | Sequence[float] = 0.5, *, shape: ShapeLike = None
    ) -> None:
        levels = np.atleast_1d(finite_array("thresholds of Switch", thresholds))
        if levels.ndim != 1 or not levels.size or np.any(np.diff(levels) <= 0):
            raise BlockError(
                f"Switch needs increasing thresholds; got {shown(thresholds)}"
            )
        self.thresholds, self.number = levels, levels.size
        self.extra_ports = {
            f"u{i}": Input(
                INFERRED, unit=INFERRED, frame=INFERRED, meaning=f"signal {i}"
            )
            for i in range(1, levels.size + 2)
        }
        super().__init__(shape)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signal of the last threshold reached."""
        chosen = u.u1
        for i in range(self.number):
            chosen = np.where(x.reached[i] > 0.5, u[f"u{i + 2}"], chosen)
        return {"y": chosen}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return the thresholds that the control has reached at the start."""
        return {"reached": np.where(u.control >= self.thresholds, 1.0, 0.0)}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the distance of the control above the thresholds."""
        return {
            "rises": u.control - self.thresholds,
            "falls": u.control - self.thresholds,
        }

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Switch."""
        return {
            "reached": np.where(fired.rises, 1.0, np.where(fired.falls, 0.0, x.reached))
        }


class Pulse(Source):
    r"""Pulse train (square wave): high for a part of each period.

    .. math:: y = y_1 \text{ for } 0 \le t - t_0 - k T < w T, \; k \ge 0, \qquad y = y_0 \text{ otherwise}

    Every solver stops exactly at each edge.

    Parameters
    ----------
    period : float
        T > 0 [s].
    width : float
        w: part of the period for which it is high, between 0 and 1 [-].
    delay : float
        t_0: time of the first rising edge [s].
    high, low : array_like
        y_1 and y_0 [unit].
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If a time is not allowed.
    """

    is_high = Mode(0.0, meaning="whether it is high")
    next_edge = Mode(-NO_LIMIT, meaning="time of the next edge")
    edge = Event("time")
    high = Parameter(shape="shape", meaning="y_1")
    low = Parameter(shape="shape", meaning="y_0")
    _symbol = Symbol(
        curve="M2 20h6V4h8v16h8V4h8v16", caption="{period} s, {low} or {high} {unit}"
    )

    def __init__(
        self,
        period: float = 1.0,
        width: float = 0.5,
        *,
        delay: float = 0.0,
        high: npt.ArrayLike = 1.0,
        low: npt.ArrayLike = 0.0,
        unit: Unit = None,
    ) -> None:
        self.period = finite("Pulse", "period", period, above=0.0)
        self.width = finite("Pulse", "width", width, above=0.0, below=1.0)
        self.delay = finite("Pulse", "delay", delay)
        super().__init__(unit, high=high, low=low)

    def _at(self, t: Array) -> Values:
        """Return the modes from a time on; a time equal to that of an edge up to round-off is after it."""
        turns = (t - self.delay) / self.period
        # Number of periods that have begun, less one; -1 before t_0, which makes t_0
        # the next edge.
        begun = np.maximum(np.floor(turns + 1e-9), -1.0)
        high = np.logical_and(begun >= 0.0, turns - begun < self.width - 1e-9)
        next_edge = self.delay + self.period * (begun + np.where(high, self.width, 1.0))
        return {"is_high": np.where(high, 1.0, 0.0), "next_edge": next_edge}

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value; before the first event it is computed from the time."""
        # The first event is due at the start (next_edge in the past) and sets both
        # modes, but outputs are computed before.
        is_high: Array = np.where(
            x.next_edge > -NO_LIMIT, x.is_high, self._at(t)["is_high"]
        )
        return {"y": np.where(is_high > 0.5, p.high, p.low)}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the time of the next edge."""
        return {"edge": x.next_edge}

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Return the modes after an edge."""
        return self._at(t)


class LimitedIntegrator(Integrator):
    r"""Integrate a signal between limits.

    .. math:: \dot y = u \text{ while } l < y < h, \text{ at limits inwards}

    The solver locates the limits, so the integral does not exceed them. In a group made by `enabled` with
    ``states="reset"``, the integral starts anew at each enabling.

    Parameters
    ----------
    initial_value : array_like
        Integral at time 0 [unit]; one number, or one per element.
    lower, upper : array_like
        l < h [unit]; by default none.
    unit : str, tuple of str or None
        Unit of y, or one per element; None leaves units unchecked.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from initial value and limits, or from the wires.

    Raises
    ------
    ParameterError
        If the limits contradict each other, or shapes disagree.
    """

    side = Mode(
        0.0, INFERRED, meaning="1 while at the upper limit, -1 while at the lower one"
    )
    high, low = Event("rising", INFERRED), Event("falling", INFERRED)
    leaves_high, leaves_low = Event("falling", INFERRED), Event("rising", INFERRED)
    lower = Parameter(shape=None, meaning="l: lower limit")
    upper = Parameter(shape=None, meaning="h: upper limit")
    _symbol = Symbol("1\n-\ns", caption="from {initial_value}, limits {lower}, {upper}")

    def __init__(
        self,
        initial_value: npt.ArrayLike = 0.0,
        *,
        lower: npt.ArrayLike = -NO_LIMIT,
        upper: npt.ArrayLike = NO_LIMIT,
        unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        self.unit, self.rate_unit = unit, per_time(unit)
        Shaped.__init__(
            self, shape, initial_value=initial_value, lower=lower, upper=upper
        )

    def check_parameters(self, p: Signals) -> None:
        """Check that each lower limit is below the upper one."""
        super().check_parameters(p)
        if np.any(p.lower == p.upper):
            raise ParameterError(
                f"the lower limit of {p.owner} must be below the upper one, {p.upper}"
            )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the limited integral, as the interpolation of a solver may exceed a limit."""
        return {"y": limited(x.integral, p.lower, p.upper)}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rate of the integral."""
        inwards = np.where(x.side > 0.5, np.minimum(u.u, 0.0), np.maximum(u.u, 0.0))
        return {"integral": np.where(x.side == 0.0, u.u, inwards)}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return the initial integral and mode, within the limits."""
        # The input adds nothing but its shape.
        begin = limited(p.initial_value + 0.0 * u.u, p.lower, p.upper)
        # At a limit, the integral rests only if the input drives it outwards.
        outwards = np.where(
            begin >= p.upper, u.u > 0.0, np.logical_and(begin <= p.lower, u.u < 0.0)
        )
        return {"integral": begin, "side": np.where(outwards, np.sign(u.u), 0.0)}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the distance of the integral from the limits, and the input."""
        return {
            "high": x.integral - p.upper,
            "low": x.integral - p.lower,
            "leaves_high": u.u,
            "leaves_low": u.u,
        }

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Return the mode after reaching or leaving a limit, and the integral at the limit."""
        # The located time may be slightly late, so that the integral is set to the
        # limit exactly. If the input has turned at the same instant, the integral moves
        # inwards by itself and does not rest.
        high = np.logical_and(fired.high, u.u > 0.0)
        low = np.logical_and(fired.low, u.u < 0.0)
        integral = np.where(high, p.upper, np.where(low, p.lower, x.integral))
        leaves = np.where(
            x.side > 0.5,
            fired.leaves_high,
            np.logical_and(x.side < -0.5, fired.leaves_low),
        )
        side = np.where(high, 1.0, np.where(low, -1.0, np.where(leaves, 0.0, x.side)))
        return {"integral": integral, "side": side}


class StopWhen(Block):
    """End the run when a signal rises through zero.

    Connect ``a - b``, or a comparison ``a > b``, which ends the run when it becomes true. A signal that is
    positive at the start ends the run only when it rises again; a signal that is zero, when it first becomes
    positive. The solver locates the time. The result has the rows before, the status "ended", and the block
    and time in its attribute "ended". `Session.advance` raises a `RunEndedError`.

    Parameters
    ----------
    message : str
        Text for the attribute "ended" of the result.
    """

    u = Input(meaning="signal that ends the run")
    ends = Event("terminal")
    _symbol = Symbol("STOP")

    def __init__(self, message: object = "") -> None:
        self.message = message if isinstance(message, str) else ""
        super().__init__()

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the input."""
        return {"ends": u.u}
