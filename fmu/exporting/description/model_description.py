"""Text of ``modelDescription.xml``: the part common to both FMI versions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from uuid import UUID
from xml.etree.ElementTree import Element, SubElement

from trussflow.fmu.exporting.description import fmi2_xml, fmi3_xml
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.variables import STRUCTURED_NAME
from trussflow.fmu.exporting.description.xml_text import (
    base_unit,
    filled,
    generation_tool,
    text,
)
from trussflow.fmu.fmi_units import fmi_unit

LOG_CATEGORY = "logStatus"
"""Category of all log messages: reasons for refused calls and failed steps."""

VERSION_MODULES = {"2.0": fmi2_xml, "3.0": fmi3_xml}
"""Modules with the XML specific to each version of FMI."""


@dataclass(frozen=True, slots=True)
class Use:
    """One kind of use that an FMU offers.

    Attributes
    ----------
    element : str
        ``"ModelExchange"`` or ``"CoSimulation"``.
    capabilities : mapping
        Its capability flags, by the names of the FMI version.
    sources : sequence of str
        Source files to compile, for FMI 2.0.
    """

    element: str
    capabilities: Mapping[str, str] = field(default_factory=dict)
    sources: Sequence[str] = ()


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
    interface: ExportInterface, version: str, uses: Sequence[Use]
) -> str:
    """Return the text of ``modelDescription.xml``.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    version : str
        ``"2.0"`` or ``"3.0"``.
    uses : sequence of Use
        Kinds of use, model exchange first.
    """
    scalar = version == "2.0"
    names = [
        name
        for v in interface.variables
        for name in (v.scalars() if scalar else [v.name])
    ]
    structured = all(STRUCTURED_NAME.fullmatch(name) for name in names)
    about = {
        "fmiVersion": version,
        "modelName": interface.name,
        "guid" if scalar else "instantiationToken": token(interface, version),
        "generationTool": generation_tool(),
        "variableNamingConvention": "structured" if structured else "flat",
        "numberOfEventIndicators": str(
            sum(v.size for v in interface.variables.indicators)
        )
        if scalar
        else "",
        "description": interface.meaning,
        **interface.about,
    }
    root = Element("fmiModelDescription", filled(about))
    for use in uses:
        element = SubElement(
            root,
            use.element,
            {"modelIdentifier": interface.identifier, **use.capabilities},
        )
        if use.sources:
            files = SubElement(element, "SourceFiles")
            for name in use.sources:
                SubElement(files, "File", name=name)
    _add_units(root, interface)
    categories = SubElement(root, "LogCategories")
    SubElement(
        categories,
        "Category",
        name=LOG_CATEGORY,
        description="why a call is refused or a step fails",
    )
    experiment = {
        "startTime": "0.0",
        "stopTime": repr(interface.stop_time),
        "tolerance": repr(interface.tolerance),
        "stepSize": repr(interface.step),
    }
    SubElement(root, "DefaultExperiment", experiment)
    VERSION_MODULES[version].add_variables(
        SubElement(root, "ModelVariables"), interface
    )
    VERSION_MODULES[version].add_structure(
        SubElement(root, "ModelStructure"), interface
    )
    return text(root)


def _add_units(root: Element, interface: ExportInterface) -> None:
    """Add the definitions of all units of the variables."""
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted(
        {unit for v in interface.variables for unit in v.units if unit is not None}
    ):
        unit = fmi_unit(name)
        element = SubElement(definitions, "Unit", name=name)
        if unit.exponents is not None:
            SubElement(element, "BaseUnit", base_unit(unit))
        for shown, factor in unit.display:
            SubElement(element, "DisplayUnit", name=shown, factor=repr(factor))
