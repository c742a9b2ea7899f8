"""Programs: traced expressions, with the kernels they call, that compute one vector.

The same program becomes a CasADi function (for the interpreter and for derivatives) and C
code (for speed).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.tracing import KernelCall, Trace, symbols_of


@dataclass(frozen=True, eq=False)
class Program:
    """Expressions in the inputs and in the results of kernels.

    Attributes
    ----------
    name : str
        Its name.
    inputs : tuple of casadi.SX
        Columns of symbols.
    calls : tuple of KernelCall
        The kernels it calls, in order.
    result : casadi.SX
        The vector it computes.
    """

    name: str
    inputs: tuple[ca.SX, ...]
    calls: tuple[KernelCall, ...]
    result: ca.SX

    @property
    def size(self) -> int:
        """Size of the result."""
        return int(self.result.numel())

    @cached_property
    def graph(self) -> ca.Function:
        """All straight-line code in one function.

        Its inputs are those of the program, then the results of each kernel; its outputs the
        inputs of each kernel, then the result. Kernel arrays are stored element by element,
        the instances of an element side by side.
        """
        leaves = [*self.inputs, *(ca.vec(c.symbols.T) for c in self.calls)]
        roots = [*(ca.vec(c.inputs.T) for c in self.calls), self.result]
        return _straight(f"{self.name}_graph", leaves, roots)

    @cached_property
    def code(self) -> str:
        """What distinguishes this program from programs that compute something else."""
        kernels = (call.kernel.code for call in self.calls)
        return "\0".join([self.name, self.graph.serialize(), *kernels])

    def evaluate(self, values: Sequence[Array]) -> Array:
        """Return the result for one set of inputs, or several at once; quick to set up, slow to repeat.

        Parameters
        ----------
        values : sequence of array, shape (size,) or (size, n)
            One for each input [any]; where there are several sets, one column for each.

        Returns
        -------
        array, shape (size,) or (size, n)
            The result, in columns as the inputs.
        """
        leaves = [*self.inputs, *(ca.vec(c.symbols) for c in self.calls)]
        roots = [*(c.inputs for c in self.calls), self.result]
        everything = ca.Function(self.name, leaves, roots, {"allow_free": True})
        if everything.has_free():
            everything = _straight(self.name, leaves, roots)
        sets = np.shape(values[0])[1:]
        results = [np.zeros((c.symbols.numel(), *sets)) for c in self.calls]
        for k, call in enumerate(self.calls):  # what does not depend on the kernels before is right
            columns = everything.call([*values, *results])[k]
            each = np.asarray(call.kernel.function(columns), dtype=float)
            results[k] = each.reshape(results[k].shape, order="F")
        return np.asarray(everything.call([*values, *results])[-1], dtype=float).reshape(self.size, *sets)

    @cached_property
    def function(self) -> ca.Function:
        """The program as a CasADi function of its inputs."""
        return self._function([call.kernel.function for call in self.calls])

    @cached_property
    def expanded(self) -> ca.Function:
        """The program written out, for its derivatives and dependencies.

        Values and derivatives are right where the starts of algebraic loops in d are their solutions.
        """
        if not self.calls:
            return self.function
        kernels = (call.kernel for call in self.calls)
        return self._function([k.near() if k.near else k.function for k in kernels]).expand()

    def _function(self, kernels: Sequence[ca.Function]) -> ca.Function:
        """Return the program with these functions for the kernels that it calls."""
        if not self.calls:
            return _straight(self.name, self.inputs, [self.result])
        inputs = [ca.MX.sym(f"i{k}", s.numel()) for k, s in enumerate(self.inputs)]
        leaves, values = list(self.inputs), list(inputs)
        for k, call in enumerate(self.calls):
            size, count = call.inputs.shape
            part = _straight(f"{self.name}_{k}", leaves, [ca.vec(call.inputs)])
            results = kernels[k].map(count)(ca.reshape(part(*values), size, count))
            leaves.append(ca.vec(call.symbols))
            values.append(ca.vec(results))
        last = _straight(f"{self.name}_last", leaves, [self.result])
        return ca.Function(self.name, inputs, [last(*values)])

    def jacobian(self, *numbers: int) -> ca.Function:
        """Return the function of the exact derivatives by the inputs of these numbers, written out."""
        by = ca.vertcat(*(self.inputs[number] for number in numbers))
        derivatives = ca.densify(ca.jacobian(self.expanded(*self.inputs), by))
        return ca.Function("jacobian", self.inputs, [derivatives])


def lower(name: str, inputs: Sequence[ca.SX], result: ca.SX, trace: Trace) -> Program:
    """Build the program of a traced expression.

    Parameters
    ----------
    name : str
        Name of the program.
    inputs : sequence of casadi.SX
        Columns of symbols.
    result : casadi.SX
        A column, in `inputs` and in the results of the kernels in `trace`.
    trace : Trace
        The kernel calls recorded while the expression was traced.
    """
    calls: list[KernelCall] = []
    wanted = symbols_of(result)
    for call in reversed(trace.calls):
        if not wanted.isdisjoint(call.gives):
            calls.append(call)
            wanted |= call.reads
    return Program(name, tuple(inputs), tuple(calls[::-1]), ca.densify(result))


def _straight(name: str, inputs: Sequence[ca.SX], results: Sequence[ca.SX]) -> ca.Function:
    """Build a function without kernels; symbols that are no inputs do not matter and read zero.

    They stand for inputs that a wanted output was found not to depend on, but that reach a
    kernel some of whose other results are not wanted.
    """
    known = set().union(*map(symbols_of, inputs))
    shared = ca.cse([ca.densify(r) for r in results])
    free = [s for s in ca.symvar(ca.vertcat(*shared)) if s.element_hash() not in known]
    if free:
        unknown = ca.vertcat(*free)
        shared = ca.substitute(shared, [unknown], [ca.SX.zeros(unknown.numel())])
    return ca.Function(name, list(inputs), shared)
