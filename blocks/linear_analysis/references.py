"""What users name: ports and slices of them, states, and the labels these have in models."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from trussflow.blocks.framework.errors import NameLookupError
from trussflow.blocks.framework.layout import Entry, Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Indices, System, resolved, targets

Reference = str | Port
"""A port, whole or sliced: as a port, or as ``"port"``, ``"block.port"``, ``"block.port[0:3]"``."""


@dataclass(frozen=True, slots=True)
class Named:
    """A port, or a slice of one, as the user named it.

    Attributes
    ----------
    port : Port
        The port: of a leaf block, or of a diagram.
    label : str
        Its name in linear models.
    """

    port: Port
    label: str

    @property
    def leaf(self) -> Port:
        """The port of the leaf block that it stands for."""
        return resolved(self.port)

    @property
    def key(self) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """What tells it from other signals: the ports of leaf blocks, and the elements."""
        return self._leaves, tuple(int(e) for e in self.port.elements().ravel())

    @property
    def signals(self) -> set[tuple[str, int]]:
        """Each scalar signal that it stands for: port of a leaf block, and element."""
        return set(product(self._leaves, self.key[1]))

    @property
    def _leaves(self) -> tuple[str, ...]:
        leaves = targets(self.port) if self.port.is_input else [self.leaf]
        return tuple(leaf.path for leaf in leaves)

    def labels(self) -> list[str]:
        """Return the names of the elements."""
        return element_labels(self.label, self.port.whole_shape or (), self.port.elements().ravel())


def named(system: System, reference: Reference) -> Named:
    """Return the port that a user names.

    Parameters
    ----------
    system : System
        The flat diagram.
    reference : str or Port
        What the user gave.

    Raises
    ------
    NameLookupError
        If there is no such block or port; the message lists what there is.
    WiringError
        If the index does not fit the port.
    """
    if isinstance(reference, Port):
        system.port(reference)  # refuses ports of other diagrams
        port = reference
    elif not isinstance(reference, str):
        raise NameLookupError(f"name a port, as a port or as 'block.port'; not {reference!r}")
    else:
        text, index = split_index(reference)
        path, _, name = text.rpartition(".")
        block = system.diagrams.get(path) or system.blocks.get(path)
        if block is None and not path:
            block = system.root
        if block is None:
            blocks = ", ".join(b for b in system.blocks if not b.startswith("("))
            raise NameLookupError(f"no block '{path}' for '{reference}'; the blocks are: {blocks}")
        port = block.port(name)
        port = port if index is None else port[index]
    outermost = port.block is system.root
    return Named(port, port.name if outermost else label_of(port.path))


def label_of(path: str) -> str:
    """Return a dotted path as python-control allows it in names."""
    return path.replace(".", "/")


def split_index(text: str) -> tuple[str, Any]:
    """Split ``"block.port[0:3]"`` into the name and a NumPy index, or None without one.

    Raises
    ------
    NameLookupError
        If what stands in the brackets is no index.
    """
    match = re.fullmatch(r"([^\[\]]+)\[([^\[\]]*)\]", text.strip())
    if match is None:
        return text.strip(), None
    try:
        parts = tuple(_index_part(part) for part in match[2].split(","))
    except ValueError:
        raise NameLookupError(
            f"'{text}': an index is made of integers and slices, such as [2], [0:3] or [1, :]"
        ) from None
    return match[1], parts if len(parts) > 1 else parts[0]


def _index_part(text: str) -> int | slice:
    if ":" not in text:
        return int(ast.literal_eval(text.strip()))
    ends = [int(end) if end.strip() else None for end in text.split(":")]
    if len(ends) > 3:
        raise ValueError(text)
    return slice(*ends)


def element_labels(label: str, shape: tuple[int, ...], elements: Indices) -> list[str]:
    """Return the names of some elements of an array: ``name[2]``, or ``name`` of a scalar.

    Parameters
    ----------
    label : str
        Name of the array.
    shape : tuple of int
        Its shape [-].
    elements : array of int
        Row-major numbers of the elements [-].
    """
    if not shape:
        return [label] * len(elements)
    every = [",".join(map(str, index)) for index in product(*map(range, shape))]
    return [f"{label}[{every[e]}]" for e in elements]


def state_elements(layouts: list[Layout], reference: str) -> tuple[Layout, Entry, Indices]:
    """Return layout, entry and elements of a `reference` such as ``"truss.q[0:3]"`` in `layouts`.

    Raises
    ------
    NameLookupError
        If there is no such state, or the index does not fit; the message lists the states.
    """
    text, index = split_index(reference)
    path, _, name = text.rpartition(".")
    for layout in layouts:
        if (path, name) in layout.entries:
            entry = layout.entries[path, name]
            return layout, entry, _selected(entry, index, reference)
        short = [e for e in layout if e.name == text]
        if not path and len(short) == 1:
            return layout, short[0], _selected(short[0], index, reference)
    names = ", ".join(f"{e.path}.{e.name}" for layout in layouts for e in layout) or "none"
    raise NameLookupError(f"no state '{text}'; the states are: {names}")


def _selected(entry: Entry, index: Any, reference: str) -> Indices:
    whole = np.arange(entry.stop - entry.start).reshape(entry.shape)
    try:
        return np.ravel(whole if index is None else whole[index])
    except IndexError as error:
        raise NameLookupError(
            f"'{reference}' does not fit the state's shape {entry.shape}: {error}"
        ) from None


def layout_labels(layout: Layout) -> list[str]:
    """Return the names of all elements of a layout."""
    found = []
    for e in layout:
        path = label_of(f"{e.path}.{e.name}")
        found += element_labels(path, e.shape, np.arange(e.stop - e.start))
    return found
