"""Variables of an exported FMU: one per port, parameter and state."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import chain, groupby, product
from math import prod
from typing import Any

from trussflow.blocks.support.types import Vector

STRUCTURED_NAME = re.compile(
    r"(der\()?[A-Za-z_]\w*(\[\d+(,\d+)?\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)?\])?)*(\))?",
    re.ASCII,
)
"""Pattern of names allowed by FMI's naming convention "structured", as far as the export uses it."""


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """A named array of real numbers.

    Attributes
    ----------
    name : str
        Name of the port, ``block.parameter`` or ``block.state``.
    shape : tuple of int
        Shape of the array; ``()`` for a scalar.
    units : tuple of (str or None)
        Unit of each element; None if it is not stated.
    meaning : str
        Description, one line.
    causality, variability, initial : str
        Attributes as defined by FMI; `initial` is empty where FMI defines none.
    start : Vector or None
        Flat value before initialization [units]; None for a calculated variable.
    reference : int
        Value reference of the first element, and of the whole array in FMI 3; elements follow
        in row-major order.
    state : int or None
        For a derivative, the value reference of its state.
    """

    name: str
    shape: tuple[int, ...]
    units: tuple[str | None, ...]
    meaning: str
    causality: str = "local"
    variability: str = "continuous"
    initial: str = "calculated"
    start: Vector | None = None
    reference: int = 0
    state: int | None = None

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
        """Common unit of all elements, or None."""
        return self.units[0] if self.units and len(set(self.units)) == 1 else None

    def scalars(self) -> list[str]:
        """Return the names of the elements."""
        return element_names(self.name, self.shape)

    def elements(self) -> VariableGroup:
        """Return the elements as separate variables."""
        return tuple(
            replace(
                self,
                name=name,
                shape=(),
                units=self.units[i : i + 1],
                start=None if self.start is None else self.start[i : i + 1],
                reference=self.reference + i,
                state=None if self.state is None else self.state + i,
            )
            for i, name in enumerate(self.scalars())
        )

    def description(self) -> str:
        """Return the meaning, with the units of the elements if they differ."""
        if not self.units or self.unit is not None or not any(self.units):
            return self.meaning
        runs = (
            f"{len([*alike])} x {unit or 'not stated'}"
            for unit, alike in groupby(self.units)
        )
        units = f"units in order: {', '.join(runs)}"
        return f"{self.meaning}; {units}" if self.meaning else units


VariableGroup = tuple[Variable, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Variables:
    """All variables of an FMU; iteration yields them in the order of their value references.

    Attributes
    ----------
    time : Variable
        The independent variable.
    inputs, parameters, states, derivatives, outputs : tuple of Variable
        Variables of these groups.
    modes, indicators : tuple of Variable
        States that change at events only, and the indicators of state events.
    memory : tuple of Variable
        States that change at sample instants only, numbered as in d; FMUs do not publish them.
    """

    time: Variable
    inputs: VariableGroup
    parameters: VariableGroup
    states: VariableGroup
    derivatives: VariableGroup
    outputs: VariableGroup
    modes: VariableGroup
    indicators: VariableGroup
    memory: VariableGroup

    def __iter__(self) -> Iterator[Variable]:
        """Return an iterator of all variables except the memory."""
        return chain(
            (self.time,),
            self.inputs + self.parameters + self.states + self.derivatives,
            self.outputs + self.modes + self.indicators,
        )

    def scalarized(self) -> Variables:
        """Return the variables with each array split into its elements."""
        elements: dict[str, Any] = {}
        for field in fields(self)[1:]:  # all groups after the time
            group = getattr(self, field.name)
            elements[field.name] = tuple(e for v in group for e in v.elements())
        return replace(self, **elements)


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of the elements of an array in row-major order, such as ``u[1,2]``.

    A scalar has one element with its own name.

    Parameters
    ----------
    name : str
        Name of the array; for a derivative ``der(x)``, the indices are inside: ``der(x[1])``.
    shape : tuple of int
        Shape of the array.
    """
    if not shape:
        return [name]
    end = ")" if name.startswith("der(") else ""
    places = product(*(range(1, n + 1) for n in shape))
    return [
        f"{name.removesuffix(end)}[{','.join(map(str, place))}]{end}"
        for place in places
    ]
