"""Block deduplication: of several blocks with the same equations, one is traced and checked for all.

Besides their arguments, equations can read the class, the attributes and the ports of their block. Two blocks
have the same equations if all of these are equal to the last bit. Objects that do not consist of numbers and
text are equal only to themselves. Equations may also be methods of another object, whose attribute `block` is
the block (see `GroupEquations`): its other attributes are compared. Names and parameter values may differ:
the traced block is a copy without them. Equations that read them from the copy fail, and are not shared.
"""

from __future__ import annotations

from collections.abc import Hashable
from copy import copy as shallow_copy
from dataclasses import replace
from functools import cache
from types import MethodType
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Event, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.kernels import from_expression, symbol, to_expression

UNSHARED_ATTRIBUTES = ("name", "parent", "parameters", "extra_ports")
"""Attributes that may differ between blocks with the same equations; the traced copy has none of them."""

MAX_SYMBOLIC_NUMBERS = 100
"""Largest number of constants of a block that become symbols; expressions of large matrices build slowly."""

MAX_NESTING = 8
"""Deepest level of nested lists that is compared."""


def equations_key(block: Block) -> Hashable | None:
    """Return a key that is equal for two blocks only if their equations are the same; None if unknown."""
    attributes = object.__getstate__(block)
    if not isinstance(attributes, dict):
        return None  # attributes in slots are not compared
    # Only the pattern of zeros of a lifted attribute matters: its other numbers become symbols.
    zeros = {
        name: np.where(value == 0.0, value, 1.0)
        for name, value in lifted(block).items()
    }
    seen = {
        n: zeros.get(n, v)
        for n, v in attributes.items()
        if n not in (*UNSHARED_ATTRIBUTES, "ports", "inferred_shape")
    }
    ports = [
        (port.name, port.whole_shape, port.unit, port.frame, port.declaration)
        for port in block.ports.values()
    ]
    shapes = [(name, value.shape) for name, value in block.parameters.items()]
    return type(block), _mark((seen, ports, shapes, block.inferred_shape.get()))


def _mark(value: Any, level: int = 0) -> Hashable:
    """Return a key that is equal for two values only if no equation can distinguish them."""
    kind = type(value)
    if kind in (float, complex):
        return kind, repr(value)  # distinguishes 0.0 from -0.0
    if kind in (bool, int, str, bytes, type(None)):
        return kind, value
    if (
        kind is np.ndarray or isinstance(value, np.generic)
    ) and value.dtype.kind in "biufc":
        return kind, value.dtype.str, value.shape, value.tobytes()
    if kind in (tuple, list) and level < MAX_NESTING:
        return kind, *(_mark(v, level + 1) for v in value)
    if isinstance(value, Input | Output | State | Event):
        return kind, _mark(vars(value), level + 1)
    if kind is MethodType:
        others = {n: v for n, v in vars(value.__self__).items() if n != "block"}
        return value.__func__, _mark(others, level + 1)
    if kind is dict and level < MAX_NESTING:
        return kind, *(
            (_mark(k, level + 1), _mark(v, level + 1)) for k, v in value.items()
        )
    return kind, id(value)


@cache
def _arithmetic(kind: Any) -> tuple[str, ...]:
    """Return the names of the attributes that the equations of a class use in arithmetic only."""
    # A subclass with methods or properties of its own may use the attributes in other ways.
    for base in kind.__mro__:
        if "_arithmetic" in vars(base):
            return tuple(base._arithmetic)
        if any(
            name != "__init__" and hasattr(value, "__get__")
            for name, value in vars(base).items()
        ):
            break
    return ()


def lifted(block: Block) -> dict[str, Vector]:
    """Return the attributes of a `block` whose nonzero numbers become symbols when it is traced."""
    kind: Any = type(block)
    found = {n: vars(block)[n] for n in _arithmetic(kind) if vars(block)[n].any()}
    return (
        found
        if sum(map(np.count_nonzero, found.values())) <= MAX_SYMBOLIC_NUMBERS
        else {}
    )


def constants(block: Block) -> tuple[Vector, ...]:
    """Return the nonzero numbers of the lifted attributes of a `block`, as one vector or none."""
    values = [value[value != 0.0] for value in lifted(block).values()]
    return (np.concatenate(values),) if values else ()


def anonymous_copy(block: Block) -> tuple[Block, tuple[Array, ...]]:
    """Return a copy of a `block` without name and parameter values, and the symbols of its `constants`."""
    copy: Block = object.__new__(type(block))
    copy.__dict__.update(
        (n, v) for n, v in vars(block).items() if n not in UNSHARED_ATTRIBUTES
    )
    for name, value in vars(copy).items():
        if isinstance(value, MethodType):
            owner: Any = shallow_copy(value.__self__)
            owner.block = copy
            copy.__dict__[name] = MethodType(value.__func__, owner)
    copy.__dict__["ports"] = {
        name: replace(port, block=copy) for name, port in block.ports.items()
    }
    symbols = tuple(symbol("constants", numbers.shape) for numbers in constants(block))
    start = 0
    for name, value in lifted(block).items():
        elements, places = ca.SX(ca.DM(value.ravel())), np.flatnonzero(value)
        elements[places] = to_expression(symbols[0])[start : start + places.size]
        start += places.size
        copy.__dict__[name] = from_expression(elements, value.shape)
    return copy, symbols
