"""Names of the SSP format, and the scalar connectors of ports."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

from trussflow.fmu.runtime.description import REAL_TYPES, FmuVariable

XML_NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
"""XML namespaces by their prefixes, in these modules and in the files."""

STRUCTURE_FILE = "SystemStructure.ssd"
"""Name of the system description in an SSP file."""

OPTIONS_FILE = "extra/trussflow.json"
"""File of the options that SSP cannot express, by path of the FMU. The standard provides annotations for
such data, but OMSimulator rejects foreign annotations and reads foreign XML files as its own."""

FMU_TYPE = "application/x-fmu-sharedlibrary"

IMPLEMENTATION_NAMES = {"cs": "CoSimulation", "me": "ModelExchange"}


def qualified(name: str) -> str:
    """Return ``prefix:name`` in the form of ElementTree.

    Parameters
    ----------
    name : str
        The name, with a prefix of `XML_NAMESPACES`.
    """
    prefix, _, plain = name.partition(":")
    return f"{{{XML_NAMESPACES[prefix]}}}{plain}"


def add(parent: Element, path: str, **attributes: str) -> Element:
    """Add a path of nested elements and return the innermost one, which gets the attributes.

    Parameters
    ----------
    parent : Element
        Element to which the outermost one is added.
    path : str
        Names with prefixes of `XML_NAMESPACES`, separated by slashes.
    **attributes : str
        Attributes by name.
    """
    for name in path.split("/"):
        parent = SubElement(parent, qualified(name))
    parent.attrib.update(attributes)
    return parent


def type_of(variable: FmuVariable) -> str:
    """Return the SSP type of a variable; all types other than these four are integers in SSP.

    Parameters
    ----------
    variable : FmuVariable
        The variable.
    """
    if variable.type in ("Boolean", "String"):
        return variable.type
    return "Real" if variable.type in REAL_TYPES else "Integer"
