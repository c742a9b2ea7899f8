"""The model description of FMI 3.0: one array variable per port, parameter and state."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from trussflow.fmu.exporting.description.dependencies import Pattern
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.groups import Group
from trussflow.fmu.exporting.description.variables import Variable, starts
from trussflow.fmu.exporting.description.xml_text import (
    Kind,
    add_experiment,
    add_units,
    generation_tool,
    naming_convention,
    text,
    unit_attributes,
    variable_attributes,
)


def model_description(interface: ExportInterface, kinds: tuple[Kind, ...]) -> str:
    """Return the text of ``modelDescription.xml``.

    Parameters
    ----------
    interface : Interface
        What to describe.
    kinds : tuple of Kind
        The kinds of use that the FMU offers, model exchange first.
    """
    attributes = {
        "fmiVersion": "3.0",
        "modelName": interface.name,
        "instantiationToken": instantiation_token(interface),
        "generationTool": generation_tool(),
        "variableNamingConvention": naming_convention(v.name for v in interface.variables),
    }
    if interface.meaning:
        attributes["description"] = interface.meaning
    root = Element("fmiModelDescription", attributes)
    for kind in kinds:
        own = {"modelIdentifier": interface.identifier} | dict(kind.capabilities)
        SubElement(root, kind.element, own)
    add_units(root, interface)
    add_experiment(root, interface)
    variables = SubElement(root, "ModelVariables")
    for variable in interface.variables:
        if variable.size:
            _add_variable(variables, variable, interface)
    _add_structure(root, interface)
    return text(root)


def instantiation_token(interface: ExportInterface) -> str:
    """Return what ties a binary to its model description in FMI 3.0.

    Parameters
    ----------
    interface : Interface
        What is exported.
    """
    return f"{{{interface.token}}}"


def build_description(interface: ExportInterface, sources: tuple[str, ...]) -> str:
    """Return the text of ``sources/buildDescription.xml``.

    Parameters
    ----------
    interface : Interface
        What was exported.
    sources : tuple of str
        Source files to compile.
    """
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=interface.identifier)
    files = SubElement(build, "SourceFileSet")
    for name in sources:
        SubElement(files, "SourceFile", name=name)
    return text(root)


def _add_variable(parent: Element, variable: Variable, interface: ExportInterface) -> None:
    attributes = {"name": variable.name, "valueReference": str(variable.reference)}
    attributes |= variable_attributes(variable) | unit_attributes(variable.unit)
    if variable.start is not None:
        attributes["start"] = starts(variable.start)
    if variable.state:
        states: Mapping[str, Variable] = {v.name: v for v in interface.states}
        attributes["derivative"] = str(states[variable.state].reference)
    element = SubElement(parent, "Float64", attributes)
    for size in variable.shape:
        SubElement(element, "Dimension", start=str(size))


def _add_structure(root: Element, interface: ExportInterface) -> None:
    structure = SubElement(root, "ModelStructure")
    needs = interface.dependencies
    calculated = tuple(v for v in interface.states if v.initial == "calculated")
    fixed = {v.reference for v in interface.parameters}
    groups: tuple[tuple[str, Group, Group, Pattern, set[int]], ...] = (
        ("Output", interface.outputs, interface.outputs, needs.outputs, fixed),
        ("ContinuousStateDerivative", interface.derivatives, interface.derivatives, needs.derivatives, fixed),
        ("InitialUnknown", interface.outputs, interface.outputs, needs.initial_outputs, set()),
        ("InitialUnknown", calculated, interface.states, needs.initial_states, set()),
        ("InitialUnknown", interface.derivatives, interface.derivatives, needs.initial_derivatives, set()),
    )
    for name, group, whole, pattern, without in groups:
        for variable in group:
            if variable.size:
                begin = variable.reference - whole[0].reference
                rows = np.any(pattern[begin : begin + variable.size], axis=0)
                _add_unknown(structure, name, variable, _known(interface, rows, without))


def _known(interface: ExportInterface, row: Pattern, without: set[int]) -> list[int]:
    """Return the value references of the variables that any marked scalar belongs to."""
    known = (interface.time, *interface.inputs, *interface.parameters, *interface.states)
    return [
        v.reference
        for v in known
        if v.reference not in without and bool(np.any(row[v.reference : v.reference + v.size]))
    ]


def _add_unknown(parent: Element, name: str, variable: Variable, known: list[int]) -> None:
    dependencies = " ".join(map(str, known))
    SubElement(parent, name, valueReference=str(variable.reference), dependencies=dependencies)
