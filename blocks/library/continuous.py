"""Continuous blocks: integrator, state space, transfer function."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.linear import Linear, realization
from trussflow.blocks.library.signals import Shaped, ShapeLike, per_time
from trussflow.blocks.support.types import Array


class Integrator(Shaped):
    r"""Integrate a signal over time, dy/dt = u.

    Parameters
    ----------
    initial_value : array_like
        y at time 0 [unit]; one number, or one per element.
    unit : str, tuple of str or None
        Unit of y, or one per element; None leaves units unchecked.
    shape : int, tuple of int or None
        Shape of input and output [-]; None takes it from the initial value, or from the wires.

    Raises
    ------
    ParameterError
        If initial value and shape disagree.
    """

    u = Input(INFERRED, unit=Attribute("rate_unit"), meaning="rate of the output")
    y = Output(INFERRED, unit=Attribute("unit"), meaning="integral of the input")
    integral = State(INFERRED, initial="initial_value", meaning="integral of the input")
    initial_value = Parameter(0.0, shape=None, meaning="integral at time 0")
    _symbol = Symbol("1\n-\ns", caption="from {initial_value}")

    def __init__(
        self,
        initial_value: npt.ArrayLike = 0.0,
        *,
        unit: Unit = None,
        shape: ShapeLike = None,
    ) -> None:
        self.unit, self.rate_unit = unit, per_time(unit)
        super().__init__(shape, initial_value=initial_value)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the integral."""
        return {"y": x.integral}

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rate of the integral."""
        return {"integral": u.u}


class StateSpace(Linear):
    r"""Linear system in state space.

    .. math:: \dot x = A x + B u, \qquad y = C x + D u

    The matrices are constants of the compiled code, where zeros cost nothing. `from_control`
    builds the block from an object of python-control.

    Parameters
    ----------
    A : array_like, shape (n, n)
        System matrix [1/s].
    B : array_like, shape (n, m) or (n,)
        Input matrix [any]; with shape (n,) the input u is a scalar.
    C : array_like, shape (p, n) or (n,)
        Output matrix [any]; with shape (n,) the output y is a scalar.
    D : array_like, shape (p, m), or (p,), (m,), () where u or y are scalars
        Feedthrough matrix [any]; one number stands for a matrix full of it.
    initial_value : array_like, shape (n,)
        x at time 0 [any].
    input_unit, output_unit : str, tuple of str or None
        Units of u and y, or one per element; None leaves them unchecked.

    Raises
    ------
    BlockError
        If the sizes of the matrices do not fit.
    ParameterError
        If the initial value has another size.
    """

    _symbol = Symbol("ẋ = {A:A} x + {B:B} u\ny = {C:C} x + {D:D} u")

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return A x + B u."""
        return {"x": self._next(x, u)}


class TransferFunction(StateSpace):
    r"""Transfer function from a scalar to a scalar.

    .. math:: \frac{Y(s)}{U(s)} = \frac{b_m s^m + \dots + b_0}{a_n s^n + \dots + a_0},
        \qquad m \le n

    It starts at rest. The state is that of the controllable canonical form.

    Parameters
    ----------
    numerator, denominator : array_like
        Coefficients, highest power of s first [any].
    input_unit, output_unit : str or None
        Units of u and y; None leaves them unchecked.

    Raises
    ------
    BlockError
        If the denominator has no pole, or the numerator is of higher order.

    Examples
    --------
    >>> from trussflow.blocks import TransferFunction
    >>> TransferFunction([1.0], [0.5, 1.0]).A
    array([[-2.]])
    """

    _symbol = Symbol("{numerator:s}\n-\n{denominator:s}")

    def __init__(
        self,
        numerator: npt.ArrayLike,
        denominator: npt.ArrayLike,
        *,
        input_unit: Unit = None,
        output_unit: Unit = None,
    ) -> None:
        matrices = realization("TransferFunction", numerator, denominator)
        self.numerator, self.denominator = map(np.atleast_1d, (numerator, denominator))
        super().__init__(*matrices, input_unit=input_unit, output_unit=output_unit)
