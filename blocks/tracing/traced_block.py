"""Traced block: the equations of a block, reusable with other expressions in place of its symbols."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import casadi as ca

from trussflow.blocks.framework.layout import BlockSignals, Layout
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.kernels import (
    call_kernel,
    expressions,
    from_expression,
    shapes_of,
    to_expression,
)
from trussflow.blocks.tracing.program import Program


@dataclass(frozen=True, eq=False)
class TracedBlock:
    """Traced equations of one block.

    Substituting expressions for symbols is much faster than tracing the equations again. Blocks with the
    same equations share one object.

    Attributes
    ----------
    program : Program
        Program of the results; its inputs are the arguments of the equations.
    results : Layout
        Results of all equations by kind, such as ``"derivative"``, and name.
    """

    program: Program
    results: Layout

    def fits(self, arguments: Mapping[str, Array]) -> bool:
        """Return whether these arguments can replace the symbols without loss of efficiency.

        A matrix with structural zeros cannot, as a new trace of the equations may exploit the zeros.
        """
        return not any(
            len(shape) == 2
            and any(e.is_constant() for e in ca.vertsplit(to_expression(arguments[n])))
            for n, shape in shapes_of(arguments).items()
        )

    def __call__(self, arguments: Iterable[Array]) -> BlockSignals:
        """Return the results of the equations, by kind, for other arguments.

        Parameters
        ----------
        arguments : iterable of array
            One array of the same shape for each argument.
        """
        column = self.program.evaluated(
            expressions(arguments),
            lambda call, inputs: call_kernel(call.kernel, inputs).symbols,
        )
        return self.results.unpack(column, from_expression)
