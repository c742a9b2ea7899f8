"""XML common to both FMI versions and SSP."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from trussflow.blocks.results.dataset import provenance
from trussflow.fmu.exporting.description.dependencies import Pattern
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.variables import Variable, VariableGroup
from trussflow.fmu.fmi_units import FmiUnit, fmi_unit

Rows = list[tuple[Variable, Pattern]]
"""Variables with the dependencies of each element."""


def generation_tool() -> str:
    """Return the name and version of this program."""
    return f"trussflow {provenance()['trussflow_version']}"


def base_unit(unit: FmiUnit) -> dict[str, str]:
    """Return the attributes that define a unit in SI base units.

    Parameters
    ----------
    unit : FmiUnit
        The unit; without exponents it has no attributes.
    """
    found = {
        part: str(power) for part, power in (unit.exponents or {}).items() if power
    }
    if unit.factor != 1:
        found["factor"] = repr(unit.factor)
    if unit.offset:
        found["offset"] = repr(unit.offset)
    return found


def variable_attributes(
    v: Variable, name: str, reference: int, meaning: str
) -> dict[str, str]:
    """Return the attributes of a variable or element that are equal in both versions.

    Parameters
    ----------
    v : Variable
        The variable.
    name : str
        Name of the variable or element.
    reference : int
        The value reference [-].
    meaning : str
        Description, one line.
    """
    about = {
        "name": name,
        "valueReference": str(reference),
        "description": meaning,
        "causality": v.causality,
        "variability": v.variability,
        "initial": v.initial,
    }
    return filled(about)


def unit_attributes(unit: str | None) -> dict[str, str]:
    """Return the attributes for the unit and display unit of a variable.

    Parameters
    ----------
    unit : str or None
        The unit.
    """
    if unit is None:
        return {}
    display = fmi_unit(unit).display
    return {"unit": unit} | ({"displayUnit": display[0][0]} if display else {})


def filled(attributes: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes that have a value.

    Parameters
    ----------
    attributes : mapping of str
        Values by name; empty ones are left out.
    """
    return {name: value for name, value in attributes.items() if value}


def unknowns(interface: ExportInterface) -> tuple[Rows, Rows, Rows]:
    """Return the unknowns: outputs, derivatives, and initial unknowns.

    Parameters count as dependencies of initial unknowns only.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    """
    shown = interface.variables
    needs = interface.dependencies
    elsewhere = np.ones(needs.outputs.shape[1], dtype=bool)
    elsewhere[[r - 1 for v in shown.parameters for r in v.references]] = False
    states = [
        (v, rows)
        for v, rows in _rows(shown.states, needs.initial_states)
        if v.initial == "calculated"
    ]
    return (
        [*_rows(shown.outputs, needs.outputs & elsewhere)],
        [*_rows(shown.derivatives, needs.derivatives & elsewhere)],
        [
            *_rows(shown.outputs, needs.initial_outputs),
            *states,
            *_rows(shown.derivatives, needs.initial_derivatives),
        ],
    )


def _rows(group: VariableGroup, pattern: Pattern) -> Iterator[tuple[Variable, Pattern]]:
    for v in group:
        if v.size:
            begin = v.reference - group[0].reference
            yield v, pattern[begin : begin + v.size]


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
