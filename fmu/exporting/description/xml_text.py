"""What the model descriptions of both FMI versions have in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.variables import STRUCTURED, Variable
from trussflow.fmu.fmi_units import FmiUnit, fmi_unit

CATEGORY = "logStatus"
"""The one category of log messages: why a call was refused or a step failed."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of use that the FMU offers.

    Attributes
    ----------
    element : str
        ``"ModelExchange"`` or ``"CoSimulation"``.
    capabilities : mapping
        Its capability flags, as the version of FMI calls them.
    sources : tuple of str
        Source files to compile.
    """

    element: str
    capabilities: Mapping[str, str] = field(default_factory=dict)
    sources: tuple[str, ...] = ()


def naming_convention(names: Iterable[str]) -> str:
    """Return the naming convention that all names follow.

    Parameters
    ----------
    names : iterable of str
        Names of variables.
    """
    return "structured" if all(STRUCTURED.fullmatch(name) for name in names) else "flat"


def generation_tool() -> str:
    """Return name and version of this program."""
    try:
        return f"trussflow {version('trussflow')}"
    except PackageNotFoundError:
        return "trussflow"


def add_units(root: Element, interface: ExportInterface) -> None:
    """Add the definitions of all units that occur.

    Parameters
    ----------
    root : Element
        The model description.
    interface : Interface
        What it describes.
    """
    names = dict.fromkeys(u for v in interface.variables for u in v.units if u is not None)
    definitions = SubElement(root, "UnitDefinitions")
    for name in sorted(names):
        unit = fmi_unit(name)
        element = SubElement(definitions, "Unit", name=name)
        if unit.exponents is not None:
            SubElement(element, "BaseUnit", base_unit(unit))
        for shown, factor in unit.display:
            SubElement(element, "DisplayUnit", name=shown, factor=repr(factor))


def base_unit(unit: FmiUnit) -> dict[str, str]:
    """Return the attributes that say what a unit is in SI base units.

    Parameters
    ----------
    unit : FmiUnit
        The unit; one of which only the name is known has none.
    """
    found = {part: str(power) for part, power in (unit.exponents or {}).items() if power}
    if unit.factor != 1:
        found["factor"] = repr(unit.factor)
    if unit.offset:
        found["offset"] = repr(unit.offset)
    return found


def unit_attributes(unit: str | None) -> dict[str, str]:
    """Return the attributes of a variable that name its unit and how to show it.

    Parameters
    ----------
    unit : str or None
        The unit.
    """
    if unit is None:
        return {}
    display = fmi_unit(unit).display
    return {"unit": unit} | ({"displayUnit": display[0][0]} if display else {})


def add_experiment(root: Element, interface: ExportInterface) -> None:
    """Add log categories and the default experiment.

    Parameters
    ----------
    root : Element
        The model description.
    interface : Interface
        What it describes.
    """
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name=CATEGORY, description="why a call is refused or a step fails")
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(interface.stop_time),
        tolerance=repr(interface.tolerance),
        stepSize=repr(interface.step),
    )


def variable_attributes(variable: Variable) -> dict[str, str]:
    """Return the attributes that both versions give a variable.

    Parameters
    ----------
    variable : Variable
        The variable.
    """
    found = {"causality": variable.causality, "variability": variable.variability}
    if variable.description():
        found["description"] = variable.description()
    if variable.initial and variable.causality != "input":
        found["initial"] = variable.initial
    return found


def text(root: Element) -> str:
    """Return a model description as text.

    Parameters
    ----------
    root : Element
        The model description.
    """
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"
