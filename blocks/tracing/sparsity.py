"""Dependencies of the results of programs on their arguments."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.tracing.program import Program

Pattern = NDArray[np.bool_]


def sparsity(program: Program) -> list[Pattern]:
    """Return the sparsity pattern of the result of a program for each argument."""
    # Kernels as expressions: a call would count as dense.
    function = program.expanded
    return [
        ca.DM(function.jac_sparsity(0, argument), 1.0).full() > 0
        for argument in range(len(program.inputs))
    ]


def product(a: Pattern, b: Pattern) -> Pattern:
    """Return the dependencies of the rows of `a` on the columns of `b`."""
    # floats use BLAS, Booleans do not
    return np.asarray(a.astype(np.float32) @ b.astype(np.float32) > 0)
