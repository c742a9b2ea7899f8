"""Names of the SSP format, and how ports become its scalar connectors."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.variables import element_names

if TYPE_CHECKING:
    from trussflow.fmu.runtime.description import FmuVariable

SPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
"""Namespaces by the prefixes that stand for them in these modules and in the files."""

STRUCTURE = "SystemStructure.ssd"
"""Name of the description inside every SSP file."""

NOTES = "extra/trussflow.json"
"""What SSP has no place for, by path of the FMU. Annotations are the place that the standard means, but
OMSimulator refuses a file with any that are not its own; files of XML it takes for its own as well."""

OPTIONS: dict[str, type | tuple[type, ...]] = {
    "step": (int, float),
    "tolerance": (int, float),
    "time_limit": (int, float),
    "memory_limit": (int, float),
    "delayed": bool,
    "logging": bool,
    "units": dict,
}
"""What is noted of an FMU, and of which type it is."""

FMU_TYPE = "application/x-fmu-sharedlibrary"

IMPLEMENTATIONS = {"cs": "CoSimulation", "me": "ModelExchange"}

TYPES = {"Boolean": "Boolean", "String": "String", "Real": "Real", "Float32": "Real", "Float64": "Real"}
"""SSP's types by FMI's; what is left are integers."""


def qualified(name: str) -> str:
    """Return ``prefix:name`` as ElementTree stores it.

    Parameters
    ----------
    name : str
        The name, with a prefix of `SPACES`.
    """
    prefix, _, plain = name.partition(":")
    return f"{{{SPACES[prefix]}}}{plain}"


def add(parent: Element, path: str, attributes: Mapping[str, str] | None = None, **more: str) -> Element:
    """Add elements, each within the one before, and return the last, which gets the attributes.

    Parameters
    ----------
    parent : Element
        Diagram that receives them.
    path : str
        Their names, with prefixes of `SPACES` and slashes between.
    attributes : mapping of str, optional
        Attributes by name.
    **more : str
        Attributes by name.
    """
    for name in path.split("/"):
        parent = SubElement(parent, qualified(name))
    parent.attrib.update({**(attributes or {}), **more})
    return parent


def type_of(variable: FmuVariable) -> str:
    """Return SSP's name of the type of a variable.

    Parameters
    ----------
    variable : FmuVariable
        The variable.
    """
    return TYPES.get(variable.type, "Integer")


def connectors(port: Port) -> list[str]:
    """Return the scalar connectors that stand for the elements of a whole port.

    Parameters
    ----------
    port : Port
        Of a block made by `Fmu`, or of a diagram.

    Raises
    ------
    ExportError
        If it stands for an array variable of FMI 3.
    """
    if isinstance(port.block, Diagram):
        return element_names(port.name, port.whole_shape or ())
    names = list(port.block.variables[port.name])
    if len(names) != prod(port.whole_shape or ()):
        raise ExportError(
            f"cannot export '{port.path}' to SSP: it is an array variable of FMI 3, and SSP 1.0 "
            "has scalar connectors only; take the FMU as FMI 2.0, which has a variable per element"
        )
    return names
