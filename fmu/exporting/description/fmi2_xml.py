"""The model description of FMI 2.0: one scalar variable per element."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from trussflow.fmu.exporting.description.dependencies import Pattern
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.variables import Variable
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
    scalars = [name for v in interface.variables for name in v.scalars()]
    attributes = {
        "fmiVersion": "2.0",
        "modelName": interface.name,
        "guid": guid(interface),
        "generationTool": generation_tool(),
        "variableNamingConvention": naming_convention(scalars),
        "numberOfEventIndicators": "0",
    }
    if interface.meaning:
        attributes["description"] = interface.meaning
    root = Element("fmiModelDescription", attributes)
    for kind in kinds:
        own = {"modelIdentifier": interface.identifier} | dict(kind.capabilities)
        element = SubElement(root, kind.element, own)
        if kind.sources:
            files = SubElement(element, "SourceFiles")
            for name in kind.sources:
                SubElement(files, "File", name=name)
    add_units(root, interface)
    add_experiment(root, interface)
    variables = SubElement(root, "ModelVariables")
    for variable in interface.variables:
        _add_variable(variables, variable, interface)
    _add_structure(root, interface)
    return text(root)


def guid(interface: ExportInterface) -> str:
    """Return what FMI 2.0 calls the GUID: it ties a binary to its model description.

    Parameters
    ----------
    interface : Interface
        What is exported.
    """
    token = interface.token
    return f"{{{token[:8]}-{token[8:12]}-{token[12:16]}-{token[16:20]}-{token[20:]}}}"


def _add_variable(parent: Element, variable: Variable, interface: ExportInterface) -> None:
    own = variable_attributes(variable)
    description = variable.meaning
    own.pop("description", None)
    states = {v.name: v for v in interface.states}
    for i, name in enumerate(variable.scalars()):
        about = {"description": description} if description else {}
        reference = {"name": name, "valueReference": str(variable.reference + i)}
        scalar = SubElement(parent, "ScalarVariable", reference | about | own)
        real = unit_attributes(variable.units[i])
        if variable.start is not None:
            real["start"] = repr(float(variable.start[i]))
        if variable.state:
            real["derivative"] = str(_index(states[variable.state].reference + i))
        SubElement(scalar, "Real", real)


def _index(reference: int) -> int:
    """Return the place of a scalar, counted from 1; references count from 0 in the same order."""
    return reference + 1


def _add_structure(root: Element, interface: ExportInterface) -> None:
    structure = SubElement(root, "ModelStructure")
    needs = interface.dependencies
    groups = (
        ("Outputs", interface.outputs, needs.outputs),
        ("Derivatives", interface.derivatives, needs.derivatives),
    )
    parameters = np.zeros(needs.outputs.shape[1], dtype=bool)
    first = 1 + interface.plan.u.size
    parameters[first : first + interface.plan.p.size] = True
    for name, group, pattern in groups:
        if group:
            parent = SubElement(structure, name)
            for reference, row in _rows(group, pattern & ~parameters):
                _add_unknown(parent, reference, row)
    initial = dict(_rows(interface.outputs, needs.initial_outputs))
    initial |= dict(_rows(interface.derivatives, needs.initial_derivatives))
    rows = dict(_rows(interface.states, needs.initial_states))
    calculated = [v for v in interface.states if v.initial == "calculated"]
    initial |= {r: rows[r] for v in calculated for r in v.references}
    if initial:
        parent = SubElement(structure, "InitialUnknowns")
        for reference in sorted(initial):
            _add_unknown(parent, reference, initial[reference])


def _rows(group: tuple[Variable, ...], pattern: Pattern) -> Iterator[tuple[int, Pattern]]:
    """Yield value reference and dependencies of each scalar."""
    references = (r for v in group for r in v.references)
    yield from zip(references, pattern, strict=True)


def _add_unknown(parent: Element, reference: int, row: Pattern) -> None:
    known = " ".join(str(_index(int(i))) for i in np.flatnonzero(row))
    SubElement(parent, "Unknown", index=str(_index(reference)), dependencies=known)
