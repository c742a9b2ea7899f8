"""Conversion of SSP's scalar connections to wires, and of system connectors to exposed ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.fmu.errors import SspError
from trussflow.fmu.runtime.array_ports import gather, legal_names
from trussflow.fmu.runtime.description import FmuVariable
from trussflow.fmu.ssp.names import XML_NAMESPACES


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Target of a scalar connector: an `element` of a `port`."""

    port: Port
    element: int


Ends = Mapping[str, Mapping[str, Place]]
"""Targets of connectors, by element and connector."""


def wire(
    diagram: Diagram,
    places: Ends,
    connections: Sequence[Element],
    system: Element,
    where: str,
) -> dict[str, Place]:
    """Connect the blocks of a diagram and expose its ports.

    Parameters
    ----------
    diagram : Diagram
        The diagram, with its blocks.
    places : mapping
        Targets of the connectors of each element.
    connections : sequence of Element
        The connections.
    system : Element
        The system.
    where : str
        Name of the file, for error messages.

    Returns
    -------
    dict
        Targets of the connectors of the system.

    Raises
    ------
    SspError
        If a connector does not exist, or a system connector does not match a complete port.
    WiringError
        If shapes or units of the ports do not fit.
    """
    pairs: dict[tuple[int, int], list[tuple[Place, Place]]] = {}
    outer: dict[str, list[Place]] = {}
    for connection in connections:
        ends: list[Place | None] = []
        for side in ("start", "end"):
            element = connection.get(f"{side}Element")
            name = connection.get(f"{side}Connector", "")
            if not element:
                ends.append(None)
                continue
            if name not in places.get(element, {}):
                raise SspError(
                    f"cannot import '{where}': system '{diagram.name}' has a connection to or from "
                    f"connector '{name}' of '{element}', which does not exist"
                )
            ends.append(places[element][name])
        first, second = ends
        if first is not None and second is not None:
            pairs.setdefault((id(first.port), id(second.port)), []).append(
                (first, second)
            )
        elif first is None and second is None:
            raise SspError(
                f"cannot import '{where}': in system '{diagram.name}' a connection leads from one "
                "of its connectors directly to another one, without a block between them"
            )
        elif second is not None:
            outer.setdefault(connection.get("startConnector", ""), []).append(second)
        elif first is not None:
            outer.setdefault(connection.get("endConnector", ""), []).append(first)
    for group in pairs.values():
        _connect(diagram, group)
    return _expose(diagram, outer, system, where)


def _connect(diagram: Diagram, group: list[tuple[Place, Place]]) -> None:
    """Connect elements of one port to elements of another port with a single wire."""
    source = group[0][0].port
    target = group[0][1].port
    order = sorted(range(len(group)), key=lambda k: group[k][1].element)
    taken = np.array([group[k][0].element for k in order])
    given = np.array([group[k][1].element for k in order])
    whole = np.array_equal(given, np.arange(target.size))
    shape = (target.whole_shape or ()) if whole else given.shape
    if not whole and given.size == 1 and source.size == 1:
        shape = source.whole_shape or ()
    diagram.connect(
        _part(source, taken.reshape(shape)),
        target if whole else _part(target, given.reshape(shape)),
    )


def _part(port: Port, elements: NDArray[np.int64]) -> Port:
    """Return the part of a port with the given elements in the given shape."""
    shape = port.whole_shape or ()
    if elements.shape == shape and np.array_equal(
        elements.ravel(), np.arange(port.size)
    ):
        return port
    if elements.ndim == len(shape) == 1 and np.all(np.diff(elements) == 1):
        return port[int(elements[0]) : int(elements[-1]) + 1]
    index = np.unravel_index(elements, shape)
    return port[index if len(index) > 1 else index[0]]


def _expose(
    diagram: Diagram, outer: dict[str, list[Place]], system: Element, where: str
) -> dict[str, Place]:
    """Expose the ports of the system connectors; return the targets of the connectors."""
    listed = [
        (c.get("name", ""), c.get("kind", ""))
        for c in system.findall("ssd:Connectors/ssd:Connector", XML_NAMESPACES)
    ]
    scalars = [
        FmuVariable(name, 0, "Real", kind, "", "", None, "", ())
        for name, kind in listed
        if name in outer
    ]
    groups = gather(scalars)
    legal = legal_names([g.name for g in groups], {*dir(diagram), *diagram.blocks})
    found: dict[str, Place] = {}
    for group in groups:
        ports: dict[int, tuple[Port, list[int]]] = {}
        for variable in group.variables:
            for end in outer[variable.name]:
                ports.setdefault(id(end.port), (end.port, []))[1].append(end.element)
        for port, elements in ports.values():
            if elements != list(range(port.size)) or port.whole_shape != group.shape:
                raise SspError(
                    f"cannot import '{where}': connector '{group.name}' of system "
                    f"'{diagram.name}' is not one whole port of an element ('{port.path}' has "
                    f"shape {port.whole_shape}); connect the elements directly"
                )
        diagram.expose(**{legal[group.name]: tuple(port for port, _ in ports.values())})
        exposed = diagram.port(legal[group.name])
        found |= {v.name: Place(exposed, i) for i, v in enumerate(group.variables)}
    return found
