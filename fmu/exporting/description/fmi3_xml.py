"""XML specific to FMI 3.0: one array variable per port, parameter and state."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.xml_text import (
    text,
    unit_attributes,
    unknowns,
    variable_attributes,
)


def add_variables(parent: Element, interface: ExportInterface) -> None:
    """Add all variables that have elements.

    Parameters
    ----------
    parent : Element
        The element ``ModelVariables``.
    interface : ExportInterface
        The exported interface.
    """
    for v in interface.variables:
        if not v.size:
            continue
        about = variable_attributes(
            v, v.name, v.reference, v.description()
        ) | unit_attributes(v.unit)
        if v.start is not None:
            about["start"] = " ".join(repr(float(value)) for value in v.start)
        if v.state is not None:
            about["derivative"] = str(v.state)
        element = SubElement(parent, "Float64", about)
        for size in v.shape:
            SubElement(element, "Dimension", start=str(size))


def add_structure(parent: Element, interface: ExportInterface) -> None:
    """Add the dependencies between variables: a variable has those of all its elements.

    Parameters
    ----------
    parent : Element
        The element ``ModelStructure``.
    interface : ExportInterface
        The exported interface.
    """
    shown = interface.variables
    known = (shown.time, *shown.inputs, *shown.parameters, *shown.states)
    kinds = ("Output", "ContinuousStateDerivative", "InitialUnknown")
    for name, rows in zip(kinds, unknowns(interface), strict=True):
        for variable, patterns in rows:
            needed = np.any(patterns, axis=0)
            dependencies = " ".join(
                str(v.reference)
                for v in known
                if needed[v.reference - 1 : v.reference - 1 + v.size].any()
            )
            SubElement(
                parent,
                name,
                valueReference=str(variable.reference),
                dependencies=dependencies,
            )
    for variable in shown.indicators:
        SubElement(parent, "EventIndicator", valueReference=str(variable.reference))


def build_description(interface: ExportInterface, sources: Sequence[str]) -> str:
    """Return the text of ``sources/buildDescription.xml``.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    sources : sequence of str
        Source files to compile.
    """
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=interface.identifier)
    files = SubElement(build, "SourceFileSet")
    for name in sources:
        SubElement(files, "SourceFile", name=name)
    return text(root)
