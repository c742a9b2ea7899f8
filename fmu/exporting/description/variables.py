"""The variables of an FMU: one per port, parameter and state."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np

from trussflow.blocks.framework.types import Vector

STRUCTURED = re.compile(
    r"(der\()?[A-Za-z_]\w*(\[\d+(,\d+)?\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)?\])?)*(\))?", re.ASCII
)
"""Names that FMI's naming convention "structured" allows, as far as they occur here."""


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """An array of real numbers with a name.

    Attributes
    ----------
    name : str
        Name of the port, ``block.parameter`` or ``block.state``.
    shape : tuple of int
        Its shape; ``()`` for a scalar.
    reference : int
        Value reference of the first element, and of the whole array in FMI 3; elements follow
        in row-major order.
    causality, variability, initial : str
        As FMI defines them; `initial` is empty where FMI has none.
    start : Vector or None
        Value before initialization, flat [units]; None where it is calculated.
    units : tuple of (str or None)
        Unit of each element; None where it is not stated.
    meaning : str
        One line for people.
    state : str
        For a derivative, the name of its state.
    """

    name: str
    shape: tuple[int, ...]
    reference: int
    causality: str
    variability: str
    initial: str
    start: Vector | None
    units: tuple[str | None, ...]
    meaning: str = ""
    state: str = ""

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def references(self) -> range:
        """Value references of the elements in FMI 2."""
        return range(self.reference, self.reference + self.size)

    @property
    def unit(self) -> str | None:
        """The unit that all elements have, if there is one."""
        return self.units[0] if self.units and len(set(self.units)) == 1 else None

    def scalars(self) -> Iterator[str]:
        """Return the names of the elements in FMI 2: ``name[i,j]``, counted from 1."""
        for index in product(*(range(1, n + 1) for n in self.shape)):
            yield element_name(self.name, ",".join(map(str, index)))

    def description(self) -> str:
        """Return the meaning, with the units where an array mixes them."""
        if not self.units or self.unit is not None or not any(self.units):
            return self.meaning
        changes = [0, *(i for i in range(1, self.size) if self.units[i] != self.units[i - 1])]
        ends = [*changes[1:], self.size]
        runs = (f"{b - a} x {self.units[a] or 'not stated'}" for a, b in zip(changes, ends, strict=True))
        units = f"units in order: {', '.join(runs)}"
        return f"{self.meaning}; {units}" if self.meaning else units


def element_name(name: str, index: str) -> str:
    """Return the name of one element; a derivative has the index inside its brackets.

    Parameters
    ----------
    name : str
        Name of the array.
    index : str
        Indices from 1, with commas between; empty for a scalar.
    """
    if not index:
        return name
    return f"{name[:-1]}[{index}])" if name.startswith("der(") else f"{name}[{index}]"


def starts(value: Vector) -> str:
    """Return numbers as XML wants them, with blanks between."""
    return " ".join(repr(float(v)) for v in np.ravel(value))
