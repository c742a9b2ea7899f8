"""Banks: some variables of an FMU as one vector of floats, with buffers that are made once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.description import FmuVariable
from trussflow.fmu.runtime.library import WARNING, Library

DOUBLES = (np.float64,)
"""The C type whose buffer is the vector itself."""


@dataclass(slots=True, eq=False)
class _Part:
    """The variables of a bank that have one type."""

    type: str
    references: list[int]
    places: Any
    buffer: Any


class VariableBuffers:
    """Some variables of an FMU, as one vector.

    Parameters
    ----------
    variables : sequence of FmuVariable
        The variables; arrays are laid out in row-major order.
    library : Library
        Knows the types.
    writes : bool
        Whether the bank is for setting the variables, else for getting them: not every FMU has
        the functions for both.

    Attributes
    ----------
    values : Vector
        The values [units as the FMU states]; `write` takes them from here, `read` puts them here.
    """

    def __init__(self, variables: Sequence[FmuVariable], library: Library, *, writes: bool) -> None:
        self.variables = tuple(variables)
        sizes = [v.size for v in self.variables]
        ends = np.cumsum([0, *sizes])
        self.values: Vector = np.zeros(int(ends[-1]))
        self._library, self._writes = library, writes
        places: dict[str, list[int]] = {}
        references: dict[str, list[int]] = {}
        for variable, start, size in zip(self.variables, ends, sizes, strict=False):
            accessor = library.accessors[variable.type][0]
            places.setdefault(accessor, []).extend(range(start, start + size))
            references.setdefault(accessor, []).append(variable.reference)
        types = {library.accessors[v.type][0]: v.type for v in self.variables}
        plain = {library.accessors[kind][1] for kind in types.values()} <= set(DOUBLES)
        self._parts = [
            _Part(
                kind,
                references[accessor],
                None if plain else np.array(places[accessor]),
                self.values if plain else np.zeros(len(places[accessor]), dtype=library.accessors[kind][1]),
            )
            for accessor, kind in types.items()
            if places[accessor]
        ]

    def bind(self) -> None:
        """Prepare the calls for the present instance."""
        self._calls = [
            self._library.accessor(
                not self._writes, part.type, part.references, part.buffer.ctypes.data, part.buffer.size
            )
            for part in self._parts
        ]
        self._single = len(self._parts) == 1 and self._parts[0].places is None
        if self._single:
            self._name, self._call = self._calls[0]

    def write(self) -> None:
        """Give the values to the FMU.

        Raises
        ------
        FmuError
            If a value is none of its type, or the FMU refuses it.
        """
        if self._single:
            if (status := self._call()) > WARNING:
                self._library.fail(self._name, status)
            return
        for part, (name, call) in zip(self._parts, self._calls, strict=True):
            if part.places is not None:
                self._convert(part)
            if (status := call()) > WARNING:
                self._library.fail(name, status)

    def read(self) -> None:
        """Take the values from the FMU.

        Raises
        ------
        FmuCallError
            If it cannot compute them.
        """
        if self._single:
            if (status := self._call()) > WARNING:
                self._library.fail(self._name, status)
            return
        for part, (name, call) in zip(self._parts, self._calls, strict=True):
            if (status := call()) > WARNING:
                self._library.fail(name, status)
            if part.places is not None:
                self.values[part.places] = part.buffer

    def _convert(self, part: _Part) -> None:
        """Turn floats into the type of the FMU; refuse what is no such number."""
        given = self.values[part.places]
        if part.buffer.dtype.kind == "f":
            part.buffer[:] = given
            return
        truth = part.type == "Boolean"
        low, high = (0, 1) if truth else _bounds(part.buffer.dtype)
        wrong = ~((given == np.rint(given)) & (given >= low) & (given <= high))
        if wrong.any():
            place = int(np.asarray(part.places)[np.flatnonzero(wrong)[0]])
            raise FmuError(
                f"FMU '{self._library.description.name}': '{self._name_at(place)}' cannot be "
                f"{self.values[place]:g}; it is of type {part.type} and takes "
                + ("0 or 1" if truth else f"whole numbers from {low} to {high}")
            )
        part.buffer[:] = given

    def _name_at(self, place: int) -> str:
        """Return the name of the variable at a place of the vector."""
        end = 0
        for variable in self.variables:
            end += variable.size
            if place < end:
                break
        return variable.name


def _bounds(kind: Any) -> tuple[int, int]:
    limits = np.iinfo(kind)
    return int(limits.min), int(limits.max)


def write_text(library: Library, values: Iterable[tuple[FmuVariable, Sequence[str]]]) -> None:
    """Set variables that are text.

    Parameters
    ----------
    library : Library
        The instance.
    values : iterable of (FmuVariable, sequence of str)
        Variables with one text per element.
    """
    import ctypes

    for variable, texts in values:
        listed = (ctypes.c_char_p * len(texts))(*(text.encode() for text in texts))
        name, call = library.accessor(False, "String", [variable.reference], listed, len(texts))
        if (status := call()) > WARNING:
            library.fail(name, status)
