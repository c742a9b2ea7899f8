"""Grouping of scalar variables into arrays: ``u[1]``, ``u[2]``… become one port ``u``."""

from __future__ import annotations

import keyword
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from math import prod

from trussflow.fmu.runtime.description import FmuVariable

ELEMENT_NAME = re.compile(
    r"(?P<name>.*[^\[\],\s])\[(?P<index>\s*\d+\s*(,\s*\d+\s*)*)\](?P<close>\)?)"
)
"""Pattern of a name with indices; ``der(x[1])`` is an element of ``der(x)``."""


@dataclass(frozen=True, slots=True, eq=False)
class VariableGroup:
    """The variables that are elements of one array, or a single variable.

    Attributes
    ----------
    name : str
        Name in the FMU, without indices.
    variables : tuple of FmuVariable
        The elements in row-major order, or one variable of any shape.
    shape : tuple of int
        Shape of the array.
    """

    name: str
    variables: tuple[FmuVariable, ...]
    shape: tuple[int, ...]


def gather(variables: Iterable[FmuVariable]) -> list[VariableGroup]:
    """Group variables into arrays; return the groups in the order of their first elements.

    Scalars form an array if their names differ in the last indices only and their causality,
    variability and type are equal. The indices must count from 1 or 0 without gaps.

    Parameters
    ----------
    variables : iterable of FmuVariable
        The variables.
    """
    listed = list(variables)
    taken = {v.name for v in listed}
    families: dict[str, dict[tuple[int, ...], FmuVariable]] = {}
    for variable in listed:
        found = ELEMENT_NAME.fullmatch(variable.name)
        if found and not variable.shape:
            index = tuple(map(int, found["index"].split(",")))
            families.setdefault(found["name"] + found["close"], {})[index] = variable
    arrays: dict[str, VariableGroup] = {}
    for name, members in families.items():
        shape = _shape(members)
        kinds = {(v.causality, v.variability, v.type) for v in members.values()}
        if shape and name not in taken and len(kinds) == 1:
            group = VariableGroup(
                # Sorted index tuples are in row-major order.
                name,
                tuple(members[i] for i in sorted(members)),
                shape,
            )
            arrays |= {v.name: group for v in group.variables}
    groups = {}
    for variable in listed:
        single = VariableGroup(variable.name, (variable,), variable.shape)
        group = arrays.get(variable.name, single)
        # A known key keeps its place in the dict: that of its first element.
        groups[group.name] = group
    return list(groups.values())


def _shape(members: Mapping[tuple[int, ...], FmuVariable]) -> tuple[int, ...] | None:
    """Return the shape of an array with the given indices, or None if there are gaps."""
    ranks = {len(index) for index in members}
    if len(ranks) != 1:
        return None
    columns = list(zip(*members, strict=True))
    first = min(map(min, columns))
    shape = tuple(max(column) - first + 1 for column in columns)
    # the indices differ and are in a box of this shape: as many as elements leave no gap
    return shape if first in (0, 1) and prod(shape) == len(members) else None


def legal_names(names: Iterable[str], reserved: Collection[str]) -> dict[str, str]:
    """Return a unique Python name for each name of an FMU.

    Each run of illegal characters becomes one underscore, and underscores at the ends are
    removed: ``arm.q`` becomes ``arm_q``, ``der(x)`` becomes ``der_x``, ``u[3]`` becomes ``u_3``.
    A leading digit gets an underscore before it. A keyword, a reserved name or a duplicate gets
    an underscore after it.

    Parameters
    ----------
    names : iterable of str
        Names in the FMU.
    reserved : collection of str
        Names to avoid.
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
