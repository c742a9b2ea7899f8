"""References to ports, slices and states, and their labels in models."""

from __future__ import annotations

import ast
import contextlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError, NameLookupError
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Indices, System, resolved, targets
from trussflow.blocks.support.validation import shown
from trussflow.blocks.tracing.plan import Plan

Reference = str | Port
"""A port, whole or sliced: as a port, or as ``"port"``, ``"block.port"``, ``"block.port[0:3]"``."""

References = Sequence[Reference] | Reference | None


@dataclass(frozen=True, slots=True)
class Named:
    """A port, or a slice of one, as the user named it.

    Attributes
    ----------
    port : Port
        The port: of a leaf block, or of a diagram.
    label : str
        Its name in linear models.
    apart : bool
        Whether the elements of a slice have that name, as those of an analysis point: they are then
        counted from 0 on, not as in the whole port.
    """

    port: Port
    label: str
    apart: bool = False

    @property
    def leaf(self) -> Port:
        """The port of the leaf block that it stands for."""
        return resolved(self.port)

    @property
    def key(self) -> tuple[tuple[str, ...], tuple[int, ...]]:
        """Identity of the signal: ports of leaf blocks, and elements."""
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
        elements = self.port.elements()
        if self.apart:
            return element_labels(self.label, elements.shape, np.arange(elements.size))
        return element_labels(self.label, self.port.whole_shape or (), elements.ravel())


def named(system: System, reference: Reference) -> Named:
    """Return the port that a user names.

    Parameters
    ----------
    system : System
        The flat diagram.
    reference : str or Port
        Value from the user.

    Raises
    ------
    NameLookupError
        If there is no such block or port; the message lists what there is.
    WiringError
        If the index does not fit the port.
    """
    name, apart = "", False
    if isinstance(reference, Port):
        system.port(reference)  # refuses ports of other diagrams
        port = reference
    elif not isinstance(reference, str):
        raise NameLookupError(
            f"name a port, as a port or as 'block.port'; not {reference!r}"
        )
    else:
        name, index = split_index(reference)
        port = system.port_of(name, reference)
        apart = port.index is not None and index is None
        port = port if index is None else port[index]
    outermost = port.block is system.root
    return Named(port, port.name if outermost else label_of(name or port.path), apart)


def all_named(
    system: System, given: References, default: Sequence[Reference]
) -> list[Named]:
    """Return the ports that a user names, one or several, or the default where none are given.

    Parameters
    ----------
    system : System
        The flat diagram.
    given, default : sequence of str or Port
        References from the user, and the ports that replace None.
    """
    return [
        named(system, reference)
        for reference in listed(default if given is None else given)
    ]


def listed(given: References) -> list[Reference]:
    """Return what a user gave, one reference or several, as a list."""
    if given is None:
        return []
    return (
        [given]
        if isinstance(given, str) or not isinstance(given, Sequence)
        else [*given]
    )


def all_labels(found: Iterable[Named]) -> list[str]:
    """Return the names of the elements of several ports."""
    return [label for one in found for label in one.labels()]


def distinct_labels(cannot: str, what: str, found: Sequence[Named]) -> list[str]:
    """Return the names of the elements of several ports, of which there must be some.

    Parameters
    ----------
    cannot, what : str
        Purpose and kind of the references, for messages.
    found : sequence of Named
        The ports.

    Raises
    ------
    LinearAnalysisError
        If there are none, or an element is named twice.
    """
    labels = all_labels(found)
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if not labels:
        raise LinearAnalysisError(
            f"{cannot} without {what}: name ports with {what}=[...], or expose some with "
            "diagram.expose(name=port)"
        )
    if twice:
        raise LinearAnalysisError(f"{what} name elements twice: {', '.join(twice)}")
    return labels


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


def state_places(plan: Plan, layouts: list[Layout], reference: str) -> Indices:
    """Return where the elements of a state such as ``"truss.q[0:3]"`` are in (x, d).

    Parameters
    ----------
    plan : Plan
        The plan.
    layouts : list of Layout
        Layouts that may contain the state.
    reference : str
        Value from the user.

    Raises
    ------
    NameLookupError
        If there is no such state, or the index does not fit; the message lists the states.
    """
    text, index = split_index(reference)
    called_so = ([e for e in layout if e.name == text] for layout in layouts)
    alone = [found[0] for found in called_so if len(found) == 1]
    entry = alone[0] if alone else layouts[0].find(text, "state", *layouts[1:])
    elements = selected(entry.shape, index, reference, "state")
    return np.asarray(plan.place(entry.path, entry.name).start + elements)


def label_places(labels: Sequence[str], reference: str) -> Indices:
    """Return where ``"block.state"`` or ``"state[0:3]"`` is among labels such as ``block/state[0]``.

    Parameters
    ----------
    labels : sequence of str
        The labels, as linear models have them.
    reference : str
        Reference from the user; the path may be omitted if the name is unique.

    Raises
    ------
    NameLookupError
        If none or several are meant; the message lists those there are.
    """
    if not isinstance(reference, str):
        raise NameLookupError(
            f"name a state or signal as 'block.name', not {shown(reference)}"
        )
    if label_of(reference) in labels:
        # one element, maybe of an array that is not all there
        return np.asarray(labels.index(label_of(reference)))
    text, index = split_index(reference)
    wanted = label_of(text)
    arrays = dict[str, list[int]]()
    for i, label in enumerate(labels):
        arrays.setdefault(label.partition("[")[0], []).append(i)
    found = (
        [wanted]
        if wanted in arrays
        else [name for name in arrays if name.endswith(f"/{wanted}")]
    )
    if len(found) == 1:
        elements = arrays[found[0]]
        last = labels[elements[-1]].partition("[")[2].rstrip("]")
        shape = tuple(int(i) + 1 for i in last.split(",")) if last else ()
        with contextlib.suppress(IndexError, ValueError):
            return np.asarray(
                np.reshape(elements, shape)[() if index is None else index]
            )
    raise NameLookupError(
        f"{f'{len(found)} arrays are' if len(found) > 1 else 'nothing is'} called '{reference}'; there are: "
        f"{', '.join(label.replace('/', '.') for label in labels)}"
    )


def selected(shape: tuple[int, ...], index: Any, reference: str, kind: str) -> Indices:
    """Return the row-major numbers of the elements of an array that an index selects.

    Parameters
    ----------
    shape : tuple of int
        Shape of the array [-].
    index : Any
        As `split_index` returns it.
    reference, kind : str
        Reference from the user, and its kind, for the message.

    Raises
    ------
    NameLookupError
        If the index does not fit.
    """
    whole = np.arange(prod(shape)).reshape(shape)
    try:
        return np.ravel(whole if index is None else whole[index])
    except IndexError as error:
        raise NameLookupError(
            f"'{reference}' does not fit the {kind}'s shape {shape}: {error}"
        ) from None


def layout_labels(layout: Layout) -> list[str]:
    """Return the names of all elements of a layout."""
    found = []
    for e in layout:
        path = label_of(f"{e.path}.{e.name}")
        found += element_labels(path, e.shape, np.arange(e.stop - e.start))
    return found
