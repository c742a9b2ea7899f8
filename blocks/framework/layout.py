"""Layout of named arrays in the flat vectors of compiled code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.errors import NameLookupError
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.support.types import Array, Vector


def spans(sizes: Iterable[int]) -> list[slice]:
    """Return the slices of a vector for consecutive arrays of these `sizes` [-]."""
    return [
        slice(start, stop) for start, stop in pairwise(accumulate(sizes, initial=0))
    ]


@dataclass(frozen=True, slots=True)
class Entry:
    """Array of a block at `path`, with its `name`, `shape`, and index `start` in a flat vector."""

    path: str
    name: str
    shape: tuple[int, ...]
    start: int

    @property
    def stop(self) -> int:
        """End of the slice."""
        return self.start + prod(self.shape)


class BlockSignals(dict[str, Signals]):
    """Signals by block path; those of a block without any are empty."""

    def __missing__(self, path: str) -> Signals:
        self[path] = Signals(f"block '{path}'", {})
        return self[path]


class Layout:
    """The order of named arrays in one vector, `flat` [as declared].

    An array is identified by the `path` of its block and its `name` there.

    Parameters
    ----------
    arrays : iterable of (path, name, shape)
        Block path, name within the block, and shape.
    start : int
        Index of the first element [-], if the arrays are a part of a longer vector.

    Attributes
    ----------
    span : slice
        Slice of the vector that contains the arrays.
    """

    def __init__(
        self, arrays: Iterable[tuple[str, str, tuple[int, ...]]], start: int = 0
    ) -> None:
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
        """Return the arrays of one block, which are contiguous."""
        return self._of.get(path, [])

    def span_of(self, path: str) -> slice:
        """Return the slice of the vector that contains the arrays of one block."""
        own = self.of(path)
        # The arrays of a block are contiguous, see `of`.
        return slice(own[0].start, own[-1].stop) if own else slice(0, 0)

    def describe(self, place: int) -> str:
        """Return the name of the element of the vector with index `place`, for messages."""
        # An array without elements contains no place, so the match is unique.
        entry = next(e for e in self if e.start <= place < e.stop)
        element = f" (element {place - entry.start})" if entry.shape else ""
        return f"'{entry.path}.{entry.name}'{element}"

    def unpack(
        self,
        flat: Array,
        make: Callable[[Array, tuple[int, ...]], Array],
        into: BlockSignals | None = None,
    ) -> BlockSignals:
        """Return the arrays in `flat` by block path.

        Parameters
        ----------
        flat : vector or casadi.SX
            The whole vector.
        make : callable
            Converts a slice of `flat` to an array of a given shape.
        into : BlockSignals, optional
            Signals to which the arrays are added.
        """
        found = BlockSignals() if into is None else into
        for e in self:
            found[e.path][e.name] = make(flat[e.start : e.stop], e.shape)
        return found

    def find(self, reference: str, what: str, *others: Layout, hint: str = "") -> Entry:
        """Return the array with the `reference` ``"block.name"``, in this layout or in the `others`.

        Raises
        ------
        NameLookupError
            If there is none; the message names the kind, `what`, gives the `hint`, and lists all arrays.
        """
        # From the right: paths of blocks in nested diagrams contain dots.
        path, _, name = reference.rpartition(".")
        layouts = (self, *others)
        for layout in layouts:
            if (path, name) in layout.entries:
                return layout.entries[path, name]
        names = (
            ", ".join(f"{e.path}.{e.name}" for layout in layouts for e in layout)
            or "none"
        )
        raise NameLookupError(
            f"no {what} '{reference}'{hint}; the {what}s are: {names}"
        )

    def put(self, flat: Vector, path: str, name: str, value: Any) -> None:
        """Write the `value` of one array into the vector."""
        entry = self.entries[path, name]
        flat[entry.start : entry.stop] = np.ravel(value)

    def named(self, flat: Vector) -> dict[str, Array]:
        """Return copies of the arrays by ``"block.name"``."""
        return {
            f"{e.path}.{e.name}": np.reshape(flat[e.start : e.stop], e.shape).copy()
            for e in self
        }

    def signals(self, path: str, flat: Vector) -> Signals:
        """Return the arrays of one block as read-only views, which show later changes of the vector."""
        arrays = {
            e.name: flat[e.start : e.stop].reshape(e.shape) for e in self.of(path)
        }
        for array in arrays.values():
            array.flags.writeable = False
        return Signals(f"block '{path}'", arrays)

    def listed(self, flat: Vector) -> dict[str, list[float]]:
        """Return the arrays by ``"block.name"``, for files."""
        return {f"{e.path}.{e.name}": flat[e.start : e.stop].tolist() for e in self}

    def fault(self, flat: Vector) -> str:
        """Return the name of the first element that is not finite, or an empty text."""
        bad = ~np.isfinite(flat[self.span])
        return self.describe(self.span.start + int(np.argmax(bad))) if bad.any() else ""
