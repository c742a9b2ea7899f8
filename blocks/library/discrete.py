"""Discrete blocks: sampled, with outputs held between the samples."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.clock import common_tick, exact
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.linear import Linear, realization
from trussflow.blocks.library.signals import Shaped, ShapeLike, finite
from trussflow.blocks.support.types import Array

MAX_DELAY_SAMPLES = 100
"""Largest number of unit delays in a sampled delay; more indicate an error in one of its times."""


class UnitDelay(Shaped):
    r"""Delay a signal by one sample.

    .. math:: y_k = u_{k-1}, \qquad y_0 \text{ as given}

    It breaks algebraic loops.

    Parameters
    ----------
    sample_time : float
        Time between samples [s].
    initial_value : array_like
        y_0 [unit of the input].
    offset : float
        First sample [s].
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from y_0, or from the wires.

    Raises
    ------
    BlockError
        If the sample time is not above 0, or the offset not within one sample.
    ParameterError
        If shapes disagree.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="signal to delay")
    y = Output(
        INFERRED, unit=INFERRED, frame=INFERRED, meaning="input of the sample before"
    )
    previous = State(
        INFERRED, initial="initial_value", meaning="input of the sample before"
    )
    initial_value = Parameter(shape=None, meaning="y_0: output of the first sample")
    _symbol = Symbol("z^(−1)", caption="from {initial_value}")

    def __init__(
        self,
        sample_time: float,
        initial_value: npt.ArrayLike = 0.0,
        *,
        offset: float = 0.0,
        shape: ShapeLike = None,
    ) -> None:
        super().__init__(shape, initial_value=initial_value)
        self.sampled(sample_time, offset)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the input of the sample before."""
        return {"y": x.previous}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the input as the next state."""
        return {"previous": u.u}


class ZeroOrderHold(Shaped):
    r"""Sample a signal and hold it until the next sample.

    .. math:: y(t) = u(k T_s), \qquad k T_s \le t < (k + 1) T_s

    Parameters
    ----------
    sample_time : float
        T_s > 0 [s].
    offset : float
        First sample [s]; the output is zero before.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the wires.

    Raises
    ------
    BlockError
        If the sample time is not above 0, or the offset not within one sample.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="signal to sample")
    y = Output(
        INFERRED, unit=INFERRED, frame=INFERRED, meaning="last sample of the input"
    )
    _symbol = Symbol(curve="M0 21h9v-7h9v-6h9v-5h9")

    def __init__(
        self, sample_time: float, *, offset: float = 0.0, shape: ShapeLike = None
    ) -> None:
        super().__init__(shape)
        self.sampled(sample_time, offset)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the input."""
        return {"y": u.u}


def sampled_delay(
    sample_time: float,
    delay: float,
    initial_value: npt.ArrayLike = 0.0,
    *,
    shape: ShapeLike = None,
) -> Diagram:
    r"""Return a diagram that samples a signal and delays each sample, as a computer does.

    .. math:: y(t) = u(k T_s) \quad\text{for}\quad k T_s + \delta \le t < (k + 1) T_s + \delta

    Parameters
    ----------
    sample_time : float
        T_s > 0 [s].
    delay : float
        δ ≥ 0 [s]; the delay is exact, whether or not it is a whole number of samples.
    initial_value : array_like
        y before the first sample [unit of the input].
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the initial value, or from the wires.

    Returns
    -------
    Diagram
        Diagram with ports u and y.

    Raises
    ------
    BlockError
        If a time is not allowed, or their common divisor is below a hundredth of the delay.
    """
    period = finite("sampled_delay", "sample_time", sample_time, above=0.0)
    late = finite("sampled_delay", "delay", delay)
    # Unit delays with the largest common divisor of both times as sample time: for 0.1
    # s and a delay of 0.15 s, three delays of 0.05 s.
    tick = common_tick([exact(period), exact(late)])
    samples = int(exact(late) / tick)
    if not 0 <= samples <= MAX_DELAY_SAMPLES:
        raise BlockError(
            f"sampled_delay cannot delay samples of {period:g} s by {late:g} s: take 0 to "
            f"{MAX_DELAY_SAMPLES} times {float(tick):g} s, the longest time of which both are multiples"
        )
    diagram = Diagram("sampled delay")
    hold = last = diagram.add(hold=ZeroOrderHold(period, shape=shape))
    for k in range(1, samples + 1):
        last = last.y >> diagram.add(
            **{f"delay_{k}": UnitDelay(float(tick), initial_value, shape=shape)}
        )
    diagram.expose(u=hold.u, y=last.y)
    return diagram


class DiscreteStateSpace(Linear):
    r"""Linear system in state space, sampled.

    .. math:: x_{k+1} = A x_k + B u_k, \qquad y_k = C x_k + D u_k

    Parameters
    ----------
    A, B, C, D : array_like
        Matrices [any]; shapes as for `StateSpace`.
    sample_time : float
        Time between samples [s].
    offset : float
        First sample [s].
    initial_value, input_unit, output_unit
        As for `StateSpace`.

    Raises
    ------
    BlockError
        If the sizes of the matrices do not fit, or the sample time is not above 0.
    ParameterError
        If the initial value has another size.
    """

    _symbol = Symbol("x^(+) = {A:A} x + {B:B} u\ny = {C:C} x + {D:D} u")

    def __init__(
        self,
        A: npt.ArrayLike,
        B: npt.ArrayLike,
        C: npt.ArrayLike,
        D: npt.ArrayLike = 0.0,
        *,
        sample_time: float,
        offset: float = 0.0,
        initial_value: npt.ArrayLike = 0.0,
        input_unit: Unit = None,
        output_unit: Unit = None,
    ) -> None:
        super().__init__(
            A,
            B,
            C,
            D,
            initial_value=initial_value,
            input_unit=input_unit,
            output_unit=output_unit,
        )
        self.sampled(sample_time, offset)

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return A x + B u."""
        return {"x": self._next(x, u)}


class DiscreteTransferFunction(DiscreteStateSpace):
    r"""Transfer function in z from a scalar to a scalar, sampled.

    .. math:: \frac{Y(z)}{U(z)} = \frac{b_m z^m + \dots + b_0}{a_n z^n + \dots + a_0},
        \qquad m \le n

    It starts at rest. The state is that of the controllable canonical form.

    Parameters
    ----------
    numerator, denominator : array_like
        Coefficients, highest power of z first [any].
    sample_time : float
        Time between samples [s].
    input_unit, output_unit : str or None
        Units of u and y; None leaves them unchecked.
    offset : float
        First sample [s].

    Raises
    ------
    BlockError
        If the denominator has no pole, the numerator is of higher order, or the sample time
        is not above 0.
    """

    _symbol = Symbol("{numerator:z}\n-\n{denominator:z}")

    def __init__(
        self,
        numerator: npt.ArrayLike,
        denominator: npt.ArrayLike,
        *,
        sample_time: float,
        input_unit: Unit = None,
        output_unit: Unit = None,
        offset: float = 0.0,
    ) -> None:
        matrices = realization("DiscreteTransferFunction", numerator, denominator)
        self.numerator, self.denominator = map(np.atleast_1d, (numerator, denominator))
        super().__init__(
            *matrices,
            sample_time=sample_time,
            input_unit=input_unit,
            output_unit=output_unit,
            offset=offset,
        )
