"""Where everything sits in the flat vectors that compiled code works on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import NameLookupError
from trussflow.blocks.framework.types import Array, Vector


def spans(sizes: Iterable[int]) -> list[slice]:
    """Return the parts of a vector that arrays of these `sizes` [-] take, one behind the other."""
    return [slice(start, stop) for start, stop in pairwise(accumulate(sizes, initial=0))]


@dataclass(frozen=True, slots=True)
class Entry:
    """The array of a `name` and `shape` of the block at `path`, at `start` of a flat vector."""

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
    """The order of named arrays in one vector, `flat` [as declared].

    An array is known by the `path` of its block and its `name` there.

    Parameters
    ----------
    arrays : iterable of (path, name, shape)
        Block path, name within the block, and shape.
    start : int
        Where the first one begins: what is laid out may be a part of a longer vector [-].

    Attributes
    ----------
    span : slice
        The part of the vector that the arrays take.
    """

    def __init__(self, arrays: Iterable[tuple[str, str, tuple[int, ...]]], start: int = 0) -> None:
        self.entries: dict[tuple[str, str], Entry] = {}
        self._of: dict[str, list[Entry]] = {}
        first = start
        for path, name, shape in arrays:
            entry = Entry(path, name, shape, start)
            self.entries[path, name] = entry
            self._of.setdefault(path, []).append(entry)
            start = entry.stop
        self.span = slice(first, start)
        self.size = start - first

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries.values())

    def of(self, path: str) -> list[Entry]:
        """Return the arrays of one block, which stand one after the other."""
        return self._of.get(path, [])

    def span_of(self, path: str) -> slice:
        """Return the part of the vector that the arrays of one block take."""
        own = self.of(path)
        return slice(own[0].start, own[-1].stop) if own else slice(0, 0)

    def at(self, place: int) -> Entry:
        """Return the array that an element of the vector belongs to."""
        return next(e for e in self if e.start <= place < e.stop)

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

    def find(self, reference: str, what: str, *others: Layout, hint: str = "") -> Entry:
        """Return the array that a `reference` ``"block.name"`` means, here or in the `others`.

        Raises
        ------
        NameLookupError
            If there is none; the message says `what` it should have been and gives the `hint`, and lists all.
        """
        path, _, name = reference.rpartition(".")
        layouts = (self, *others)
        for layout in layouts:
            if (path, name) in layout.entries:
                return layout.entries[path, name]
        names = ", ".join(f"{e.path}.{e.name}" for layout in layouts for e in layout) or "none"
        raise NameLookupError(f"no {what} '{reference}'{hint}; the {what}s are: {names}")

    def put(self, flat: Vector, path: str, name: str, value: Any) -> None:
        """Write the `value` of one array into its place."""
        entry = self.entries[path, name]
        flat[entry.start : entry.stop] = np.ravel(value)

    def named(self, flat: Vector) -> dict[str, Array]:
        """Return copies of the arrays by ``"block.name"``."""
        return {f"{e.path}.{e.name}": np.reshape(flat[e.start : e.stop], e.shape).copy() for e in self}

    def signals(self, path: str, flat: Vector) -> Signals:
        """Return the arrays of one block: views, which follow what is written there."""
        arrays = {e.name: flat[e.start : e.stop].reshape(e.shape) for e in self.of(path)}
        for array in arrays.values():
            array.flags.writeable = False  # to be looked at
        return Signals(f"block '{path}'", arrays)

    def listed(self, flat: Vector) -> dict[str, list[float]]:
        """Return the arrays by ``"block.name"``, for files."""
        return {f"{e.path}.{e.name}": flat[e.start : e.stop].tolist() for e in self}

    def fault(self, flat: Vector) -> str:
        """Name the first array with an element that is not finite, if any."""
        for e in self:
            part = flat[e.start : e.stop]
            if not np.isfinite(part).all():
                return e.describe(int(np.argmin(np.isfinite(part))))
        return ""
