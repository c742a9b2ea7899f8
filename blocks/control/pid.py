"""Proportional-integral-derivative control, continuous and sampled."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import ParameterError
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.piecewise import NO_LIMIT, limited
from trussflow.blocks.library.signals import Shaped, ShapeLike
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array


class PIDLaw(Shaped):
    """Base of the PID controllers; `PID` documents the law.

    Parameters
    ----------
    kp, ki, kd : array_like
        Gains, as for `PID` [as there].
    lower, upper, filter_time, back_calculation, reference_weight, reference_rate_weight : array_like
        As for `PID` [as there].
    start : array_like, optional
        First output [unit of the output].
    unit, output_unit : str, tuple of str or None
        Units of the signal that is controlled, and of the output.
    shape : int, tuple of int or None
        Shape of all signals [-].
    """

    reference = Input(
        INFERRED, unit=Attribute("unit"), meaning="r: what the measurement is to be"
    )
    measurement = Input(INFERRED, unit=Attribute("unit"), meaning="z: what it is")
    y = Output(INFERRED, unit=Attribute("output_unit"), meaning="y: limited output")
    integral = State(INFERRED, meaning="I: what the integral part adds to the output")
    smooth = State(
        INFERRED, meaning="f: filtered signal whose rate the derivative part takes"
    )
    kp = Parameter(shape=None, meaning="proportional gain")
    ki = Parameter(shape=None, meaning="integral gain")
    kd = Parameter(shape=None, meaning="derivative gain")
    lower = Parameter(shape=None, meaning="smallest output")
    upper = Parameter(shape=None, meaning="largest output")
    filter_time = Parameter(shape=None, unit="s", above=0.0, meaning="T_f")
    back_calculation = Parameter(shape=None, unit="1/s", minimum=0.0, meaning="k_b")
    reference_weight = Parameter(shape=None, meaning="b")
    reference_rate_weight = Parameter(shape=None, meaning="c")
    first_output = Parameter(shape=None, meaning="first output, if start is given")

    def __init__(
        self,
        kp: npt.ArrayLike,
        ki: npt.ArrayLike = 0.0,
        kd: npt.ArrayLike = 0.0,
        *,
        lower: npt.ArrayLike = -NO_LIMIT,
        upper: npt.ArrayLike = NO_LIMIT,
        filter_time: npt.ArrayLike | None = None,
        back_calculation: npt.ArrayLike | None = None,
        reference_weight: npt.ArrayLike = 1.0,
        reference_rate_weight: npt.ArrayLike = 0.0,
        start: npt.ArrayLike | None = None,
        unit: Unit = None,
        output_unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        gains = {"kp": kp, "ki": ki, "kd": kd}
        p, i, d = (
            finite_array(f"parameter '{name}' of PID", gain)
            for name, gain in gains.items()
        )
        if len({gain.shape for gain in (p, i, d) if gain.ndim}) > 1:
            raise ParameterError(
                f"the gains of PID have shapes {p.shape}, {i.shape} and {d.shape}: vectors must have one shape"
            )
        self.unit, self.output_unit, self.bumpless = (
            unit,
            output_unit,
            start is not None,
        )
        # The defaults T_f = 0.1 k_d / k_p and k_b = k_i / k_p have no value without a
        # proportional part; 1 is used for k_p there. Without k_d, T_f has no effect.
        divisor = np.where(p == 0.0, 1.0, np.abs(p))
        super().__init__(
            shape,
            kp=p,
            ki=i,
            kd=d,
            lower=lower,
            upper=upper,
            filter_time=np.where(d == 0.0, 1.0, 0.1 * np.abs(d) / divisor)
            if filter_time is None
            else filter_time,
            back_calculation=np.abs(i) / divisor
            if back_calculation is None
            else back_calculation,
            reference_weight=reference_weight,
            reference_rate_weight=reference_rate_weight,
            first_output=0.0 if start is None else start,
        )

    @property
    def _symbol(self) -> Symbol:
        parts = {"kp": "{kp}", "ki": "{ki}/s", "kd": "{kd}·s"}
        used = [parts[name] for name in parts if np.any(self.parameters[name])]
        return Symbol(" + ".join(used) or "0", caption="limits {lower}, {upper}")

    def _gain(self, p: Signals) -> Array:
        """Return how fast the filter follows [1/s]."""
        if self.sample_time is None:
            return 1.0 / p.filter_time
        # With this gain, Euler's step of `update` is the exact filter for held signals.
        return (1.0 - np.exp(-self.sample_time / p.filter_time)) / self.sample_time

    def _errors(self, u: Signals, p: Signals) -> tuple[Array, Array]:
        """Return the proportional part of the output, and the signal that the filter follows."""
        weighted = p.reference_weight * u.reference - u.measurement
        return p.kp * weighted, p.reference_rate_weight * u.reference - u.measurement

    def _parts(self, x: Signals, u: Signals, p: Signals) -> tuple[Array, Array]:
        """Return the output before it is limited, and the rate of the filtered signal."""
        proportional, signal = self._errors(u, p)
        rate = self._gain(p) * (signal - x.smooth)
        return proportional + x.integral + p.kd * rate, rate

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the limited output."""
        return {"y": limited(self._parts(x, u, p)[0], p.lower, p.upper)}

    def _rates(self, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of the states."""
        wanted, rate = self._parts(x, u, p)
        # The integrated error has no weight b, so that it is zero at rest for every b.
        excess = wanted - limited(wanted, p.lower, p.upper)
        return {
            "integral": p.ki * (u.reference - u.measurement)
            - p.back_calculation * excess,
            "smooth": rate,
        }

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return states with a derivative part of zero and, if `start` is given, that first output."""
        proportional, signal = self._errors(u, p)
        # The filter starts at its input, so that only the proportional part and the
        # integral reach the first output. Times 0.0: zeros in the shape of the signals.
        start = p.first_output - proportional if self.bumpless else 0.0 * proportional
        return {"smooth": signal, "integral": start}


class PID(PIDLaw):
    r"""Proportional-integral-derivative control with filter, limits, anti-windup and bumpless start.

    .. math::

        v = k_p (b r - z) + I + \frac{k_d}{T_f} (c r - z - f), \qquad y = \min(\max(v, l), h)

    .. math::

        \dot I = k_i (r - z) - k_b (v - y), \qquad \dot f = (c r - z - f) / T_f

    Back-calculation drives the integral to a value at which the output is within its limits. Gains and limits are one
    number, or one per element.

    Parameters
    ----------
    kp : array_like
        k_p [output unit / unit].
    ki : array_like
        k_i [output unit / (unit s)].
    kd : array_like
        k_d [output unit s / unit].
    lower, upper : array_like
        l ≤ h: limits of the output [output unit]; by default none.
    filter_time : array_like, optional
        T_f > 0: time constant of the derivative filter [s]; by default a tenth of k_d / k_p.
    back_calculation : array_like, optional
        k_b ≥ 0 [1/s]; by default k_i / k_p. Zero winds up.
    reference_weight, reference_rate_weight : array_like
        b and c [-]. By default jumps of the reference do not reach the derivative part.
    start : array_like, optional
        First output [output unit], which sets the initial integral; by default the integral starts at zero.
    unit, output_unit : str, tuple of str or None
        Units of the signal that is controlled, and of the output; None leaves them unchecked.
    shape : int, tuple of int or None
        Shape of all signals [-]; None takes it from the gains, or else from the wires.

    Raises
    ------
    ParameterError
        If limits contradict each other, a time is not above 0, or shapes disagree.

    References
    ----------
    Åström and Hägglund (2006), *Advanced PID Control*, sections 3.3 to 3.5.

    Examples
    --------
    >>> from trussflow.blocks import PID, Diagram, Step, TransferFunction, simulate
    >>> loop = Diagram("loop")
    >>> step, pid, motor = loop.add(
    ...     step=Step(0.0), pid=PID(2.0, 1.0, 0.5, upper=1.5), motor=TransferFunction([1.0], [1, 1, 0])
    ... )
    >>> _ = step >> pid.reference
    >>> _ = pid >> motor >> pid.measurement
    >>> float(simulate(loop, 30.0, step=0.01)["motor.y"][-1].round(2))
    1.0
    """

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of integral and filter."""
        return self._rates(x, u, p)


class DiscretePID(PIDLaw):
    r"""The law of `PID`, sampled: the integral by Euler's steps, the filter exact for held signals.

    .. math::

        I_{k+1} = I_k + T_s \left(k_i (r - z) - k_b (v - y)\right), \qquad
        f_{k+1} = f_k + \left(1 - e^{-T_s / T_f}\right) (c r - z - f_k)

    and the derivative part is :math:`k_d (f_{k+1} - f_k) / T_s`.

    Parameters
    ----------
    kp, ki, kd : array_like
        Gains, as for `PID` [as there].
    sample_time : float
        T_s > 0 [s].
    offset : float
        First sample [s].
    **settings
        As for `PID`: lower, upper, filter_time, back_calculation, reference_weight,
        reference_rate_weight, start, unit, output_unit, shape.

    Raises
    ------
    ParameterError
        If limits contradict each other, a time is not above 0, or shapes disagree.
    BlockError
        If the sample time is not above 0.
    """

    def __init__(
        self,
        kp: npt.ArrayLike,
        ki: npt.ArrayLike = 0.0,
        kd: npt.ArrayLike = 0.0,
        *,
        sample_time: float,
        offset: float = 0.0,
        **settings: Any,
    ) -> None:
        super().__init__(kp, ki, kd, **settings)
        self.sampled(sample_time, offset)

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the states one sample further."""
        return {
            name: x[name] + self.sample_time * rate
            for name, rate in self._rates(x, u, p).items()
        }
