"""Functions implemented twice, in C and in NumPy, because they have no CasADi expression.

An iteration whose length depends on numbers has no expression. When traced, a call of such a function
becomes a kernel call: compiled code calls the C function, and CasADi's interpreter the NumPy function.
The function supplies the rule for its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
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
    given = ", ".join(map(str, sizes))
    return c_kernel(
        _Value(function, sizes, arguments, results),
        c_file(f"{function.name}.h"),
        f"tf_{function.name}({given}, in, out);",
    )


def c_kernel(
    function: NumPyFunction,
    declarations: str,
    call: str,
    near: Callable[[], ca.Function] | None = None,
) -> Kernel:
    """Return the kernel of a `function` that the C statement `call` computes after these `declarations`.

    The statement writes the array ``out`` and reads ``in``. `near` is as in `Kernel`.
    """
    # Not inlined: the function is large, and several programs may call it.
    source = (
        f"{declarations}\nstatic __attribute__((noinline))\n"
        f"void {KERNEL_NAME}(const double* restrict in, double* restrict out) {{\n  {call}\n}}\n"
    )
    n = function.size1_out(0)
    return Kernel(function, source, (((n,), 0, n),), tuple(range(n)), source, near)


class NumPyFunction(ca.Callback):
    """Function of CasADi that a method `value` computes in NumPy.

    Parameters
    ----------
    name : str
        Name of the function.
    arguments, results : int
        Sizes of the vectors that it takes and returns [-].
    """

    def __init__(self, name: str, arguments: int, results: int) -> None:
        super().__init__()
        self._shape = (arguments, results)
        self.construct(name, {})

    def value(self, argument: Vector) -> Vector:
        """Return the results."""
        raise NotImplementedError

    def get_sparsity_in(self, _: int) -> ca.Sparsity:
        """Return the sparsity of the arguments."""
        return ca.Sparsity.dense(self._shape[0])

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        """Return the sparsity of the results."""
        return ca.Sparsity.dense(self._shape[1])

    def eval(self, values: Sequence[ca.DM]) -> list[Any]:
        """Return the results in a list."""
        return [self.value(values[0].full().ravel())]


class _Value(NumPyFunction):
    """Results of a C function, with derivatives."""

    def __init__(
        self, function: CFunction, sizes: tuple[int, ...], arguments: int, results: int
    ) -> None:
        super().__init__(function.name, arguments, results)
        self._computed = partial(function.value, *sizes)
        self._slope = cache(partial(_Slope, function, sizes, arguments, results))

    def value(self, argument: Vector) -> Vector:
        return self._computed(argument)

    def uses_output(self) -> bool:
        return True

    def has_forward(self, _: int) -> bool:
        return True

    def get_forward(self, count: int, *_: Any) -> ca.Function:
        return self._slope(count)


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
