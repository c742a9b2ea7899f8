"""Functions implemented twice, in C and in NumPy, because they have no CasADi expression.

An iteration whose length depends on numbers has no expression. When traced, a call of such a function
becomes a kernel call: compiled code calls the C function, and CasADi's interpreter the NumPy function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.kernels import KERNEL_NAME, Kernel


def c_kernel(
    function: NumPyFunction,
    declarations: str,
    call: str,
    near: Callable[[], ca.Function] | None = None,
    reads: Callable[[int], ca.Function] | None = None,
) -> Kernel:
    """Return the kernel of a `function` that the C statement `call` computes after these `declarations`.

    The statement writes the array ``out`` and reads ``in``. `near` and `reads` are as in `Kernel`.
    """
    # Not inlined: the function is large, and several programs may call it.
    more = ", const double* restrict d" if reads else ""
    source = (
        f"{declarations}\nstatic __attribute__((noinline))\n"
        f"void {KERNEL_NAME}(const double* restrict in, double* restrict out{more}) {{\n  {call}\n}}\n"
    )
    return Kernel(function, source, source=source, near=near, reads=reads)


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

    def has_eval_buffer(self) -> bool:
        """Return that CasADi passes memory, which takes less time than its matrices."""
        return True

    def eval_buffer(self, arguments: Sequence[Any], results: Sequence[Any]) -> int:
        """Write the results into memory of CasADi; return 0 for success."""
        if results[0] is not None:
            argument = np.zeros(self._shape[0])
            if arguments[0] is not None:  # otherwise it is zero
                argument = np.frombuffer(arguments[0])
            np.frombuffer(results[0])[:] = self.value(argument)
        return 0
