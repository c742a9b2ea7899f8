"""Traced block: the equations of a block, reusable with other expressions in place of its symbols."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from trussflow.blocks.framework.block import Values
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.kernels import (
    KernelCall,
    call_kernel,
    from_expression,
    shape_of,
    to_expression,
)


@dataclass(frozen=True, eq=False)
class TracedBlock:
    """Traced equations of one block.

    Substituting expressions for symbols is much faster than tracing the equations again.

    Attributes
    ----------
    leaves : tuple of array
        Symbols with which the equations were traced.
    calls : tuple of KernelCall
        Kernel calls of the equations.
    values : dict
        Results of each equation.
    parts : list of casadi.Function
        Functions built at first use; blocks with the same equations share them.
    """

    leaves: tuple[Array, ...]
    calls: tuple[KernelCall, ...]
    values: dict[str, Values]
    parts: list[ca.Function] = field(default_factory=list)

    def _prepare(self) -> None:
        """Build the straight-line functions: for the inputs of each kernel, then for all values."""
        leaves = [to_expression(leaf) for leaf in self.leaves]
        for call in self.calls:
            self.parts.append(ca.Function("part", leaves, [call.inputs]))
            leaves.append(ca.vec(call.symbols))
        values = [
            to_expression(v) for values in self.values.values() for v in values.values()
        ]
        self.parts.append(ca.Function("part", leaves, values))

    def numbers(self, *columns: Array) -> list[Array]:
        """Return all results for numbers in place of the leaves.

        Parameters
        ----------
        *columns : array, shape (size, n)
            Numbers for each leaf; n sets of them [as declared].

        Returns
        -------
        list of array, shape (size, n)
            The numbers of each result, in the order of `values` [as declared].
        """
        if not self.parts:
            self._prepare()
        sets, actual = columns[0].shape[1], list[Any](columns)
        for part, call in zip(self.parts, self.calls, strict=False):
            results = call.kernel.function(part(*actual))
            actual.append(ca.reshape(results, call.symbols.numel(), sets))
        return [each.full() for each in self.parts[-1].call(actual)]

    def fits(self, arguments: Iterable[Array]) -> bool:
        """Return whether these arguments can replace the symbols without loss of efficiency.

        A matrix with structural zeros cannot, as a new trace of the equations may exploit the zeros.
        """
        return not any(
            len(shape_of(a)) == 2
            and any(e.is_constant() for e in ca.vertsplit(to_expression(a)))
            for a in arguments
        )

    def __call__(self, arguments: Sequence[Array]) -> dict[str, Values]:
        """Return the results of the equations for other arguments.

        Parameters
        ----------
        arguments : sequence of array
            One array of the same shape for each leaf.
        """
        if not self.parts:
            self._prepare()
        actual = [to_expression(a) for a in arguments]
        for part, call in zip(self.parts, self.calls, strict=False):
            made = call_kernel(call.kernel, part(*actual))
            actual.append(ca.vec(made.symbols))
        flat = iter(self.parts[-1].call(actual))
        return {
            kind: {
                name: from_expression(next(flat), shape_of(v))
                for name, v in values.items()
            }
            for kind, values in self.values.items()
        }
