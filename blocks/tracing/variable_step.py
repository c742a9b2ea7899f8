"""Data of the compiled variable-step methods: tables of coefficients, and the sparse Jacobian."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.tracing.kernels import Kernel, KernelCall
from trussflow.blocks.tracing.program import Program, lower
from trussflow.blocks.tracing.sparsity import ColumnGroup, column_groups
from trussflow.blocks.tracing.tableaus import METHODS, STIFF_METHOD, tableau


@dataclass(frozen=True, eq=False)
class SparseJacobian:
    """Sparse Jacobian of a derivative by the states and by time, from few directional derivatives.

    Attributes
    ----------
    derivative : Program
        Program of dx/dt, of (t, x, d, p).
    """

    derivative: Program

    @classmethod
    def of(cls, derivative: Program) -> SparseJacobian | None:
        """Return the Jacobian of a program; None without states, or with code that has no derivative."""
        if not derivative.size or any(
            call.kernel.source and not call.kernel.near for call in derivative.calls
        ):
            return None
        return cls(derivative)

    @cached_property
    def size(self) -> int:
        """Number of states n [-]."""
        return int(self.derivative.inputs[1].numel())

    @cached_property
    def tangent(self) -> Program:
        """Program of the directional derivative; its second input is the states and the direction.

        Each kernel call is followed by a call of the kernel's directional derivative.
        """
        t, x, d, p = self.derivative.inputs
        direction = ca.SX.sym("direction", self.size + 1)
        symbols, slopes = [x, t], [direction]
        calls, kernels = list[KernelCall](), dict[int, Kernel]()

        def slope(expression: ca.SX) -> ca.SX:
            along = ca.jtimes(
                ca.vec(expression), ca.vertcat(*symbols), ca.vertcat(*slopes)
            )
            return ca.reshape(along, *expression.shape)

        for number, call in enumerate(self.derivative.calls):
            kernel = kernels.setdefault(id(call.kernel), _tangent_of(call.kernel))
            results = ca.SX.sym(f"slope{number}", *call.symbols.shape)
            inputs = ca.vertcat(call.inputs, slope(call.inputs))
            calls += [call, KernelCall(kernel, inputs, results)]
            symbols.append(ca.vec(call.symbols))
            slopes.append(ca.vec(results))
        arguments = (t, ca.vertcat(x, direction), d, p)
        return lower("tangent", arguments, slope(self.derivative.result), calls)

    @cached_property
    def groups(self) -> list[ColumnGroup]:
        """Columns whose elements one directional derivative gives; time is the last column."""
        function = self.derivative.expanded
        return column_groups(
            ca.horzcat(function.jac_sparsity(0, 1), function.jac_sparsity(0, 0))
        )

    def tables(self) -> dict[str, Any]:
        """Return the tables of variable_step.h by name: the order of elimination, the fill, and the groups."""
        n = self.size
        square = self.derivative.expanded.jac_sparsity(0, 1)
        symmetric = square + square.T + ca.Sparsity.diag(n)
        fill, order = symmetric.ldl()
        # Places of the elements of U and, transposed, of L, by column.
        filled = np.array(fill.find(), dtype=int)
        place_of = np.argsort(np.array(order, dtype=int))
        places = []
        for group in self.groups:
            by_time = group.places == n
            i = place_of[group.rows]
            j = place_of[np.where(by_time, 0, group.places)]
            low, high = np.minimum(i, j), np.maximum(i, j)
            place = np.searchsorted(filled, low + high * n) + fill.nnz() * (i > j)
            place = np.where(i == j, 2 * fill.nnz() + i, place)
            places.append(np.where(by_time, 2 * fill.nnz() + n + group.rows, place))
        columns = [group.columns for group in self.groups]
        starts = [np.cumsum([0, *map(len, parts)]) for parts in (columns, places)]
        return {
            "order": order,
            "fill_begin": fill.colind(),
            "fill": fill.row(),
            "seeds_begin": starts[0],
            "seeds": np.concatenate(columns),
            "entries_begin": starts[1],
            "entry_rows": np.concatenate([group.rows for group in self.groups]),
            "entry_places": np.concatenate(places),
        }


def _tangent_of(kernel: Kernel) -> Kernel:
    """Return the kernel of the directional derivative: its input is that of `kernel`, and the direction."""
    function = kernel.near() if kernel.near else kernel.function
    at = ca.SX.sym("at", function.numel_in(0))
    direction = ca.SX.sym("direction", at.numel())
    slope = ca.densify(ca.jtimes(function(at), at, direction))
    found = ca.Function("tangent", [ca.vertcat(at, direction)], [slope])
    return Kernel(found, found.serialize())


def definitions(jacobian: SparseJacobian | None) -> str:
    """Return the C definitions that variable_step.h needs; without a Jacobian, methods are explicit only."""
    methods = METHODS if jacobian else METHODS[:-1]
    lines, rows = list[str](), list[str]()
    for method in methods:
        found = tableau(method)
        sizes = (found.stages, *found.a.shape, *found.dense.shape, found.order)
        members = [*map(str, (*sizes, found.limit, found.gamma))]
        for name in ("a", "c", "error", "dense", "coupling", "slope"):
            members.append(f"tf_{method}_{name}")
            lines.append(_table("double", members[-1], getattr(found, name).ravel()))
        rows.append(f"{{{', '.join(members)}}}")
    all_found = [tableau(method) for method in methods]
    macros = {
        "TF_VARIABLE": 1,
        "TF_STIFF": int(jacobian is not None),
        "TF_STIFF_METHOD": METHODS.index(STIFF_METHOD),
        "TF_METHODS": ", ".join(rows),
        "TF_ROWS": max(len(found.a) for found in all_found),
        "TF_DENSE_ROWS": 3 + max(len(found.dense) for found in all_found),
    }
    if jacobian:
        tables = jacobian.tables()
        macros |= {"TF_FILL": len(tables["fill"]), "TF_COLORS": len(jacobian.groups)}
        lines += [_table("int", f"tf_{name}", table) for name, table in tables.items()]
    return "\n".join([*lines, *(f"#define {n} {v}" for n, v in macros.items()), ""])


def _table(kind: str, name: str, values: Iterable[Any]) -> str:
    """Return the C definition of a constant array of a `kind`, with at least one element."""
    # Python's numbers: the text of NumPy's depends on its print options.
    elements = ", ".join(map(str, np.asarray(values).tolist())) or "0"
    return f"static const {kind} {name}[] = {{{elements}}};"
