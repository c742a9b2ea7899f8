"""Blocks whose equations are the same: one of them is traced and checked for all.

What equations know besides their arguments is what they find in their block: its class, its attributes, its
ports. Two blocks state the same where all of that is equal to the last bit; objects that are not made of
numbers and text are equal to nothing but themselves. Names and values of parameters differ all the same: the
block that is traced is a copy without. Equations that ask it for these fail, and are not shared.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.tracing.tracing import from_expression, symbol, to_expression

OWN = ("name", "parent", "parameters", "extra_ports")
"""Attributes that the copy does not have."""

FEW = 100
"""Numbers of a block that become symbols at most: of large matrices, expressions would be slow to make."""

DEEP = 8
"""Levels of lists in lists that are compared."""


def mark(block: Block) -> Hashable | None:
    """Return what is equal for two blocks, while they are, if their equations are known to be the same.

    It is None if nothing is known.
    """
    attributes = object.__getstate__(block)
    if not isinstance(attributes, dict):
        return None  # some are in slots
    zeros = {name: np.where(value == 0.0, value, 1.0) for name, value in lifted(block).items()}
    seen = {n: zeros.get(n, v) for n, v in attributes.items() if n not in (*OWN, "ports", "inferred_shape")}
    own = type(block)._declared
    ports = [
        (
            *(port.name, port.whole_shape, port.unit, port.frame),
            says if own.get(port.name) is says else (type(says), vars(says)),
        )
        for port in block.ports.values()
        for says in (port.declaration,)
    ]
    shapes = [(name, value.shape) for name, value in block.parameters.items()]
    return type(block), _mark((seen, ports, shapes, block.inferred_shape.get()))


def _mark(value: Any, level: int = 0) -> Hashable:
    """Return what is equal for two values, while they are, if no equation can tell them apart."""
    kind = type(value)
    if kind in (float, complex):
        return kind, repr(value)  # zeros have signs
    if kind in (bool, int, str, bytes, type(None)):
        return kind, value
    if (kind is np.ndarray or isinstance(value, np.generic)) and value.dtype.kind in "biufc":
        return kind, value.dtype.str, value.shape, value.tobytes()
    if kind in (tuple, list) and level < DEEP:
        return kind, *(_mark(v, level + 1) for v in value)
    if kind is dict and level < DEEP:
        return kind, *((_mark(k, level + 1), _mark(v, level + 1)) for k, v in value.items())
    return kind, id(value)


@cache
def _arithmetic(kind: Any) -> tuple[str, ...]:
    """Return the attributes with which equations of a class do arithmetic, if it states none of its own."""
    for base in kind.__mro__:
        if "_arithmetic" in vars(base):
            return tuple(base._arithmetic)
        if any(name != "__init__" and hasattr(value, "__get__") for name, value in vars(base).items()):
            break
    return ()


def lifted(block: Block) -> dict[str, Vector]:
    """Return the attributes of a `block` whose numbers, but for zeros, become symbols when it is traced."""
    kind: Any = type(block)
    found = {n: vars(block)[n] for n in _arithmetic(kind) if vars(block)[n].any()}
    return found if sum(map(np.count_nonzero, found.values())) <= FEW else {}


def constants(block: Block) -> tuple[Vector, ...]:
    """Return the numbers of these attributes, one behind the other, without zeros: one vector, or none."""
    values = [value[value != 0.0] for value in lifted(block).values()]
    return (np.concatenate(values),) if values else ()


def nameless(block: Block) -> tuple[Block, tuple[Array, ...]]:
    """Return a copy that states the equations of all blocks like this one, and symbols of its `constants`."""
    copy: Block = object.__new__(type(block))
    copy.__dict__.update((n, v) for n, v in vars(block).items() if n not in OWN)
    copy.__dict__["ports"] = {name: replace(port, block=copy) for name, port in block.ports.items()}
    symbols = tuple(symbol("constants", numbers.shape) for numbers in constants(block))
    start = 0
    for name, value in lifted(block).items():
        elements, places = ca.SX(ca.DM(value.ravel())), np.flatnonzero(value)
        elements[places] = to_expression(symbols[0])[start : start + places.size]
        start += places.size
        copy.__dict__[name] = from_expression(elements, value.shape)
    return copy, symbols
