"""Export of a diagram of FMUs as an SSP file for other tools."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram, leaves
from trussflow.blocks.framework.port import Port
from trussflow.blocks.support.validation import positive
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.model_description import (
    filled,
    generation_tool,
    text,
)
from trussflow.fmu.exporting.description.variables import element_names
from trussflow.fmu.exporting.packing import check_writable, write
from trussflow.fmu.importing.block import Fmu
from trussflow.fmu.runtime.description import FmuVariable
from trussflow.fmu.ssp.names import (
    FMU_TYPE,
    IMPLEMENTATION_NAMES,
    OPTIONS_FILE,
    STRUCTURE_FILE,
    XML_NAMESPACES,
    add,
    qualified,
    type_of,
)


def export_ssp(
    diagram: Diagram,
    path: str | Path,
    *,
    step: float | None = None,
    stop_time: float = 10.0,
) -> Path:
    """Write a diagram whose blocks are all FMUs, or diagrams of FMUs, as an SSP 1.0 file.

    The file contains the FMUs, their given values, and one connection for each element of a port.
    Other options of `Fmu` are stored in a file that other tools ignore. Characters in the name of
    the diagram that are illegal in other tools become underscores.

    Parameters
    ----------
    diagram : Diagram
        The diagram. Its exposed inputs become inputs of the system.
    path : str or pathlib.Path
        File to write; if the export fails, it is not changed.
    step : float, optional
        Communication step size for other tools [s]; by default the smallest step of the FMUs.
    stop_time : float
        Stop time of the default experiment [s].

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ExportError
        If a block is not an FMU, SSP cannot express a property of an FMU, or the file cannot be
        written.

    Examples
    --------
    ::

        export_ssp(loop, "loop.ssp", step=1e-3)
        again = import_ssp("loop.ssp")
    """
    given: object = diagram
    if not isinstance(given, Diagram):
        raise ExportError(
            f"cannot export {given!r} to SSP: it is not a diagram; add it to a diagram"
        )
    blocks = leaves(diagram)
    if step is None:
        steps = [b.sample_time for b in blocks if b.sample_time is not None]
        step = min(steps, default=1e-3)
    positive(ExportError, step=step, stop_time=stop_time)
    strangers = [
        f"'{b.path}' ({type(b).__name__})" for b in blocks if not isinstance(b, Fmu)
    ]
    if strangers or not blocks:
        what = ", ".join(strangers) or "it has no block"
        raise ExportError(
            f"cannot export '{diagram.name}' to SSP, which supports FMUs only: {what}. Export each block, "
            "or an inner diagram, with trussflow.fmu.export, and replace it by Fmu(path)"
        )
    files = _resources(blocks)
    structure = _structure(diagram, files, step, stop_time)
    target = check_writable(path)
    notes = {
        "name": diagram.name,
        "fmus": {block.path: _options(block) for block in blocks},
    }
    content = json.dumps(notes, indent=1).encode()
    write(
        target,
        {
            STRUCTURE_FILE: structure.encode(),
            OPTIONS_FILE: content,
            **{name: file for file, name in files.items()},
        },
    )
    return target


def _resources(blocks: list[Block]) -> dict[Path, str]:
    """Return the path inside the archive of each FMU file."""
    files = [*dict.fromkeys(block.file.path for block in blocks)]
    names = [file.name for file in files]
    return {
        # FMUs of equal name from different folders get numbered folders.
        file: f"resources/{name}" if names.count(name) == 1 else f"resources/{i}/{name}"
        for i, (file, name) in enumerate(zip(files, names, strict=True))
    }


def _structure(
    diagram: Diagram, files: dict[Path, str], step: float, stop_time: float
) -> str:
    """Return the XML of the system description."""
    for prefix, space in XML_NAMESPACES.items():
        ElementTree.register_namespace(prefix, space)
    name = re.sub("[^A-Za-z0-9_-]+", "_", diagram.name)
    name = name if name[:1].isalpha() else f"system_{name}"
    root = Element(
        qualified("ssd:SystemStructureDescription"),
        {"name": name, "version": "1.0", "generationTool": generation_tool()},
    )
    system = _system(root, name, diagram, files)
    # OMSimulator requires its annotation of the communication step size
    add(
        add(system, "ssd:Annotations/ssc:Annotation", type="org.openmodelica"),
        "oms:Annotations/oms:SimulationInformation/oms:FixedStepMaster",
        description="oms-ma",
        stepSize=repr(float(step)),
        absoluteTolerance="0.0001",
        relativeTolerance="0.0001",
    )
    add(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(float(stop_time)))
    return text(root)


def _system(
    parent: Element, name: str, diagram: Diagram, files: dict[Path, str]
) -> Element:
    """Add the system of a diagram."""
    system = add(parent, "ssd:System", name=name)
    _add_connectors(system, diagram)
    elements = add(system, "ssd:Elements")
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            _system(elements, block.name, block, files)
        elif isinstance(block, Fmu):
            _component(elements, block, files, _grounded(diagram, block))
    pairs = [
        pair
        for wire in diagram.wires
        if wire.source is not None
        for pair in zip(_ends(wire.source), _ends(wire.target), strict=True)
    ]
    for name in diagram.exposed:
        outer = [("", connector) for connector, _ in _scalars(diagram.ports[name])]
        for inner in diagram.exposed[name]:
            # Connections follow the signal: into the system, or out of it.
            both = (outer, _ends(inner)) if inner.is_input else (_ends(inner), outer)
            pairs += zip(*both, strict=True)
    if pairs:
        connections = add(system, "ssd:Connections")
    for (from_element, from_name), (to_element, to_name) in pairs:
        ends = {
            "startElement": from_element,
            "startConnector": from_name,
            "endElement": to_element,
            "endConnector": to_name,
        }
        add(connections, "ssd:Connection", **filled(ends))
    return system


def _ends(port: Port) -> list[tuple[str, str]]:
    """Return the component and connector of each element of a port."""
    scalars = _scalars(port.block.port(port.name))
    return [(port.block.name, scalars[i][0]) for i in port.elements().ravel()]


def _add_connectors(element: Element, block: Block) -> None:
    """Add the connectors of a block, one for each element of a port; the FMUs state their units."""
    if not block.ports:
        return
    listed = add(element, "ssd:Connectors")
    for port in [*block.inputs(), *block.outputs()]:
        kind = "input" if port.is_input else "output"
        for name, variable in _scalars(port):
            connector = add(listed, "ssd:Connector", name=name, kind=kind)
            add(connector, f"ssc:{type_of(variable)}")


def _scalars(port: Port) -> list[tuple[str, FmuVariable]]:
    """Return the connector and the FMU's variable of each element of a port.

    Raises
    ------
    ExportError
        If the port is an array variable of FMI 3.
    """
    block = port.block
    shape = port.whole_shape or ()
    if isinstance(block, Diagram):
        # A diagram has no variables: the type is that of the first exposed port.
        variables = [v for _, v in _scalars(block.exposed[port.name][0])]
        return list(zip(element_names(port.name, shape), variables, strict=True))
    names = block.variables[port.name]
    if len(names) != port.size:
        raise ExportError(
            f"cannot export '{port.path}' to SSP: it is an array variable of FMI 3, and SSP 1.0 "
            "has scalar connectors only; use an FMU of FMI 2.0, which has a variable per element"
        )
    return [(name, block.description.variables[name]) for name in names]


def _component(
    elements: Element, block: Fmu, files: dict[Path, str], grounded: dict[str, float]
) -> None:
    """Add the component of one FMU."""
    component = add(
        elements,
        "ssd:Component",
        name=block.name,
        type=FMU_TYPE,
        source=files[block.file.path],
        implementation=IMPLEMENTATION_NAMES[block.kind],
    )
    _add_connectors(component, block)
    interface = block.interface
    given: dict[str, Any] = interface.starts | grounded
    variables = [
        v for name, v in interface.description.variables.items() if name in given
    ]
    if variables:
        inline = add(
            component, "ssd:ParameterBindings/ssd:ParameterBinding/ssd:ParameterValues"
        )
        parameters = add(
            add(inline, "ssv:ParameterSet", version="1.0", name=block.name),
            "ssv:Parameters",
        )
    for variable in variables:
        value = given[variable.name]
        if np.size(value) != 1 or variable.shape:
            raise ExportError(
                f"cannot export '{block.path}' to SSP: its variable '{variable.name}' is an array, and "
                "SSP 1.0 has scalar values only"
            )
        parameter = add(parameters, "ssv:Parameter", name=variable.name)
        kind = type_of(variable)
        add(parameter, f"ssv:{kind}", value=_value(kind, value))


def _value(kind: str, value: Any) -> str:
    """Return the XML text of a value."""
    if kind == "String":
        return str(value[0] if isinstance(value, list) else value)
    number = float(np.ravel(value)[0])
    if kind == "Boolean":
        return "true" if number else "false"
    return repr(number) if kind == "Real" else str(int(number))


def _grounded(diagram: Diagram, block: Block) -> dict[str, float]:
    """Return the grounded inputs of an FMU with their value, zero."""
    return {
        name: 0.0
        for wire in diagram.wires
        if wire.source is None and wire.target.block is block
        for _, name in _ends(wire.target)
    }


def _options(block: Block) -> dict[str, Any]:
    """Return the options of an `Fmu` that SSP cannot express."""
    options = {
        "step": block.sample_time,
        "tolerance": block.tolerance,
        "delayed": block.delayed,
        "units": block.units,
        **block.options,
    }
    return {name: value for name, value in options.items() if value}
