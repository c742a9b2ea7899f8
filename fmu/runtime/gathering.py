"""Vectors out of scalars: ``u[1]``, ``u[2]``… become one port ``u``."""

from __future__ import annotations

import keyword
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from math import prod

from trussflow.fmu.runtime.description import FmuVariable

ELEMENT = re.compile(r"(?P<name>.*[^\[\],\s])\[(?P<index>\s*\d+\s*(,\s*\d+\s*)*)\](?P<close>\)?)")
"""A name that ends in indices; ``der(x[1])`` is an element of ``der(x)``."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Variables that belong together: the elements of an array, or one variable by itself.

    Attributes
    ----------
    name : str
        Name in the FMU, without indices.
    variables : tuple of FmuVariable
        The elements in row-major order, or one variable of any shape.
    shape : tuple of int
        Shape of the whole.
    """

    name: str
    variables: tuple[FmuVariable, ...]
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)


def gather(variables: Iterable[FmuVariable]) -> list[Group]:
    """Return the groups that variables form, in the order of their first elements.

    Scalars form an array if they differ in their last indices only, these count from 1 (or from
    0) without a gap in each dimension, and causality, variability and type are equal.

    Parameters
    ----------
    variables : iterable of FmuVariable
        The variables.
    """
    listed = list(variables)
    taken = {v.name for v in listed}
    families: dict[tuple[str, ...], dict[tuple[int, ...], FmuVariable]] = {}
    for variable in listed:
        found = ELEMENT.fullmatch(variable.name)
        if found is None or variable.shape:
            families[("", variable.name)] = {(): variable}
            continue
        name = found["name"] + found["close"]
        key: tuple[str, ...] = (name, variable.causality, variable.variability, variable.type)
        index = tuple(int(part) for part in found["index"].split(","))
        families.setdefault(key, {})[index] = variable
    groups: list[Group] = []
    kinds = Counter(key[0] for key in families)  # more than one: the elements are not of one kind
    for key, members in families.items():
        shape = _shape(members)
        name = key[0]
        if name and shape and name not in taken and kinds[name] == 1:
            groups.append(Group(name, tuple(members[i] for i in sorted(members)), shape))
        else:
            groups += [Group(v.name, (v,), v.shape) for v in members.values()]
    order = {v.name: i for i, v in enumerate(listed)}
    return sorted(groups, key=lambda group: min(order[v.name] for v in group.variables))


def _shape(members: Mapping[tuple[int, ...], FmuVariable]) -> tuple[int, ...] | None:
    """Return the shape that indices span, or None if they leave gaps."""
    if () in members:
        return ()
    ranks = {len(index) for index in members}
    if len(ranks) != 1:
        return None
    columns = list(zip(*members, strict=True))
    first = min(map(min, columns))
    shape = tuple(max(column) - first + 1 for column in columns)
    if first not in (0, 1) or prod(shape) != len(members):
        return None
    full = set(product(*(range(first, first + n) for n in shape)))
    return shape if full == set(members) else None


def legal_names(names: Iterable[str], reserved: Collection[str]) -> dict[str, str]:
    """Return a Python name for each name of an FMU, no two alike.

    Every run of characters that cannot stand in a name becomes one underscore, at the end none:
    ``arm.q`` becomes ``arm_q``, ``der(x)`` becomes ``der_x``, ``u[3]`` becomes ``u_3``. A name
    that begins with a digit gets an underscore before it; a keyword, a name that blocks use
    themselves, or one that is taken gets an underscore after it.

    Parameters
    ----------
    names : iterable of str
        Names in the FMU.
    reserved : collection of str
        Names that must not be used.
    """
    found: dict[str, str] = {}
    taken = set(reserved)
    for name in names:
        legal = re.sub(r"\W+", "_", name).strip("_") or "variable"
        legal = f"_{legal}" if legal[0].isdigit() else legal
        while legal in taken or keyword.iskeyword(legal):
            legal += "_"
        taken.add(legal)
        found[name] = legal
    return found
