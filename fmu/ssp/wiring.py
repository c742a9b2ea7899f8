"""Conversion of SSP's scalar connections to wires, and of system connectors to exposed ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.fmu.errors import SspError
from trussflow.fmu.runtime.array_ports import gather, legal_names
from trussflow.fmu.runtime.description import FmuVariable
from trussflow.fmu.ssp.names import XML_NAMESPACES

Place = tuple[Port, int]
"""Target of a scalar connector: a port and the index of its element."""

End = tuple[str, str]
"""Element and connector; the element is empty for a connector of the system."""

Connection = tuple[End, End]
"""Start and end."""


def wire(
    diagram: Diagram,
    places: Mapping[End, Place],
    connections: Sequence[Connection],
    system: Element,
    where: str,
) -> dict[str, Place]:
    """Connect the blocks of a diagram and expose its ports.

    Parameters
    ----------
    diagram : Diagram
        The diagram, with its blocks.
    places : mapping
        Targets of the connectors of the elements.
    connections : sequence of Connection
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
    for ends in connections:
        for element, name in ends:
            if element and (element, name) not in places:
                raise SspError(
                    f"cannot import '{where}': system '{diagram.name}' has a connection to or from "
                    f"connector '{name}' of '{element}', which does not exist"
                )
        inner = [places[end] for end in ends if end[0]]
        if not inner:
            raise SspError(
                f"cannot import '{where}': in system '{diagram.name}' a connection leads from one "
                "of its connectors directly to another one, without a block between them"
            )
        if len(inner) == 1:
            # The empty element sorts first, so the minimum is the system's end.
            outer.setdefault(min(ends)[1], []).append(inner[0])
        else:
            first, second = inner
            key = id(first[0]), id(second[0])
            pairs.setdefault(key, []).append((first, second))
    for group in pairs.values():
        _connect(diagram, group)
    return _expose(diagram, outer, system, where)


def _connect(diagram: Diagram, group: list[tuple[Place, Place]]) -> None:
    """Connect elements of one port to elements of another port with a single wire."""
    source, target = (port for port, _ in group[0])
    # In the target's order, so that a whole port is recognized as such.
    elements = sorted(((a[1], b[1]) for a, b in group), key=itemgetter(1))
    taken, given = np.array(elements).T
    shape = given.shape if given.size > 1 else ()
    if np.array_equal(given, np.arange(target.size)):
        shape = target.whole_shape or ()
    diagram.connect(
        _part(source, taken.reshape(shape)), _part(target, given.reshape(shape))
    )


def _part(port: Port, elements: NDArray[np.int64]) -> Port:
    """Return the part of a port with the given elements in the given shape."""
    shape = port.whole_shape or ()
    if np.array_equal(elements, np.arange(port.size).reshape(shape)):
        return port
    return port[np.unravel_index(elements, shape)]


def _expose(
    diagram: Diagram, outer: Mapping[str, list[Place]], system: Element, where: str
) -> dict[str, Place]:
    """Expose the ports of the system connectors; return the targets of the connectors."""
    connectors = system.findall("ssd:Connectors/ssd:Connector", XML_NAMESPACES)
    # `gather` needs variables; only names and causalities matter here.
    scalars = [
        FmuVariable(name, 0, "Real", c.get("kind", ""), "", "", None, "", ())
        for c in connectors
        if (name := c.get("name", "")) in outer
    ]
    groups = gather(scalars)
    legal = legal_names([g.name for g in groups], {*dir(diagram), *diagram.blocks})
    found: dict[str, Place] = {}
    for group in groups:
        ports: dict[int, tuple[Port, list[int]]] = {}
        # One connector may feed several ports; each port is checked separately.
        for variable in group.variables:
            for port, element in outer[variable.name]:
                ports.setdefault(id(port), (port, []))[1].append(element)
        for port, elements in ports.values():
            if elements != list(range(port.size)) or port.whole_shape != group.shape:
                raise SspError(
                    f"cannot import '{where}': connector '{group.name}' of system "
                    f"'{diagram.name}' is not one whole port of an element ('{port.path}' has "
                    f"shape {port.whole_shape}); connect the elements directly"
                )
        diagram.expose(**{legal[group.name]: tuple(port for port, _ in ports.values())})
        exposed = diagram.port(legal[group.name])
        found |= {v.name: (exposed, i) for i, v in enumerate(group.variables)}
    return found
