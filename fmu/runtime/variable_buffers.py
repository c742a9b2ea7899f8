"""Access to several variables of an FMU as one vector of floats, with preallocated buffers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.description import FmuVariable
from trussflow.fmu.runtime.library import Library


@dataclass(slots=True, eq=False)
class _Part:
    """The variables of one type."""

    type: str
    references: list[int]
    places: Any
    buffer: Any


class VariableBuffers:
    """Several variables of an FMU as one vector.

    Parameters
    ----------
    variables : sequence of FmuVariable
        The variables; arrays are stored in row-major order.
    library : Library
        Library of the instance.
    writes : bool
        Whether the buffers set the variables; else they get them. Some FMUs have only one of the
        two functions.

    Attributes
    ----------
    values : Vector
        The values [units as the FMU states], which `write` sends and `read` updates.
    """

    def __init__(
        self, variables: Sequence[FmuVariable], library: Library, *, writes: bool
    ) -> None:
        self.variables = tuple(variables)
        ends = np.cumsum([0, *(v.size for v in self.variables)])
        self.values: Vector = np.zeros(int(ends[-1]))
        self._library = library
        self._writes = writes
        members: dict[tuple[str, Any], list[FmuVariable]] = {}
        places: dict[tuple[str, Any], list[int]] = {}
        for variable, (start, end) in zip(self.variables, pairwise(ends), strict=True):
            accessor = library.accessors[variable.type]
            members.setdefault(accessor, []).append(variable)
            places.setdefault(accessor, []).extend(range(start, end))
        # the vector itself is the buffer then
        plain = all(kind is np.float64 for _, kind in members)
        self._parts = [
            _Part(
                alike[-1].type,
                [v.reference for v in alike],
                None if plain else np.array(places[accessor]),
                self.values
                if plain
                else np.zeros(len(places[accessor]), dtype=accessor[1]),
            )
            for accessor, alike in members.items()
            if places[accessor]
        ]

    def bind(self) -> None:
        """Prepare the calls for the current instance."""
        self._calls = [
            self._library.accessor(
                not self._writes,
                part.type,
                part.references,
                part.buffer.ctypes.data,
                part.buffer.size,
            )
            for part in self._parts
        ]
        # Most FMUs need one call without conversion in every step: it avoids the loop.
        self._only = (
            self._calls[0]
            if len(self._parts) == 1 and self._parts[0].places is None
            else None
        )

    def write(self) -> None:
        """Send the values to the FMU.

        Raises
        ------
        FmuError
            If a value does not fit its type, or the FMU rejects it.
        """
        if self._only is not None:
            self._only()
            return
        for part, call in zip(self._parts, self._calls, strict=True):
            if part.places is not None:
                self._convert(part)
            call()

    def read(self) -> None:
        """Read the values from the FMU.

        Raises
        ------
        FmuCallError
            If the FMU cannot compute the values.
        """
        if self._only is not None:
            self._only()
            return
        for part, call in zip(self._parts, self._calls, strict=True):
            call()
            if part.places is not None:
                self.values[part.places] = part.buffer

    def _convert(self, part: _Part) -> None:
        """Convert floats to the type of the FMU; raise an error for values outside its range."""
        given = self.values[part.places]
        kind = part.buffer.dtype
        if kind.kind == "f":
            largest = float(np.finfo(kind).max)
            wrong = np.isfinite(given) & (np.abs(given) > largest)
            takes = f"numbers up to {largest:.4g}"
        else:
            low, high = (
                (0, 1)
                if part.type == "Boolean"
                else (np.iinfo(kind).min, np.iinfo(kind).max)
            )
            # The largest 64-bit integer is not a float, but its successor is: hence "<".
            wrong = ~(
                (given == np.rint(given))
                & (given >= float(low))
                & (given < float(high + 1))
            )
            takes = (
                "0 or 1"
                if part.type == "Boolean"
                else f"whole numbers from {low} to {high}"
            )
        if wrong.any():
            names = [v.name for v in self.variables for _ in range(v.size)]
            place = int(np.asarray(part.places)[np.flatnonzero(wrong)[0]])
            raise FmuError(
                f"FMU '{self._library.description.name}': '{names[place]}' cannot be "
                f"{self.values[place]:g}; it is of type {part.type} and takes {takes}"
            )
        part.buffer[:] = given
