"""Dependencies of the results of programs on their arguments."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.tracing.program import Program

Pattern = NDArray[np.bool_]
Indices = NDArray[np.int64]


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


@dataclass(frozen=True, eq=False)
class ColumnGroup:
    """Columns of a Jacobian without a common row: one directional derivative gives all their elements.

    This is the method of Curtis, Powell and Reid (1974).

    Attributes
    ----------
    columns : Indices
        The columns.
    rows, places : Indices
        Row and column of each element of them.
    """

    columns: Indices
    rows: Indices
    places: Indices


def column_groups(pattern: ca.Sparsity) -> list[ColumnGroup]:
    """Return the columns of a Jacobian of this pattern in few groups; columns of zeros are left out."""
    found = pattern.uni_coloring()
    begin, rows = np.array(pattern.colind()), np.array(pattern.row(), dtype=int)
    groups = []
    for columns in np.split(np.array(found.row(), dtype=int), found.colind()[1:-1]):
        # No rows first, as all columns may be zero.
        parts = [rows[:0], *(rows[begin[c] : begin[c + 1]] for c in columns)]
        places = np.repeat(columns, np.diff(begin)[columns])
        groups.append(ColumnGroup(columns, np.concatenate(parts), places))
    return groups
