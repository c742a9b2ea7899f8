"""Functions that are written twice, in C and in NumPy, where one expression cannot say what they do.

An iteration whose course depends on numbers has no expression. Traced, a call of such a function is
a kernel like any other: compiled code calls the C, CasADi's interpreter the NumPy, and derivatives
follow the rule that comes with them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.tracing.tracing import KERNEL, Kernel, call_kernel, is_traced, shape_of, to_expression


@dataclass(frozen=True, slots=True)
class CFunction:
    """A function of one vector that returns one vector.

    Attributes
    ----------
    name : str
        Name of the function in C, without ``tf_``, and of the header beside this file that defines it:
        ``void tf_name(sizes..., const double* in, double* out)``.
    value : callable
        The same in NumPy: takes the sizes and the vector.
    slope : callable
        Takes the sizes, the vector, the results there and directions, one for each column; returns
        the derivatives along them.
    """

    name: str
    value: Callable[..., Vector]
    slope: Callable[..., Vector]

    def __call__(self, sizes: tuple[int, ...], argument: Array, results: int) -> Array:
        """Return the results.

        Parameters
        ----------
        sizes : tuple of int
            What the function takes before the vector [-].
        argument : array, shape (n,)
            The vector [any].
        results : int
            How many there are [-].
        """
        if not is_traced(argument):
            return self.value(*sizes, np.asarray(argument, dtype=float))
        kernel = _kernel(self, sizes, *shape_of(argument), results)
        return call_kernel(kernel, to_expression(argument)).results(0)[0]


@cache  # CasADi does not keep its callbacks alive
def _kernel(function: CFunction, sizes: tuple[int, ...], arguments: int, results: int) -> Kernel:
    numbers = ", ".join(map(str, sizes))
    header = files("trussflow.blocks.tracing").joinpath(f"{function.name}.h").read_text(encoding="utf-8")
    return Kernel(
        _Value(function, sizes, arguments, results),
        f"{function.name} {numbers}\n{header}",
        (((results,), 0, results),),
        tuple(range(results)),
        # One copy, however many programs call it: it is large.
        f"{header}\nstatic __attribute__((noinline))\n"
        f"void {KERNEL}(const double* restrict in, double* restrict out) {{\n"
        f"  tf_{function.name}({numbers}, in, out);\n}}\n",
    )


class _Value(ca.Callback):
    """What CasADi calls for the results."""

    def __init__(self, function: CFunction, sizes: tuple[int, ...], arguments: int, results: int) -> None:
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
    """What CasADi calls for the derivatives along a number of directions."""

    def __init__(
        self, function: CFunction, sizes: tuple[int, ...], arguments: int, results: int, count: int
    ) -> None:
        super().__init__()
        self._of, self._sizes = function, sizes
        self._shapes = (arguments, 1), (results, 1), (arguments, count)
        # CasADi keeps derivatives by name: under one name it would return those for another count.
        self.construct(f"{function.name}_slope_{count}", {})

    def get_n_in(self) -> int:
        return 3

    def get_sparsity_in(self, number: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shapes[number])

    def get_sparsity_out(self, _: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._shapes[1][0], self._shapes[2][1])

    def eval(self, values: Sequence[ca.DM]) -> list[Any]:
        argument, results, directions = (v.full() for v in values)
        return [self._of.slope(*self._sizes, argument.ravel(), results.ravel(), directions)]
