"""Functions implemented twice, in C and in NumPy, because they have no CasADi expression.

An iteration whose length depends on numbers has no expression. When traced, a call of such a function
becomes a kernel call: compiled code calls the C function, and CasADi's interpreter the NumPy function.
The function supplies the rule for its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.kernels import (
    KERNEL_NAME,
    Kernel,
    call_kernel,
    is_traced,
    shape_of,
    to_expression,
)
from trussflow.blocks.tracing.operations import c_file


@dataclass(frozen=True, slots=True)
class CFunction:
    """A function of one vector that returns one vector.

    Attributes
    ----------
    name : str
        Name of the C function without ``tf_``, and of the header in this folder that defines it:
        ``void tf_name(sizes..., const double* in, double* out)``.
    value : callable
        NumPy implementation; takes the sizes and the vector.
    slope : callable
        Directional derivatives; takes the sizes, the vector, the results, and directions in columns.
    """

    name: str
    value: Callable[..., Vector]
    slope: Callable[..., Vector]

    def __call__(self, sizes: tuple[int, ...], argument: Array, results: int) -> Array:
        """Return the results.

        Parameters
        ----------
        sizes : tuple of int
            Arguments before the vector [-].
        argument : array, shape (n,)
            The vector [any].
        results : int
            Number of results [-].
        """
        if not is_traced(argument):
            return self.value(*sizes, np.asarray(argument, dtype=float))
        kernel = _kernel(self, sizes, *shape_of(argument), results)
        return call_kernel(kernel, to_expression(argument)).results(0)[0]


@cache  # keeps the callbacks alive, as CasADi does not
def _kernel(
    function: CFunction, sizes: tuple[int, ...], arguments: int, results: int
) -> Kernel:
    numbers = ", ".join(map(str, sizes))
    header = c_file(f"{function.name}.h")
    return Kernel(
        _Value(function, sizes, arguments, results),
        f"{function.name} {numbers}\n{header}",
        (((results,), 0, results),),
        tuple(range(results)),
        # Not inlined: the function is large, and several programs may call it.
        f"{header}\nstatic __attribute__((noinline))\n"
        f"void {KERNEL_NAME}(const double* restrict in, double* restrict out) {{\n"
        f"  tf_{function.name}({numbers}, in, out);\n}}\n",
    )


class _Value(ca.Callback):
    """Callback of CasADi for the results."""

    def __init__(
        self, function: CFunction, sizes: tuple[int, ...], arguments: int, results: int
    ) -> None:
        super().__init__()
        self._of, self._sizes, self._shape = function, sizes, (arguments, results)
        self._slopes: dict[int, _Slope] = {}
        self.construct(function.name, {})

    def get_sparsity_in(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shape[0])

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shape[1])

    def eval(self, values: Sequence[ca.DM]) -> list[Any]:
        return [self._of.value(*self._sizes, values[0].full().ravel())]

    def uses_output(self) -> bool:
        return True

    def has_forward(self, _: int) -> bool:
        return True

    def get_forward(self, count: int, *_: Any) -> ca.Function:
        if count not in self._slopes:
            self._slopes[count] = _Slope(self._of, self._sizes, *self._shape, count)
        return self._slopes[count]


class _Slope(ca.Callback):
    """Callback of CasADi for the derivatives along a number of directions."""

    def __init__(
        self,
        function: CFunction,
        sizes: tuple[int, ...],
        arguments: int,
        results: int,
        count: int,
    ) -> None:
        super().__init__()
        self._of, self._sizes = function, sizes
        self._shapes = (arguments, 1), (results, 1), (arguments, count)
        # CasADi caches derivatives by name, so the name must contain the number of directions.
        self.construct(f"{function.name}_slope_{count}", {})

    def get_n_in(self) -> int:
        return 3

    def get_sparsity_in(self, number: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shapes[number])

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shapes[1][0], self._shapes[2][1])

    def eval(self, values: Sequence[ca.DM]) -> list[Any]:
        argument, results, directions = (v.full() for v in values)
        return [
            self._of.slope(*self._sizes, argument.ravel(), results.ravel(), directions)
        ]
