"""Programs: traced expressions and kernel calls that compute one vector.

A program is converted to a CasADi function (for the interpreter and for derivatives) and to C code (for
speed).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from trussflow.blocks.tracing.kernels import Kernel, KernelCall, symbols_of


@dataclass(frozen=True, eq=False)
class Program:
    """Expressions in the inputs and in the results of kernels.

    Attributes
    ----------
    name : str
        Name of the program.
    inputs : tuple of casadi.SX
        Columns of symbols.
    calls : tuple of KernelCall
        The kernels it calls, in order.
    result : casadi.SX
        The vector it computes.
    shares : bool
        Whether common subexpressions are computed once; their search takes as long as the tracing.
    """

    name: str
    inputs: tuple[ca.SX, ...]
    calls: tuple[KernelCall, ...]
    result: ca.SX
    shares: bool = True

    @property
    def size(self) -> int:
        """Size of the result."""
        return int(self.result.numel())

    @cached_property
    def graph(self) -> ca.Function:
        """All straight-line code in one function.

        The inputs are those of the program and the results of each kernel. The outputs are the inputs of
        each kernel and the result. Kernel arrays are stored by element: the values of all instances of one
        element are contiguous.
        """
        # Transposed, as `vec` runs along columns and each column is one instance.
        leaves = [*self.inputs, *(ca.vec(c.symbols.T) for c in self.calls)]
        roots = [*(ca.vec(c.inputs.T) for c in self.calls), self.result]
        return self._straight(f"{self.name}_graph", leaves, roots)

    @cached_property
    def code(self) -> str:
        """Text that identifies the computation of this program."""
        kernels = (call.kernel.code for call in self.calls)
        return "\0".join([self.name, self.graph.serialize(), *kernels])

    @cached_property
    def parts(self) -> list[ca.Function]:
        """Straight-line functions: of the inputs of each kernel call, then of the result.

        Their inputs are those of the program and the results of the calls before.
        """
        leaves, parts = list(self.inputs), list[ca.Function]()
        for k, call in enumerate(self.calls):
            parts.append(self._straight(f"{self.name}_{k}", leaves, [call.inputs]))
            leaves.append(ca.vec(call.symbols))
        return [*parts, self._straight(self.name, leaves, [self.result])]

    def evaluated(
        self, arguments: Iterable[Any], kernel: Callable[[KernelCall, Any], Any]
    ) -> Any:
        """Return the result for other arguments.

        Parameters
        ----------
        arguments : iterable of casadi.SX or casadi.MX
            One column for each input.
        kernel : callable
            Takes a kernel call and its inputs, one column per instance, and returns its results.
        """
        *parts, last = self.parts
        values = list(arguments)
        for part, call in zip(parts, self.calls, strict=True):
            values.append(ca.vec(kernel(call, part(*values))))
        return last(*values)

    @cached_property
    def function(self) -> ca.Function:
        """The program as a CasADi function of its inputs."""
        return self._function(None)

    @cached_property
    def expanded(self) -> ca.Function:
        """The program with inlined kernels, for derivatives and dependencies.

        Values and derivatives are valid if the guesses of algebraic loops in d are their solutions.
        """
        if not self.calls:
            return self.function
        return self._function(lambda k: k.near() if k.near else k.function).expand()

    def history(self, call: KernelCall) -> tuple[int, int]:
        """Return the number of the input with the history that a kernel reads, and its place there."""
        first: Any = call.inputs[0]
        for number, column in enumerate(self.inputs):
            elements: list[Any] = column.elements()
            for place, element in enumerate(elements):
                if element.element_hash() == first.element_hash():
                    return number, place
        raise ValueError("a history is not among the arguments")

    def _function(self, of: Callable[[Kernel], ca.Function] | None) -> ca.Function:
        """Return the program as a CasADi function with the function `of` each kernel, or its own."""
        if not self.calls:
            return self.parts[0]
        inputs = [ca.MX.sym(f"i{k}", s.numel()) for k, s in enumerate(self.inputs)]

        def result(call: KernelCall, given: ca.MX) -> ca.MX:
            kernel = call.kernel
            if of is None and kernel.reads is not None:
                number, place = self.history(call)
                history = inputs[number][place:]
                return kernel.reads(history.numel())(ca.vertcat(given, history))
            function = kernel.function if of is None else of(kernel)
            return function.map(given.size2())(given)

        return ca.Function(self.name, inputs, [self.evaluated(inputs, result)])

    def _straight(
        self, name: str, inputs: Sequence[ca.SX], results: Sequence[ca.SX]
    ) -> ca.Function:
        """Return a function without kernels, with zero for symbols that are not among the inputs.

        Such symbols are placeholders of block inputs without feedthrough to the evaluated output. They occur
        in the inputs of kernels that also have unused results.
        """
        if not self.shares:
            return ca.Function(name, list(inputs), list(results))
        known = symbols_of(ca.vertcat(*inputs))
        # Across all results: the inputs of different kernels share subexpressions.
        shared = ca.cse([ca.densify(r) for r in results])
        free = [
            s for s in ca.symvar(ca.vertcat(*shared)) if s.element_hash() not in known
        ]
        if free:
            unknown = ca.vertcat(*free)
            shared = ca.substitute(shared, [unknown], [ca.SX.zeros(unknown.numel())])
        return ca.Function(name, list(inputs), shared)

    def jacobian(self, *numbers: int) -> ca.Function:
        """Return the function of the exact Jacobian with respect to the inputs with these indices."""
        by = ca.vertcat(*(self.inputs[number] for number in numbers))
        derivatives = ca.densify(ca.jacobian(self.expanded(*self.inputs), by))
        return ca.Function("jacobian", self.inputs, [derivatives])


def lower(
    name: str, inputs: Sequence[ca.SX], result: ca.SX, trace: Sequence[KernelCall]
) -> Program:
    """Build the program of a traced expression.

    Parameters
    ----------
    name : str
        Name of the program.
    inputs : sequence of casadi.SX
        Columns of symbols.
    result : casadi.SX
        Column in `inputs` and in the results of the kernels in `trace`.
    trace : sequence of KernelCall
        The kernel calls recorded while the expression was traced.
    """
    calls: list[KernelCall] = []
    # Backwards, so that calls whose results are not used are left out.
    wanted = symbols_of(result)
    for call in reversed(trace):
        if wanted & call.gives:
            calls.append(call)
            wanted |= call.reads
    return Program(name, tuple(inputs), tuple(calls[::-1]), ca.densify(result))
