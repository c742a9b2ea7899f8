"""The variables of an FMU: one per port, parameter and state."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from itertools import product
from math import prod
from typing import Any

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
    state : int or None
        For a derivative, the value reference of its state.
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
        """The unit that all elements have, if there is one."""
        return self.units[0] if self.units and len(set(self.units)) == 1 else None

    def scalars(self) -> list[str]:
        """Return the names of the elements."""
        return element_names(self.name, self.shape)

    def elements(self) -> Group:
        """Return the elements as variables of their own."""
        return tuple(
            replace(
                self,
                name=name,
                shape=(),
                reference=self.reference + i,
                start=None if self.start is None else self.start[i : i + 1],
                units=self.units[i : i + 1],
                state=None if self.state is None else self.state + i,
            )
            for i, name in enumerate(self.scalars())
        )

    def description(self) -> str:
        """Return the meaning, with the units where an array mixes them."""
        if not self.units or self.unit is not None or not any(self.units):
            return self.meaning
        changes = [0, *(i for i in range(1, self.size) if self.units[i] != self.units[i - 1])]
        ends = [*changes[1:], self.size]
        runs = (f"{b - a} x {self.units[a] or 'not stated'}" for a, b in zip(changes, ends, strict=True))
        units = f"units in order: {', '.join(runs)}"
        return f"{self.meaning}; {units}" if self.meaning else units


Group = tuple[Variable, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Variables:
    """All variables of an FMU in the order of their value references, which iteration follows.

    Attributes
    ----------
    time : Variable
        The independent variable.
    inputs, parameters, states, derivatives, outputs : tuple of Variable
        The others.
    modes, indicators : tuple of Variable
        What changes at events only, and the indicators of events that are not known in advance.
    memory : tuple of Variable
        The states that change at instants only, which FMUs keep to themselves, counted as in d.
    """

    time: Variable
    inputs: Group
    parameters: Group
    states: Group
    derivatives: Group
    outputs: Group
    modes: Group
    indicators: Group
    memory: Group

    def __iter__(self) -> Iterator[Variable]:
        """Yield all variables, but for the memory."""
        yield self.time
        yield from self.inputs + self.parameters + self.states + self.derivatives + self.outputs
        yield from self.modes + self.indicators

    def scalarized(self) -> Variables:
        """Return them with a variable for each element."""
        groups = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "time"}
        elements: dict[str, Any] = {
            name: tuple(e for v in group for e in v.elements()) for name, group in groups.items()
        }
        return replace(self, **elements)

    def settable_states(self) -> list[bool]:
        """Return for each element of the states whether an importer may choose where it starts."""
        return [v.initial == "exact" for v in self.states for _ in v.references]

    def tunable_parameters(self) -> list[bool]:
        """Return for each element of the parameters whether it may change while time goes on."""
        return [v.variability == "tunable" for v in self.parameters for _ in v.references]


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of the elements of an array, row by row: ``u[1,2]``; of a scalar, its own.

    Parameters
    ----------
    name : str
        Name of the array; that of a derivative, ``der(x)``, gets the indices inside.
    shape : tuple of int
        Its shape.
    """
    if not shape:
        return [name]
    end = ")" if name.startswith("der(") else ""
    places = product(*(range(1, n + 1) for n in shape))
    return [f"{name.removesuffix(end)}[{','.join(map(str, place))}]{end}" for place in places]
