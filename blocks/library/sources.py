"""Sources: signals that depend on time only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError, Explained
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import INFERRED, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import Shaped, ShapeLike, finite
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array, number_array, shown


class Source(Block):
    """Base of sources: one output, as large as the largest parameter.

    Parameters
    ----------
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.
    frame : str or None
        Reference frame of the output.
    **parameters : array_like
        Parameters of the source.
    """

    y = Output(
        "shape", unit=Attribute("unit"), frame=Attribute("frame"), meaning="the signal"
    )

    def __init__(
        self, unit: Unit, frame: str | None = None, **parameters: npt.ArrayLike
    ) -> None:
        owner = type(self).__name__
        shapes = [
            finite_array(f"parameter '{n}' of {owner}", v).shape
            for n, v in parameters.items()
        ]
        # The first of the shapes with most axes. The base class reports a parameter
        # with another shape by its name.
        self.shape = max(shapes, key=len, default=())
        self.unit, self.frame = unit, frame
        super().__init__(**parameters)


class Constant(Source):
    r"""A signal that does not change.

    Parameters
    ----------
    value : array_like
        c [unit]; its shape is that of the output.
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.
    frame : str or None
        Reference frame of the output.
    """

    value = Parameter(shape="shape", meaning="the value")
    _symbol = Symbol("{value} {unit}")

    def __init__(
        self, value: npt.ArrayLike, *, unit: Unit = None, frame: str | None = None
    ) -> None:
        super().__init__(unit, frame, value=value)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value."""
        return {"y": p.value}


class Ground(Shaped):
    """A signal that is zero, with the shape and unit of its wires.

    Parameters
    ----------
    shape : int, tuple of int or None
        Shape of the output [-]; None takes it from the wires.
    """

    y = Output(INFERRED, unit=INFERRED, frame=INFERRED, meaning="zero")
    _symbol = Symbol("0")

    def __init__(self, shape: ShapeLike = None) -> None:
        super().__init__(shape)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return zeros."""
        # The shape may be still open if the block is used alone.
        return {"y": np.zeros(self.y.whole_shape or ())}


class Step(Source):
    r"""A step at one instant.

    .. math:: y = y_0 \text{ for } t < t_s, \qquad y = y_1 \text{ for } t \ge t_s

    Parameters
    ----------
    time : float
        t_s [s]. It is part of the structure: adaptive solvers stop there. With a fixed step,
        let it be a multiple of the step; then the response is as exact as without the jump.
    initial_value, final_value : array_like
        y_0 and y_1 [unit].
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the time is not finite.
    """

    initial_value = Parameter(shape="shape", meaning="y_0: value before the step")
    final_value = Parameter(shape="shape", meaning="y_1: value from the step on")

    def __init__(
        self,
        time: float = 1.0,
        *,
        initial_value: npt.ArrayLike = 0.0,
        final_value: npt.ArrayLike = 1.0,
        unit: Unit = None,
    ) -> None:
        self.time = finite("Step", "time", time)
        super().__init__(unit, initial_value=initial_value, final_value=final_value)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value before or after the step."""
        return {"y": np.where(t >= self.time, p.final_value, p.initial_value)}

    @property
    def _symbol(self) -> Symbol:
        p = self.parameters
        falls = np.all(p["final_value"] < p["initial_value"])
        return Symbol(
            curve="M2 4h16V20h16" if falls else "M2 20h16V4h16",
            caption="{initial_value} to {final_value} {unit} at {time} s",
        )

    def breakpoints(self) -> tuple[float, ...]:
        """Return the time of the step."""
        return (self.time,)


class Ramp(Source):
    r"""A signal that starts to grow at one instant, y = y0 + a max(t - t0, 0).

    Parameters
    ----------
    slope : array_like
        a [unit/s].
    start_time : float
        t_0 [s]. It is part of the structure: adaptive solvers stop there.
    initial_value : array_like
        y_0 [unit].
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the start time is not finite.
    """

    slope = Parameter(shape="shape", meaning="a: rate of growth")
    initial_value = Parameter(shape="shape", meaning="y_0: value before the start")
    _symbol = Symbol(
        curve="M2 20h12L34 3", caption="{slope} {unit} per s from {start_time} s"
    )

    def __init__(
        self,
        slope: npt.ArrayLike = 1.0,
        *,
        start_time: float = 0.0,
        initial_value: npt.ArrayLike = 0.0,
        unit: Unit = None,
    ) -> None:
        self.start_time = finite("Ramp", "start_time", start_time)
        super().__init__(unit, slope=slope, initial_value=initial_value)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value."""
        return {"y": p.initial_value + p.slope * np.maximum(t - self.start_time, 0.0)}

    def breakpoints(self) -> tuple[float, ...]:
        """Return the start time."""
        return (self.start_time,)


class Sine(Source):
    r"""A sine, y = b + A sin(2π f t + φ).

    Parameters
    ----------
    amplitude : array_like
        A [unit].
    frequency : array_like
        f [Hz].
    phase : array_like
        φ [rad].
    bias : array_like
        b [unit].
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.
    """

    amplitude = Parameter(shape="shape", meaning="A: amplitude")
    frequency = Parameter(shape="shape", unit="Hz", meaning="f: frequency")
    phase = Parameter(shape="shape", unit="rad", meaning="φ: phase at time 0")
    bias = Parameter(shape="shape", meaning="b: mean value")
    _symbol = Symbol(
        curve="M2 12C8-4 12-4 18 12S28 28 34 12",
        caption="{frequency} Hz, {amplitude} {unit}",
    )

    def __init__(
        self,
        amplitude: npt.ArrayLike = 1.0,
        frequency: npt.ArrayLike = 1.0,
        *,
        phase: npt.ArrayLike = 0.0,
        bias: npt.ArrayLike = 0.0,
        unit: Unit = None,
    ) -> None:
        super().__init__(
            unit, amplitude=amplitude, frequency=frequency, phase=phase, bias=bias
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value."""
        return {
            "y": p.bias + p.amplitude * np.sin(2.0 * np.pi * p.frequency * t + p.phase)
        }


class TimeFunction(Source):
    r"""Function of time, y = f(t); ``TimeFunction(lambda t: t)`` is a clock.

    Parameters
    ----------
    function : callable
        Takes the time and returns an array; traced, as that of a `Function`.
    breakpoints : sequence of float
        Times at which it is not smooth [s]; adaptive solvers stop there.
    unit : str, tuple of str or None
        Unit of the output, or one per element; None leaves it unchecked.

    Raises
    ------
    BlockError
        If the function does not take the time, or a breakpoint is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from trussflow.blocks import TimeFunction
    >>> TimeFunction(lambda t: np.stack([np.cos(t), np.exp(-t)])).y
    <output 'TimeFunction.y' (shape (2,))>
    """

    _symbol = Symbol("f(t)")

    def __init__(
        self,
        function: Callable[[Any], Any],
        *,
        breakpoints: Sequence[float] = (),
        unit: Unit = None,
    ) -> None:
        if not callable(function):
            raise BlockError(
                f"TimeFunction needs a function of time, not {shown(function)}"
            )
        self._function = function
        self._breaks = tuple(
            float(t)
            for t in finite_array("breakpoints of TimeFunction", breakpoints).ravel()
        )
        with Explained(
            lambda error: BlockError(f"TimeFunction needs a function of time: {error}")
        ):
            self.shape = number_array(
                "what the function of TimeFunction returns", function(np.zeros(()))
            ).shape
        self.unit, self.frame = unit, None
        # `Source` takes the shape from the parameters, of which there are none here.
        Block.__init__(self)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the value."""
        return {"y": self._function(t)}

    def breakpoints(self) -> tuple[float, ...]:
        """Return the breakpoints of the constructor."""
        return self._breaks
