"""Names of the SSP format, and how ports become its scalar connectors."""

from __future__ import annotations

from itertools import product
from math import prod
from typing import TYPE_CHECKING

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.fmu.errors import ExportError

if TYPE_CHECKING:
    from trussflow.fmu.runtime.description import FmuVariable

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
OWN = "trussflow"

STRUCTURE = "SystemStructure.ssd"
"""Name of the description inside every SSP file."""

FMU_TYPE = "application/x-fmu-sharedlibrary"

IMPLEMENTATIONS = {"cs": "CoSimulation", "me": "ModelExchange"}

TYPES = {"Boolean": "Boolean", "String": "String", "Real": "Real", "Float32": "Real", "Float64": "Real"}
"""SSP's types by FMI's; what is left are integers."""


def qualified(space: str, name: str) -> str:
    """Return a name with its namespace, as ElementTree writes it.

    Parameters
    ----------
    space, name : str
        Namespace and name.
    """
    return f"{{{space}}}{name}"


def type_of(variable: FmuVariable) -> str:
    """Return SSP's name of the type of a variable.

    Parameters
    ----------
    variable : FmuVariable
        The variable.
    """
    return TYPES.get(variable.type, "Integer")


def indexed(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of the elements of an array, row by row: ``u[1,2]``; of a scalar, its own.

    Parameters
    ----------
    name : str
        Name of the array.
    shape : tuple of int
        Its shape.
    """
    if shape == ():
        return [name]
    places = product(*(range(1, n + 1) for n in shape))
    return [f"{name}[{','.join(map(str, place))}]" for place in places]


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
        return indexed(port.name, port.whole_shape or ())
    names = list(port.block.variables[port.name])
    if len(names) != prod(port.whole_shape or ()):
        raise ExportError(
            f"cannot export '{port.path}' to SSP: it is an array variable of FMI 3, and SSP 1.0 "
            "has scalar connectors only; take the FMU as FMI 2.0, which has a variable per element"
        )
    return names
