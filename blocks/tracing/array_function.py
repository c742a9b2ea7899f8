"""Functions of arrays with exact Jacobians, for numbers and for traced arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.kernels import from_expression, is_traced, symbol, to_expression


@dataclass(frozen=True, eq=False)
class ArrayFunction:
    """A function traced once; a call inlines it for traced arrays, and evaluates it for numbers.

    Attributes
    ----------
    function : casadi.Function
        Function from the arguments, as row-major columns, to one such column.
    shape : tuple of int
        Shape of the result [-].
    """

    function: ca.Function
    shape: tuple[int, ...]

    @classmethod
    def of(cls, function: Callable[..., Array], shapes: Sequence[tuple[int, ...]]) -> ArrayFunction:
        """Trace a function that returns a vector.

        Parameters
        ----------
        function : callable
            Function as for a `Function` block.
        shapes : sequence of tuple of int
            Shapes of its arguments [-].
        """
        arguments = [symbol(f"a{i}", shape) for i, shape in enumerate(shapes)]
        value = to_expression(function(*arguments))
        columns = [to_expression(a) for a in arguments]
        return cls(ca.Function("array", columns, ca.cse([ca.densify(value)])), (value.numel(),))

    def __call__(self, *arguments: Array) -> Array:
        """Return the value for arguments of the traced shapes."""
        if any(map(is_traced, arguments)):
            return from_expression(self.function(*map(to_expression, arguments)), self.shape)
        return np.reshape(self.function(*map(np.ravel, arguments)).full(), self.shape)

    def jacobian(self, number: int) -> ArrayFunction:
        """Return the function of the exact Jacobian with respect to the argument with this index."""
        symbols = self.function.sx_in()
        matrix = ca.jacobian(self.function(*symbols), symbols[number])
        return ArrayFunction(ca.Function("jacobian", symbols, [ca.densify(ca.vec(matrix.T))]), matrix.shape)
