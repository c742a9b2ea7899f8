"""Tracing: conversion of NumPy equations to CasADi expression graphs, and kernels.

A block's equations are ordinary NumPy functions. For *traced arrays* (``casadi.ArrayInterface``, which
implements NumPy's functions) they return expressions instead of numbers. `repeated` marks a function that
is called several times, and `elementwise` an expensive function that is applied to each element: both
become kernels, which are compiled once.
"""

from __future__ import annotations

import contextlib
import contextvars
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from math import prod
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.errors import TracingError
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.traced_array import TracedArray

Shapes = tuple[tuple[int, ...], ...]

KERNEL_NAME = "TF_KERNEL"
"""Placeholder of the name of a kernel in its C source."""


def is_traced(value: object) -> bool:
    """Return whether `value` is a traced array (and so has no numeric value yet)."""
    return isinstance(value, ca.ArrayInterface)


def shape_of(value: Array) -> tuple[int, ...]:
    """Return the shape of an array, traced or not (``np.shape`` misreads traced ones)."""
    return tuple(value.shape) if is_traced(value) else np.shape(value)


def shapes_of(arrays: Mapping[str, Array]) -> dict[str, tuple[int, ...]]:
    """Return the shapes of several `arrays`, traced or not, by name."""
    return {name: shape_of(array) for name, array in arrays.items()}


def symbol(name: str, shape: tuple[int, ...]) -> Array:
    """Return a new traced array of the given name and shape.

    Parameters
    ----------
    name : str
        Name of the symbol in printed expressions.
    shape : tuple of int
        Shape of the array; ``()`` gives a scalar.
    """
    return from_expression(ca.SX.sym(name, prod(shape)), shape)


def from_expression(flat: ca.SX, shape: tuple[int, ...]) -> Array:
    """Return the traced array of `shape` whose row-major elements are the column `flat`."""
    # An array without elements has nothing to trace.
    if 0 in shape:
        return np.zeros(shape)
    made: Any = ca.ArrayInterface  # no copies needed, as traced arrays are read-only
    one = prod(shape) == 1 and len(shape) <= 2
    array: Array = made._wrap(flat, len(shape)) if one else made._wrap_nd(flat, shape)
    array.__class__ = TracedArray
    array._column = flat
    return array


def to_expression(value: Array) -> ca.SX:
    """Return the elements of an array, traced or not, as one row-major column."""
    if not is_traced(value):
        return ca.SX(np.asarray(value, dtype=float).ravel())
    column: ca.SX | None = vars(value).get("_column")  # set by from_expression
    return value._flat() if column is None else column


def expressions(arrays: Iterable[Array]) -> list[ca.SX]:
    """Return the elements of each of several `arrays`, traced or not, as row-major columns."""
    return [to_expression(array) for array in arrays]


def column_of(arrays: Iterable[Array]) -> ca.SX:
    """Return the elements of several `arrays`, one after the other, as one column."""
    return ca.vertcat(ca.SX(0, 1), *expressions(arrays))


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """A function that is traced separately.

    Attributes
    ----------
    function : casadi.Function
        Function from one input column to its distinct, non-constant results.
    code : str
        Text that identifies the computation.
    layout : tuple
        For `repeated`: shape of each result, with its slice of all elements.
    template : tuple
        For each element of the results, its constant value [any], or the index of its distinct result.
    source : str
        C source with the name `KERNEL_NAME`, if `function` has no expression.
    near : callable or None
        Returns an expression with the derivatives of such a `function`, valid if the beginning of its
        input is the result already.
    reads : callable or None
        For a `function` that reads a history: its first input is the first number of the history in d, or
        in the arguments of a single block. Returns the function of the inputs, followed by so many
        numbers from there on. In the C source they are the array ``d``.
    """

    function: ca.Function
    code: str
    layout: tuple[tuple[tuple[int, ...], slice], ...] = ()
    template: tuple[float | int, ...] = ()
    source: str = ""
    near: Callable[[], ca.Function] | None = None
    reads: Callable[[int], ca.Function] | None = None


@dataclass(frozen=True, eq=False)
class KernelCall:
    """One traced call of `repeated`: the same kernel applied to each column of `inputs`.

    Attributes
    ----------
    kernel : Kernel
        The function.
    inputs : casadi.SX
        One column per instance.
    symbols : casadi.SX
        Symbols of the kernel's distinct results in later expressions, one column per instance.
    """

    kernel: Kernel
    inputs: ca.SX
    symbols: ca.SX

    @cached_property
    def reads(self) -> set[int]:
        """Element hashes of the symbols in the inputs."""
        return symbols_of(self.inputs)

    @cached_property
    def gives(self) -> set[int]:
        """Element hashes of the symbols of the results."""
        return symbols_of(self.symbols)

    def results(self, instance: int) -> tuple[Array, ...]:
        """Return all results of one instance, assembled from symbols and constants."""
        column: list[Any] = self.symbols[:, instance].elements()
        flat = ca.vertcat(
            *(
                ca.SX(e) if isinstance(e, float) else column[e]
                for e in self.kernel.template
            )
        )
        return tuple(
            from_expression(flat[place], shape) for shape, place in self.kernel.layout
        )


Trace = list[KernelCall]
"""The kernel calls recorded while equations are traced, in order."""

_active: contextvars.ContextVar[Trace | None] = contextvars.ContextVar(
    "trace", default=None
)


def active_trace() -> Trace | None:
    """Return the trace that records kernel calls now, or None."""
    return _active.get()


def tracing() -> contextlib.AbstractContextManager[Trace]:
    """Record the kernel calls of the equations traced inside the ``with`` block."""
    return _recorded([])


@contextlib.contextmanager
def _recorded(trace: Any) -> Iterator[Any]:
    token = _active.set(trace)
    try:
        yield trace
    finally:
        _active.reset(token)


def written_out() -> contextlib.AbstractContextManager[None]:
    """Inline kernels instead of recording kernel calls inside the ``with`` block."""
    return _recorded(None)


def repeated(
    function: Callable[..., tuple[Array, ...]], instances: Sequence[tuple[Array, ...]]
) -> list[tuple[Array, ...]]:
    """Return ``[function(*arguments) for arguments in instances]``, traced as one kernel.

    While a diagram is traced, `function` becomes one compiled kernel that is called
    several times, instead of several copies of its code.

    Parameters
    ----------
    function : callable
        Takes arrays and returns a tuple of arrays. Values that differ between the instances
        must be arguments; values from elsewhere must be constant.
    instances : sequence of tuple of array
        Arguments of each call, with the same shapes in every call.

    Returns
    -------
    list of tuple of array
        Results of each call.
    """
    trace = _active.get()
    if trace is None or len(instances) < 2 or not any(map(is_traced, instances[0])):
        return [function(*arguments) for arguments in instances]
    # The function of a `partial` is the same object in each call, so that the cache of
    # `_kernel` finds it.
    constants: tuple[Any, ...] = ()
    if isinstance(function, partial) and not function.keywords:
        constants, function = function.args, function.func
    kernel = _kernel(function, constants, tuple(map(shape_of, instances[0])))
    call = call_kernel(kernel, ca.horzcat(*map(column_of, instances)))
    return [call.results(i) for i in range(len(instances))]


def elementwise(function: Callable[..., Array], *arguments: Array) -> Array:
    """Return ``function(*arguments)`` for a function that works element by element.

    While a diagram is traced, `function` becomes a kernel that computes several elements at once.
    This is faster for functions such as powers and exponentials of long vectors.

    Parameters
    ----------
    function : callable
        Takes arrays, or scalars, of one shape and returns the same shape.
    *arguments : array
        Arrays whose shapes can be broadcast.

    Returns
    -------
    array
        Result with the broadcast shape.
    """
    shape = np.broadcast_shapes(*map(shape_of, arguments))
    if not any(map(is_traced, arguments)) or prod(shape) < 2:
        return function(*arguments)
    # Addition of zeros broadcasts traced arrays; CasADi simplifies it away.
    flat = [np.reshape(a + np.zeros(shape), (prod(shape),)) for a in arguments]
    results = repeated(
        partial(_in_tuple, function),
        [tuple(a[i] for a in flat) for i in range(prod(shape))],
    )
    return np.reshape(np.stack([r for (r,) in results]), shape)


def _in_tuple(function: Callable[..., Array], *arguments: Array) -> tuple[Array]:
    return (function(*arguments),)


@lru_cache(maxsize=256)
def _kernel(
    function: Callable[..., tuple[Array, ...]],
    constants: tuple[Any, ...],
    shapes: Shapes,
) -> Kernel:
    """Return the kernel of a function, traced at the first call with these constants and shapes."""
    arguments = [symbol(f"a{i}", shape) for i, shape in enumerate(shapes)]
    with written_out():  # a kernel cannot call another kernel
        results = function(*constants, *arguments)
    found = [*map(shape_of, results)]
    layout = tuple(zip(found, spans(map(prod, found)), strict=True))
    column, flat = column_of(arguments), ca.cse(column_of(results))
    if not symbols_of(flat) <= symbols_of(column):
        raise ValueError(
            "the function given to repeated() uses a signal from elsewhere; the signal must be an argument"
        )
    # Constants stay constants, and an element returned twice (in both triangles of a symmetric
    # matrix) stays one symbol, so that later equations can exploit the structure.
    distinct: dict[int, int] = {}
    template: list[float | int] = []
    kept: list[int] = []
    elements: list[Any] = flat.elements()
    for i, element in enumerate(elements):
        if element.is_constant():
            template.append(float(element))
            continue
        place = distinct.setdefault(element.element_hash(), len(kept))
        if place == len(kept):
            kept.append(i)
        template.append(place)
    kernel = ca.Function("kernel", [column], [flat[kept]])
    return Kernel(kernel, kernel.serialize(), layout, tuple(template))


def call_kernel(kernel: Kernel, inputs: ca.SX) -> KernelCall:
    """Record a kernel call in the active trace; if there is an equal earlier call, return that one.

    Parameters
    ----------
    kernel : Kernel
        The kernel.
    inputs : casadi.SX
        One column per instance.
    """
    trace = _active.get()
    if trace is None:
        raise TracingError(
            "a function without an expression, such as a bounded allocation, can be called only while "
            "a diagram is traced, and not inside an algebraic loop: break the loop with a UnitDelay"
        )
    size, count, number = kernel.function.size1_out(0), inputs.size2(), len(trace)
    symbols = ca.horzcat(*(ca.SX.sym(f"k{number}_{i}", size) for i in range(count)))
    # Evaluations for several outputs of a block repeat calls; an equal call is reused.
    new = KernelCall(kernel, inputs, symbols)
    for call in trace:
        if call.kernel.code == kernel.code and _equal(call, new):
            return call
    trace.append(new)
    return new


def _equal(first: KernelCall, second: KernelCall) -> bool:
    """Return whether the inputs of two calls are the same expressions, element by element."""
    if first.inputs.shape != second.inputs.shape or first.reads != second.reads:
        return False
    # Common subexpression elimination gives equal expressions the same hash.
    shared: list[Any] = ca.cse(
        ca.vertcat(ca.vec(first.inputs), ca.vec(second.inputs))
    ).elements()
    hashes = [element.element_hash() for element in shared]
    n = first.inputs.numel()
    return hashes[:n] == hashes[n:]


def symbols_of(expression: ca.SX) -> set[int]:
    """Return the element hashes of the symbols in an expression."""
    return {s.element_hash() for s in ca.symvar(expression)}
