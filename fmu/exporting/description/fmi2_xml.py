"""XML specific to FMI 2.0: one scalar variable per element."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

import numpy as np

from trussflow.fmu.exporting.description.dependencies import Pattern
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.xml_text import (
    unit_attributes,
    unknowns,
    variable_attributes,
)


def add_variables(parent: Element, interface: ExportInterface) -> None:
    """Add all variables.

    Parameters
    ----------
    parent : Element
        The element ``ModelVariables``.
    interface : ExportInterface
        The exported interface.
    """
    for v in interface.variables:
        for i, name in enumerate(v.scalars()):
            about = variable_attributes(v, name, v.reference + i, v.meaning)
            number = unit_attributes(v.units[i])
            if v.start is not None:
                number["start"] = repr(float(v.start[i]))
            if v.state is not None:
                # the index of the state, equal to its reference
                number["derivative"] = str(v.state + i)
            SubElement(SubElement(parent, "ScalarVariable", about), "Real", number)


def add_structure(parent: Element, interface: ExportInterface) -> None:
    """Add the dependencies between scalars.

    Parameters
    ----------
    parent : Element
        The element ``ModelStructure``.
    interface : ExportInterface
        The exported interface.
    """
    for name, rows in zip(
        ("Outputs", "Derivatives", "InitialUnknowns"), unknowns(interface), strict=True
    ):
        scalars: dict[int, Pattern] = {}
        for variable, patterns in rows:
            scalars |= zip(variable.references, patterns, strict=True)
        if scalars:
            listed = SubElement(parent, name)
        for reference in sorted(scalars):
            known = " ".join(str(i + 1) for i in np.flatnonzero(scalars[reference]))
            SubElement(listed, "Unknown", index=str(reference), dependencies=known)
