"""Text of ``modelDescription.xml`` and of ``buildDescription.xml``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import pi
from uuid import UUID
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from trussflow.blocks.results.dataset import own_version
from trussflow.blocks.tracing.sparsity import Pattern
from trussflow.fmu.exporting.description.dependencies import Dependencies
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.variables import (
    STRUCTURED_NAME,
    Variable,
    VariableGroup,
    Variables,
)
from trussflow.fmu.fmi_units import fmi_unit

FMI_VERSIONS = ("2.0", "3.0")
"""Versions of FMI that can be exported."""

LOG_CATEGORY = "logStatus"
"""Category of all log messages: reasons for refused calls and failed steps."""

UNKNOWN_ELEMENTS = {
    "Outputs": "Output",
    "Derivatives": "ContinuousStateDerivative",
    "InitialUnknowns": "InitialUnknown",
}
"""Elements of the model structure: lists of FMI 2.0, and FMI 3.0's element for one variable."""

Rows = list[tuple[Variable, Pattern]]
"""Variables with the dependencies of their elements."""


def token(interface: ExportInterface, version: str) -> str:
    """Return the instantiation token, which FMI 2.0 calls and formats as a GUID.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    version : str
        ``"2.0"`` or ``"3.0"``.
    """
    return f"{{{UUID(interface.token) if version == '2.0' else interface.token}}}"


def model_description(
    interface: ExportInterface,
    version: str,
    uses: Mapping[str, Mapping[str, str]],
    source: str = "",
) -> str:
    """Return the text of ``modelDescription.xml``.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    version : str
        ``"2.0"`` (one variable per scalar) or ``"3.0"`` (one variable per array).
    uses : mapping of str to mapping
        Capability flags, by the names of the FMI version, of ``"ModelExchange"`` and ``"CoSimulation"``.
    source : str
        Source file to compile, for FMI 2.0; empty if there is none.
    """
    scalar = version == "2.0"
    shown = interface.variables.scalarized() if scalar else interface.variables
    structured = all(STRUCTURED_NAME.fullmatch(v.name) for v in shown)
    indicators = sum(v.size for v in shown.indicators)
    about = {
        "fmiVersion": version,
        "modelName": interface.name,
        "guid" if scalar else "instantiationToken": token(interface, version),
        "generationTool": generation_tool(),
        "variableNamingConvention": "structured" if structured else "flat",
        "numberOfEventIndicators": str(indicators) if scalar else "",
        "description": interface.meaning,
        **interface.about,
    }
    root = Element("fmiModelDescription", filled(about))
    for use, capabilities in uses.items():
        flags = {"modelIdentifier": interface.identifier, **capabilities}
        element = SubElement(root, use, flags)
        if source:
            SubElement(SubElement(element, "SourceFiles"), "File", name=source)
    _add_units(root, shown)
    categories = SubElement(root, "LogCategories")
    SubElement(
        categories,
        "Category",
        name=LOG_CATEGORY,
        description="why a call is refused or a step fails",
    )
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(interface.stop_time),
        tolerance=repr(interface.tolerance),
        stepSize=repr(interface.step),
    )
    variables = SubElement(root, "ModelVariables")
    for v in shown:
        if v.size:
            _add_variable(variables, v, scalar)
    _add_structure(
        SubElement(root, "ModelStructure"), shown, interface.dependencies, scalar
    )
    return text(root)


def _add_units(root: Element, shown: Variables) -> None:
    """Add the definitions of all units of the variables."""
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted({unit for v in shown for unit in v.units if unit is not None}):
        unit = fmi_unit(name)
        element = SubElement(definitions, "Unit", name=name)
        if unit.exponents is not None:
            base = {part: str(n) for part, n in unit.exponents.items() if n}
            if unit.factor != 1:
                base["factor"] = repr(unit.factor)
            if unit.offset:
                base["offset"] = repr(unit.offset)
            SubElement(element, "BaseUnit", base)
        if unit.display:
            SubElement(element, "DisplayUnit", name=unit.display, factor=repr(180 / pi))


def _add_variable(parent: Element, v: Variable, scalar: bool) -> None:
    """Add one variable: a real scalar of FMI 2.0, or an array of FMI 3.0."""
    about = {
        "name": v.name,
        "valueReference": str(v.reference),
        "description": v.description(),
        "causality": v.causality,
        "variability": v.variability,
        "initial": v.initial,
    }
    number = {}
    if v.unit is not None:
        number["unit"] = v.unit
        if display := fmi_unit(v.unit).display:
            number["displayUnit"] = display
    if v.start is not None:
        number["start"] = " ".join(repr(float(value)) for value in v.start)
    if v.state is not None:
        # FMI 2.0 needs the index of the state, which equals its reference
        number["derivative"] = str(v.state)
    if scalar:
        element = SubElement(parent, "ScalarVariable", filled(about))
        SubElement(element, "Real", number)
        return
    element = SubElement(parent, "Float64", filled(about) | number)
    for size in v.shape:
        SubElement(element, "Dimension", start=str(size))


def _add_structure(
    parent: Element, shown: Variables, needs: Dependencies, scalar: bool
) -> None:
    """Add the dependencies between variables: a variable has those of all its elements."""
    known = (shown.time, *shown.inputs, *shown.parameters, *shown.states)
    references = np.repeat([v.reference for v in known], [v.size for v in known])
    for (title, name), rows in zip(
        UNKNOWN_ELEMENTS.items(), _unknowns(shown, needs), strict=True
    ):
        found = {}
        for variable, patterns in rows:
            needed = references[np.any(patterns, axis=0)].tolist()
            # Elements of an array share its reference in FMI 3, hence the duplicates.
            found[variable.reference] = " ".join(map(str, dict.fromkeys(needed)))
        if scalar and found:
            listed = SubElement(parent, title)
            for reference, names in sorted(found.items()):
                SubElement(listed, "Unknown", index=str(reference), dependencies=names)
        elif not scalar:
            for reference, names in found.items():
                SubElement(
                    parent, name, valueReference=str(reference), dependencies=names
                )
    if not scalar:
        for variable in shown.indicators:
            SubElement(parent, "EventIndicator", valueReference=str(variable.reference))


def _unknowns(shown: Variables, needs: Dependencies) -> tuple[Rows, Rows, Rows]:
    """Return the unknowns: outputs, derivatives, and initial unknowns.

    Parameters count as dependencies of initial unknowns only.
    """
    elsewhere = np.ones(needs.outputs.shape[1], dtype=bool)
    # Column 0 is the time, whose reference is 1.
    elsewhere[[r - 1 for v in shown.parameters for r in v.references]] = False
    states = _rows(shown.states, needs.initial_states)
    return (
        [*_rows(shown.outputs, needs.outputs & elsewhere)],
        [*_rows(shown.derivatives, needs.derivatives & elsewhere)],
        [
            *_rows(shown.outputs, needs.initial_outputs),
            *((v, rows) for v, rows in states if v.initial == "calculated"),
            *_rows(shown.derivatives, needs.initial_derivatives),
        ],
    )


def _rows(group: VariableGroup, pattern: Pattern) -> Iterator[tuple[Variable, Pattern]]:
    for v in group:
        if v.size:
            begin = v.reference - group[0].reference
            yield v, pattern[begin : begin + v.size]


def build_description(interface: ExportInterface, source: str) -> str:
    """Return the text of ``sources/buildDescription.xml`` of FMI 3.0.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    source : str
        Source file to compile.
    """
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=interface.identifier)
    files = SubElement(build, "SourceFileSet")
    SubElement(files, "SourceFile", name=source)
    return text(root)


def generation_tool() -> str:
    """Return the name and version of this program."""
    return f"trussflow {own_version()}"


def filled(attributes: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes that have a value.

    Parameters
    ----------
    attributes : mapping of str
        Values by name; empty ones are left out.
    """
    return {name: value for name, value in attributes.items() if value}


def text(root: Element) -> str:
    """Return an XML tree as text.

    Parameters
    ----------
    root : Element
        The tree.
    """
    ElementTree.indent(root)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        + ElementTree.tostring(root, "unicode")
        + "\n"
    )
