"""Where everything sits in the flat vectors that compiled code works on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Array, Vector


@dataclass(frozen=True, slots=True)
class Entry:
    """One named array within a flat vector."""

    path: str
    name: str
    shape: tuple[int, ...]
    start: int

    @property
    def stop(self) -> int:
        """End of the slice."""
        return self.start + prod(self.shape)

    def describe(self, element: int) -> str:
        """Name one element."""
        return f"'{self.path}.{self.name}'" + (f" (element {element})" if self.shape else "")


class Layout:
    """The order of named arrays in one flat vector.

    Parameters
    ----------
    arrays : iterable of (path, name, shape)
        Block path, name within the block, and shape.
    """

    def __init__(self, arrays: Iterable[tuple[str, str, tuple[int, ...]]]) -> None:
        self.entries: dict[tuple[str, str], Entry] = {}
        start = 0
        for path, name, shape in arrays:
            entry = Entry(path, name, shape, start)
            self.entries[path, name] = entry
            start = entry.stop
        self.size = start

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries.values())

    def of(self, path: str) -> list[Entry]:
        """Return the arrays of one block."""
        return [e for e in self if e.path == path]

    def unpack(self, flat: Array, make: Callable[[Array, tuple[int, ...]], Array]) -> dict[str, Any]:
        """Return the arrays in `flat` by block path, as `Signals`.

        Parameters
        ----------
        flat : vector or casadi.SX
            The whole vector.
        make : callable
            Makes an array of a given shape from a slice of `flat`.
        """
        found: dict[str, Signals] = {}
        for e in self:
            signals = found.setdefault(e.path, Signals(f"block '{e.path}'", {}))
            signals[e.name] = make(flat[e.start : e.stop], e.shape)
        return found

    def put(self, flat: Vector, path: str, name: str, value: Any) -> None:
        """Write one array into its place in `flat`."""
        entry = self.entries[path, name]
        flat[entry.start : entry.stop] = np.ravel(value)

    def named(self, flat: Vector) -> dict[str, Array]:
        """Return copies of the arrays in `flat` by ``"block.name"``."""
        return {f"{e.path}.{e.name}": np.reshape(flat[e.start : e.stop], e.shape).copy() for e in self}

    def listed(self, flat: Vector) -> dict[str, list[float]]:
        """Return the arrays in `flat` by ``"block.name"``, for files."""
        return {f"{e.path}.{e.name}": flat[e.start : e.stop].tolist() for e in self}

    def fault(self, flat: Vector) -> str:
        """Name the first array in `flat` with an element that is not finite, if any."""
        for e in self:
            part = flat[e.start : e.stop]
            if not np.isfinite(part).all():
                return e.describe(int(np.argmin(np.isfinite(part))))
        return ""
