"""Nonlinear blocks: limits of size and of rate, and steps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.library.signals import Shaped, ShapeLike
from trussflow.blocks.support.types import Array


class Limits(Shaped):
    """Base of blocks with a lower and an upper limit: the limits, and their checks.

    Parameters
    ----------
    lower, upper : array_like
        The limits [unit of the input]; one number, or one per element.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the limits, or from the wires.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="unlimited signal")
    lower = Parameter(shape=None, meaning="lower limit")
    upper = Parameter(shape=None, meaning="upper limit")

    def __init__(
        self, lower: npt.ArrayLike, upper: npt.ArrayLike, *, shape: ShapeLike = None
    ) -> None:
        super().__init__(shape, lower=lower, upper=upper)


class Saturation(Limits):
    r"""Limit a signal, element by element, y = min(max(u, l), h).

    Parameters
    ----------
    lower, upper : array_like
        l ≤ h [unit of the input]; one number, or one per element.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the limits, or from the wires.

    Raises
    ------
    ParameterError
        If a lower limit exceeds the upper one, or shapes disagree.
    """

    y = Output(INFERRED, unit=INFERRED, frame=INFERRED, meaning="limited signal")
    _symbol = Symbol(curve="M2 20h8L26 4h8", caption="limits {lower}, {upper}")

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the limited signal."""
        return {"y": limited(u.u, p.lower, p.upper)}


class DeadZone(Limits):
    r"""Dead zone, y = u - min(max(u, l), h).

    Parameters
    ----------
    lower, upper : array_like
        l ≤ h [unit of the input]; one number, or one per element.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the limits, or from the wires.

    Raises
    ------
    ParameterError
        If a lower limit exceeds the upper one, or shapes disagree.
    """

    y = Output(
        INFERRED,
        unit=INFERRED,
        frame=INFERRED,
        meaning="distance of the input from the zone",
    )
    _symbol = Symbol(curve="M2 22L11 12H25L34 2", caption="{lower} to {upper}")

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signed distance of the input from the zone."""
        return {"y": u.u - limited(u.u, p.lower, p.upper)}


class Remembering(Shaped):
    """Base of sampled blocks with their last output, y, as state.

    Parameters
    ----------
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the parameters, or from the wires.
    **parameters : array_like
        Parameters of the block.
    """

    previous = State(INFERRED, meaning="output of the sample before")

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the output as the next state."""
        return {"previous": self.output(t, x, u, p)["y"]}


class RateLimiter(Remembering):
    r"""Follow a signal no faster than allowed, in samples.

    .. math:: y_k = y_{k-1} + \min(\max(u_k - y_{k-1}, -f T_s), r T_s)

    The block is sampled, because a continuous rate limit is a switching law that makes
    solvers chatter. The first output is the first input.

    Parameters
    ----------
    rising : array_like
        r ≥ 0 [unit/s]; one number, or one per element.
    sample_time : float
        T_s > 0 [s].
    falling : array_like, optional
        f ≥ 0 [unit/s]; by default as `rising`.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the rates, or from the wires.

    Raises
    ------
    ParameterError
        If a rate is negative, or shapes disagree.
    BlockError
        If the sample time is not above 0.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="signal to follow")
    y = Output(
        INFERRED, unit=INFERRED, frame=INFERRED, meaning="signal of limited rate"
    )
    rising = Parameter(shape=None, minimum=0.0, meaning="r: largest rate of increase")
    falling = Parameter(shape=None, minimum=0.0, meaning="f: largest rate of decrease")
    _symbol = Symbol(
        curve="M2 21h8L26 3h8M10 21V3h16", caption="−{falling} to {rising} per s"
    )

    def __init__(
        self,
        rising: npt.ArrayLike,
        sample_time: float,
        *,
        falling: npt.ArrayLike | None = None,
        shape: ShapeLike = None,
    ) -> None:
        super().__init__(
            shape, rising=rising, falling=rising if falling is None else falling
        )
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signal of limited rate."""
        step = self.sample_time
        change = limited(u.u - x.previous, -p.falling * step, p.rising * step)
        return {"y": x.previous + change}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Start at the first input."""
        return {"previous": u.u}


class Backlash(Remembering):
    r"""Backlash: the output moves only after the input has crossed the gap; sampled.

    .. math:: y_k = \min(\max(y_{k-1}, u_k - w/2), u_k + w/2)

    The samples are exact if the input does not reverse between two of them. The first output is the first
    input.

    Parameters
    ----------
    width : array_like
        w ≥ 0: the whole gap [unit]; one number, or one per element.
    sample_time : float
        T_s > 0 [s].
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the width, or from the wires.

    Raises
    ------
    ParameterError
        If the width is negative, or shapes disagree.
    BlockError
        If the sample time is not above 0.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="driving side")
    y = Output(INFERRED, unit=INFERRED, frame=INFERRED, meaning="driven side")
    width = Parameter(shape=None, minimum=0.0, meaning="w: the whole gap")
    _symbol = Symbol(curve="M2 20H20L28 4H34M8 20L16 4H28", caption="gap {width}")

    def __init__(
        self, width: npt.ArrayLike, sample_time: float, *, shape: ShapeLike = None
    ) -> None:
        super().__init__(shape, width=width)
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the driven side."""
        return {"y": limited(x.previous, u.u - p.width / 2.0, u.u + p.width / 2.0)}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Start at the first input."""
        return {"previous": u.u}


class Quantizer(Remembering):
    r"""Round a signal to multiples of a quantum, in samples.

    .. math:: y_k = q\,\mathrm{round}(u_k / q) \quad\text{if } |u_k - y_{k-1}| > (\tfrac12 + h)\, q,
              \qquad y_k = y_{k-1} \text{ otherwise}

    and 0 if this is below the smallest nonzero output. Without hysteresis the error is at most q/2
    wherever u exceeds the smallest nonzero output.

    Parameters
    ----------
    quantum : array_like
        q > 0 [unit]; one number, or one per element.
    sample_time : float
        T_s > 0 [s].
    hysteresis : array_like
        h ≥ 0: how far beyond the middle between two multiples the input must be [quanta].
    smallest : array_like
        Outputs below it in size are 0 [unit].
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the parameters, or from the wires.

    Raises
    ------
    ParameterError
        If the quantum is not above 0, another parameter negative, or shapes disagree.
    BlockError
        If the sample time is not above 0.

    Notes
    -----
    For sigma-delta modulation, where the sum of the output follows that of the input, add the quantization
    error of the previous sample to the input: input minus output through a `UnitDelay`.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="signal to round")
    y = Output(
        INFERRED, unit=INFERRED, frame=INFERRED, meaning="multiple of the quantum"
    )
    quantum = Parameter(shape=None, above=0.0, meaning="q: step between outputs")
    hysteresis = Parameter(
        shape=None, minimum=0.0, meaning="h: beyond the middle of a step, in quanta"
    )
    smallest = Parameter(
        shape=None, minimum=0.0, meaning="smallest output that is not 0"
    )
    _symbol = Symbol(curve="M2 21h8v-6h8v-6h8v-6h8", caption="steps of {quantum}")

    def __init__(
        self,
        quantum: npt.ArrayLike,
        sample_time: float,
        *,
        hysteresis: npt.ArrayLike = 0.0,
        smallest: npt.ArrayLike = 0.0,
        shape: ShapeLike = None,
    ) -> None:
        super().__init__(
            shape, quantum=quantum, hysteresis=hysteresis, smallest=smallest
        )
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the multiple of the quantum."""
        # A comparison with NaN is false: NaN comes out as NaN.
        stays = np.abs(u.u - x.previous) <= (0.5 + p.hysteresis) * p.quantum
        y = np.where(stays, x.previous, p.quantum * np.rint(u.u / p.quantum))
        # With the tolerance, a multiple equal to the smallest output up to round-off
        # does not become 0.
        return {"y": np.where(np.abs(y) < p.smallest - 1e-9 * p.quantum, 0.0, y)}
