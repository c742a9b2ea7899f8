"""Algebraic blocks: gains, matrix products, functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.arithmetic import Sum as Sum
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.signals import Shaped, ShapeLike, WrappedFunction
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array


class Gain(Shaped):
    r"""Multiply element by element, y = k u.

    Parameters
    ----------
    gain : array_like
        k [output unit / input unit]; one number, or one per element. `MatrixGain` takes
        matrices.
    input_unit, output_unit : str, tuple of str or None
        Units of u and y, or one per element; if both are None, y has the unit of u.
    shape : int, tuple of int or None
        Shape of both [-]; None takes it from the gain, or else from the wires.

    Raises
    ------
    BlockError
        If the gain is a matrix.
    ParameterError
        If gain and shape disagree.
    """

    u = Input(
        INFERRED,
        unit=Attribute("input_unit"),
        frame=INFERRED,
        meaning="signal to multiply",
    )
    y = Output(
        INFERRED, unit=Attribute("output_unit"), frame=INFERRED, meaning="the product"
    )
    gain = Parameter(shape=None, meaning="k: factor")
    _symbol = Symbol("{gain}", outline="triangle")

    def __init__(
        self,
        gain: npt.ArrayLike,
        *,
        input_unit: Unit = None,
        output_unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        factors = finite_array("parameter 'gain' of Gain", gain)
        if factors.ndim > 1:
            raise BlockError(
                f"Gain multiplies element by element and cannot take a gain of shape "
                f"{factors.shape}; for y = K u use MatrixGain(K)"
            )
        # Without declared units a factor has none, so that y keeps the unit of u.
        unchecked = input_unit is None and output_unit is None
        self.input_unit = INFERRED if unchecked else input_unit
        self.output_unit = INFERRED if unchecked else output_unit
        super().__init__(shape, gain=factors)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the product."""
        return {"y": p.gain * u.u}


class MatrixGain(Block):
    r"""Multiply by a matrix, y = K u.

    Parameters
    ----------
    gain : array_like, shape (m, n)
        K [output unit / input unit].
    input_unit, output_unit : str, tuple of str or None
        Units of u and y, or one per element; None leaves them unchecked.

    Raises
    ------
    BlockError
        If the gain is not a matrix.
    """

    u = Input("columns", unit=Attribute("input_unit"), meaning="vector to multiply")
    y = Output("rows", unit=Attribute("output_unit"), meaning="the product")
    gain = Parameter(shape=None, meaning="K: matrix")
    _symbol = Symbol("{gain:K} u")

    def __init__(
        self, gain: npt.ArrayLike, *, input_unit: Unit = None, output_unit: Unit = None
    ) -> None:
        matrix = finite_array("parameter 'gain' of MatrixGain", gain)
        if matrix.ndim != 2:
            raise BlockError(
                f"MatrixGain needs a matrix; got shape {matrix.shape}. For numbers and vectors "
                "use Gain, which multiplies element by element"
            )
        self.rows, self.columns = matrix.shape
        self.input_unit, self.output_unit = input_unit, output_unit
        super().__init__(gain=matrix)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the product."""
        return {"y": p.gain @ u.u}


class Function(WrappedFunction):
    """Wrap a NumPy function of the inputs; it is traced like the equations of any block.

    Parameters
    ----------
    function : callable
        Takes the inputs in order of declaration and returns one array, or a tuple of arrays
        if there are several outputs. It must not use ``if`` on values (use ``np.where``) or internal state.
        Global and enclosing variables are read once, when the block is first traced: data that change
        between runs must be inputs.
    inputs, outputs : mapping of str to Input or Output, optional
        The ports; by default ``u`` and ``y`` of one shape, inferred from the wires.
    unit : str, tuple of str or None
        Unit of the default ports; None leaves them unchecked.

    Raises
    ------
    BlockError
        If the ports are declared wrongly, or the function returns something else.

    Examples
    --------
    >>> import numpy as np
    >>> from trussflow.blocks import Function, Input, Output
    >>> absolute = Function(np.abs)
    >>> power = Function(
    ...     lambda force, velocity: force @ velocity,
    ...     inputs={"force": Input(3, unit="N"), "velocity": Input(3, unit="m/s")},
    ...     outputs={"power": Output(unit="W")},
    ... )
    >>> power.power
    <output 'Function.power' (shape (), unit W)>
    """

    def __init__(
        self,
        function: Callable[..., Any],
        inputs: Mapping[str, Input] | None = None,
        outputs: Mapping[str, Output] | None = None,
        *,
        unit: Unit = None,
    ) -> None:
        if inputs is None:
            # `lambda t: ...` is most likely meant as a function of time. Functions of
            # NumPy have no code object.
            first = getattr(getattr(function, "__code__", None), "co_varnames", ())[:1]
            hint = (
                "argument 't' is not the time: TimeFunction is for functions of it"
                if first == ("t",)
                else ""
            )
            inputs = {"u": Input(INFERRED, unit=unit, meaning=hint)}
        outputs = {"y": Output(INFERRED, unit=unit)} if outputs is None else outputs
        super().__init__(function, inputs, outputs)


class Terminator(Block):
    """Sink of an unused signal."""

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning="not used")
    _symbol = Symbol(curve="M0 12h18M18 3v18M23 7v10M28 10v4")
