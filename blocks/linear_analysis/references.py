"""References to ports, slices and states, and their labels in models."""

from __future__ import annotations

import ast
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
        return set(product(*self.key))

    @property
    def _leaves(self) -> tuple[str, ...]:
        leaves = targets(self.port) if self.port.is_input else [self.leaf]
        return tuple(leaf.path for leaf in leaves)

    def labels(self) -> list[str]:
        """Return the names of the elements."""
        elements = self.port.elements()
        if self.apart:
            return element_labels(self.label, elements.shape)
        every = element_labels(self.label, self.port.whole_shape or ())
        return [every[e] for e in elements.ravel()]


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
    """Return the references of the user, one or several, as a list."""
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
    """Return a dotted path with slashes, as python-control forbids dots in names."""
    return path.replace(".", "/")


def split_index(text: str) -> tuple[str, Any]:
    """Split ``"block.port[0:3]"`` into the name and a NumPy index, or None without one.

    Raises
    ------
    NameLookupError
        If the text in the brackets is not an index.
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


def element_labels(label: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of the elements of an array: ``name[2]``, or ``name`` of a scalar.

    Parameters
    ----------
    label : str
        Name of the array.
    shape : tuple of int
        Its shape [-].
    """
    if not shape:
        return [label]
    indices = product(*map(range, shape))
    return [f"{label}[{','.join(map(str, index))}]" for index in indices]


def label_places(labels: Sequence[str], reference: str) -> Indices:
    """Return where ``"block.state"`` or ``"state[0:3]"`` is among labels such as ``block/state[0]``.

    Parameters
    ----------
    labels : sequence of str
        The labels, as linear models have them.
    reference : str
        Reference from the user; the path may be omitted if the name is unique.

    Returns
    -------
    array of int
        Indices, in the shape of the array or of its slice.

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
        # One element, possibly of an array of which other elements are missing.
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
        # The last element, such as "1,2", gives the shape (2, 3). If elements are
        # missing, the reference is refused.
        last = labels[elements[-1]].partition("[")[2].rstrip("]")
        shape = tuple(int(i) + 1 for i in last.split(",")) if last else ()
        if len(elements) == prod(shape):
            try:
                return np.asarray(
                    # The index () returns the whole array.
                    np.reshape(elements, shape)[() if index is None else index]
                )
            except (IndexError, ValueError) as error:
                raise NameLookupError(
                    f"'{reference}' does not fit the shape {shape}: {error}"
                ) from None
    raise NameLookupError(
        f"{f'{len(found)} arrays are' if len(found) > 1 else 'nothing is'} called '{reference}'; there are: "
        f"{', '.join(label.replace('/', '.') for label in labels)}"
    )


def layout_labels(layout: Layout) -> list[str]:
    """Return the names of all elements of a layout."""
    return [
        label
        for e in layout
        for label in element_labels(label_of(f"{e.path}.{e.name}"), e.shape)
    ]


def plan_labels(plan: Plan) -> list[str]:
    """Return the names of all elements of (x, d) of a plan; those of external inputs have no path."""
    layouts = plan.layouts[:-2]
    found = [label for layout in layouts for label in layout_labels(layout)]
    for name, e in zip(plan.system.external, plan.u, strict=True):
        found += element_labels(name, e.shape)
    return found
