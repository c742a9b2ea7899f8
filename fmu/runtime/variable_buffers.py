"""Access to several variables of an FMU as one vector of floats, with preallocated buffers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.description import FmuVariable
from trussflow.fmu.runtime.library import Library


@dataclass(slots=True, eq=False)
class _Part:
    """The variables of one type, and their places in the vector, which may be their buffer."""

    type: str
    continuous: bool
    references: list[int]
    places: Any
    buffer: Any
    call: Any = None


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
    continuous : array of bool
        Whether each element may change between events.
    """

    def __init__(
        self, variables: Sequence[FmuVariable], library: Library, *, writes: bool
    ) -> None:
        self.variables = tuple(variables)
        self.values: Vector = np.zeros(sum(v.size for v in self.variables))
        self._library = library
        self._writes = writes
        self.continuous = continuous_elements(self.variables)
        members: dict[tuple[str, Any, bool], list[tuple[FmuVariable, range]]] = {}
        for variable, span in shares(self.variables, range(self.values.size)):
            # continuous inputs are also written alone
            alone = writes and variable.is_continuous
            # One call serves types with the same function, as Integer and Enumeration.
            key = (*library.accessors[variable.type], alone)
            members.setdefault(key, []).append((variable, span))
        # the vector itself is the buffer then
        plain = len(members) == 1 and all(kind is np.float64 for _, kind, _ in members)
        self._parts: list[_Part] = []
        for (_, kind, alone), alike in members.items():
            places = np.concatenate([span for _, span in alike]).astype(int)
            if places.size:
                self._parts.append(
                    _Part(
                        alike[-1][0].type,
                        alone,
                        [v.reference for v, _ in alike],
                        places,
                        self.values if plain else np.zeros(places.size, dtype=kind),
                    )
                )

    def bind(self) -> None:
        """Prepare the calls for the current instance."""
        for part in self._parts:
            part.call = self._library.accessor(
                not self._writes,
                part.type,
                part.references,
                part.buffer.ctypes.data,
                part.buffer.size,
            )

    def compiled(self) -> tuple[Any, NDArray[np.int64]]:
        """Return the call for C code, if any, and the places in the vector of the values that it passes.

        These are the 64-bit floats; if it writes, only those that may change between events.
        """
        for part in self._parts:
            if part.continuous == self._writes and part.buffer.dtype == np.float64:
                return part.call, part.places
        return None, np.arange(0)

    def write(self, *, only_continuous: bool = False) -> None:
        """Send the values to the FMU.

        Parameters
        ----------
        only_continuous : bool
            Whether to send only the variables that may change between events.

        Raises
        ------
        FmuError
            If a value does not fit its type, or the FMU rejects it.
        """
        for part in self._parts:
            if only_continuous and not part.continuous:
                continue
            if part.buffer is not self.values:
                self._convert(part)
            part.call()

    def read(self) -> None:
        """Read the values from the FMU.

        Raises
        ------
        FmuCallError
            If the FMU cannot compute the values.
        """
        for part in self._parts:
            part.call()
            if part.buffer is not self.values:
                self.values[part.places] = part.buffer

    def _convert(self, part: _Part) -> None:
        """Convert floats to the type of the FMU; raise an error for values outside its range."""
        given = self.values[part.places]
        kind = part.buffer.dtype
        if kind.kind == "f":
            largest = float(np.finfo(kind).max)
            # NaN and infinity exist in each floating-point type.
            wrong = np.isfinite(given) & (np.abs(given) > largest)
            takes = f"numbers up to {largest:.4g}"
        else:
            low, high = (
                (0, 1)
                if part.type == "Boolean"
                else (np.iinfo(kind).min, np.iinfo(kind).max)
            )
            # The largest 64-bit integer is not a float, but its successor is: hence "<".
            # Negated, so that NaN counts as wrong: its comparisons are all false.
            wrong = ~(
                (given == np.rint(given))
                & (given >= float(low))
                & (given < float(high + 1))
            )
            takes = f"whole numbers from {low} to {high}"
        if wrong.any():
            names = [v.name for v in self.variables for _ in range(v.size)]
            place = int(np.asarray(part.places)[np.flatnonzero(wrong)[0]])
            raise FmuError(
                f"FMU '{self._library.description.name}': '{names[place]}' cannot be "
                f"{self.values[place]:g}; it is of type {part.type} and takes {takes}"
            )
        part.buffer[:] = given


def continuous_elements(variables: Sequence[FmuVariable]) -> NDArray[np.bool_]:
    """Return whether each element of `variables` may change between events."""
    sizes = [v.size for v in variables]
    return np.repeat(np.array([v.is_continuous for v in variables], dtype=bool), sizes)


def shares(
    variables: Sequence[FmuVariable], values: Any
) -> list[tuple[FmuVariable, Any]]:
    """Return each variable with its slice of the values.

    Parameters
    ----------
    variables : sequence of FmuVariable
        The variables.
    values : Vector or list of str
        Values of all elements, concatenated [units as the FMU states].
    """
    ends = np.cumsum([0, *(v.size for v in variables)])
    return [
        (v, values[a:b]) for v, (a, b) in zip(variables, pairwise(ends), strict=True)
    ]
