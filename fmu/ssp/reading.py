"""Import of an SSP file as a diagram of FMUs."""

from __future__ import annotations

import json
import os
import weakref
from collections.abc import Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from trussflow.blocks.errors import Explained
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.support.validation import as_path, one_of
from trussflow.fmu.errors import FmuArchiveError, SspError
from trussflow.fmu.importing.block import Fmu
from trussflow.fmu.runtime.archive import remove, unpack
from trussflow.fmu.runtime.array_ports import legal_names
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.safe_xml import check_xml
from trussflow.fmu.ssp.names import (
    FMU_TYPE,
    IMPLEMENTATION_NAMES,
    OPTIONS_FILE,
    STRUCTURE_FILE,
    XML_NAMESPACES,
    qualified,
)
from trussflow.fmu.ssp.wiring import Connection, Place, wire

Values = dict[str, Any]
"""Values by the FMU's variable names."""


def import_ssp(
    path: str | Path, *, step: float | None = None, open_inputs: str = "expose"
) -> Diagram:
    """Return the diagram of an SSP 1.0 file, with its FMUs as blocks.

    Nested systems become nested diagrams, and system connectors become exposed ports. Unconnected
    inputs keep their start values. The FMUs are unpacked into a temporary folder, which is deleted
    with the diagram. FMUs are native code that runs with the rights of the user: use trusted files
    only.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    step : float, optional
        Communication step size of all FMUs for co-simulation [s]; by default that of the file, or
        the suggestion of each FMU.
    open_inputs : str
        Treatment of the inputs of the system: ``"expose"`` makes them inputs of the diagram, ``"start"``
        leaves them at the start values that the FMUs declare.

    Returns
    -------
    Diagram
        The diagram, for example for `cosimulate`.

    Raises
    ------
    FmuArchiveError
        If the file is not a zip archive, or unpacking it would be unsafe.
    SspError
        If the file is invalid or uses features that diagrams do not support: conversions in
        connections, signal dictionaries, systems in other files.
    FmuError
        If an FMU in the file is refused.
    """
    one_of("open_inputs", open_inputs, ("expose", "start"), SspError)
    path = as_path(FmuArchiveError, "cannot open the SSP file", path)
    folder = unpack(path)
    try:
        with Explained(
            lambda e: SspError(f"cannot read '{path.name}': {type(e).__name__}: {e}")
        ):
            diagram = _Reader(path.name, folder, step, open_inputs).read()
    except BaseException:
        remove(folder)
        raise
    weakref.finalize(diagram, remove, folder)
    return diagram


def _disconnect_open_inputs(system: Element, driven: Set[str | None]) -> None:
    """Remove the connections from the inputs of a system that are not in `driven`."""
    for parent in system.findall("ssd:Connections", XML_NAMESPACES):
        for one in list(parent):
            # Without an element, the connector is one of the system itself.
            if not one.get("startElement") and one.get("startConnector") not in driven:
                parent.remove(one)
    connections = system.findall("ssd:Connections/ssd:Connection", XML_NAMESPACES)
    for inner in system.findall("ssd:Elements/ssd:System", XML_NAMESPACES):
        name = inner.get("name")
        ends = {
            one.get("endConnector")
            for one in connections
            if one.get("endElement") == name
        }
        _disconnect_open_inputs(inner, ends)


@dataclass
class _Reader:
    """Reader of one SSP file; `where` is its name in error messages."""

    where: str
    folder: Path
    step: float | None
    open_inputs: str

    def read(self) -> Diagram:
        root = self._xml(STRUCTURE_FILE)
        system = root.find("ssd:System", XML_NAMESPACES)
        if root.tag != qualified("ssd:SystemStructureDescription") or system is None:
            raise SspError(
                f"cannot read '{self.where}': it is not a system structure of SSP 1"
            )
        if self.open_inputs == "start":
            _disconnect_open_inputs(system, set())
        self.master_step = None
        for master in system.findall(
            ".//oms:FixedStepMaster[@stepSize]", XML_NAMESPACES
        ):
            self.master_step = self._number(master.get("stepSize", ""), "stepSize")
        name = system.get("name", "")
        options: Values = {}
        if (self.folder / OPTIONS_FILE).is_file():
            notes = json.loads(self._inside(OPTIONS_FILE).read_bytes())
            name, options = notes["name"], notes["fmus"]
        return self._system(system, name, {}, options)[0]

    def _xml(self, name: str) -> Element:
        """Return the XML tree of a file in the archive, checked before it is parsed."""
        text = self._inside(name).read_bytes()
        check_xml(text, f"'{name}' of '{self.where}'")
        return ElementTree.fromstring(text)

    def _inside(self, name: str) -> Path:
        """Return the path of an unpacked file.

        Raises
        ------
        SspError
            If the file does not exist, or its name leads outside the archive.
        """
        # `abspath` removes ``..``; `unpack` has refused archives with links.
        file = Path(os.path.abspath(self.folder / name))
        if not file.is_relative_to(self.folder) or not os.path.isfile(file):
            raise SspError(
                f"cannot read '{self.where}': it contains no file '{name}'; only SSP files that "
                "contain all their resources can be imported"
            )
        return file

    def _number(self, text: str, what: str) -> float:
        try:
            return float(text)
        except ValueError:
            raise SspError(
                f"cannot read '{self.where}': {what} '{text}' is not a number"
            ) from None

    # -- elements -----------------------------------------------------------------------------

    def _system(
        self, system: Element, title: str, outer: Values, options: Values
    ) -> tuple[Diagram, dict[str, Place]]:
        """Return the diagram of a system and the targets of its connectors."""
        diagram = Diagram(title)
        values = outer | self._values(system)
        elements = system.findall("ssd:Elements/*", XML_NAMESPACES)
        known = {qualified("ssd:Component"), qualified("ssd:System")}
        dictionaries = system.find("ssd:SignalDictionaries", XML_NAMESPACES)
        if {e.tag for e in elements} - known or dictionaries is not None:
            raise SspError(
                f"cannot import '{title}' of '{self.where}': it has a signal dictionary, which "
                "diagrams do not support"
            )
        connections = self._connections(system, values)
        names = [e.get("name", "") for e in elements]
        if len(set(names)) < len(names):
            raise SspError(
                f"cannot import '{title}' of '{self.where}': two elements have the same name"
            )
        legal = legal_names(names, dir(diagram))
        places: dict[tuple[str, str], Place] = {}
        for element, name in zip(elements, names, strict=True):
            inner = _within(values, name)
            if element.tag == qualified("ssd:System"):
                own = _within(options, name)
                block, found = self._system(element, name, inner, own)
                diagram.add(**{legal[name]: block})
            else:
                connected = {c for _, (e, c) in connections if e == name}
                own = options.get(name, {})
                found = self._component(
                    element, inner, own, connected, diagram, legal[name]
                )
            places |= {(name, connector): place for connector, place in found.items()}
        return diagram, wire(diagram, places, connections, system, self.where)

    def _connections(self, system: Element, values: Values) -> list[Connection]:
        """Return the connections of signals; apply connections of system parameters to `values`."""
        parameters = "ssd:Connectors/ssd:Connector[@kind='parameter']"
        names = {c.get("name") for c in system.findall(parameters, XML_NAMESPACES)}
        found = []
        for element in system.findall("ssd:Connections/ssd:Connection", XML_NAMESPACES):
            start, end = (
                (element.get(f"{side}Element", ""), element.get(f"{side}Connector", ""))
                for side in ("start", "end")
            )
            if any(child.tag.endswith("Transformation") for child in element):
                raise SspError(
                    f"cannot import '{system.get('name')}' of '{self.where}': the connection from "
                    f"'{start[1]}' to '{end[1]}' converts values, which wires do not support; "
                    "convert them in one of the FMUs"
                )
            if start[0] or start[1] not in names:
                found.append((start, end))
            elif start[1] in values:
                # As if the file gave the value to the element: ``element.parameter``.
                values[".".join(end)] = values[start[1]]
        return found

    def _component(
        self,
        component: Element,
        outer: Values,
        options: Values,
        connected: set[str],
        diagram: Diagram,
        name: str,
    ) -> dict[str, Place]:
        """Add one FMU; return the targets of its connectors."""
        kind = component.get("type", FMU_TYPE)
        if kind != FMU_TYPE:
            raise SspError(
                f"cannot import '{component.get('name')}' of '{self.where}': it is of type "
                f"'{kind}'; only FMUs can be imported"
            )
        file = self._inside(component.get("source", ""))
        kinds = {text: short for short, text in IMPLEMENTATION_NAMES.items()}
        wanted = kinds.get(component.get("implementation", "any"))
        description = FmuFile.read(file).description
        if wanted != "me" and "cs" in description.kinds:
            # Priority: the argument, the step of the export, that of the file's master.
            options = {"step": self.master_step} | options
            if self.step is not None:
                options["step"] = self.step
        values = outer | self._values(component)
        free = [v for v in description.numbers("input") if v.name not in connected]
        # The export writes a grounded input as the value zero; see `_grounded` there.
        grounded = {v.name for v in free if values.get(v.name) == 0.0}
        starts = {v.name: v.start for v in free if v.start is not None and not v.shape}
        given = {k: v for k, v in (starts | values).items() if k not in grounded}
        block = Fmu(file, kind=wanted, start=given, **options)
        diagram.add(**{name: block})
        places: dict[str, Place] = {}
        for port in [*block.inputs(), *block.outputs()]:
            names = block.variables[port.name]
            # An array variable of FMI 3 has one name for all elements: no connectors.
            if len(names) == port.size:
                places |= {n: (port, i) for i, n in enumerate(names)}
            zero = [i for i, n in enumerate(names) if n in grounded]
            if zero:
                diagram.ground(port if len(zero) == port.size else port[zero])
        return places

    # -- values -------------------------------------------------------------------------------

    def _values(self, element: Element) -> Values:
        """Return the parameter values of an element, by name."""
        found: Values = {}
        bindings = "ssd:ParameterBindings/ssd:ParameterBinding"
        for binding in element.findall(bindings, XML_NAMESPACES):
            source = binding.get("source")
            prefix = binding.get("prefix", "")
            root = binding if source is None else self._xml(source)
            values: Values = {}
            for parameter in root.iter(qualified("ssv:Parameter")):
                name = parameter.get("name", "")
                values[prefix + name] = self._value(parameter, name)
            mapping = binding.find("ssd:ParameterMapping", XML_NAMESPACES)
            # A mapping selects: values that it does not name are not applied.
            found |= values if mapping is None else self._mapped(values, mapping)
        return found

    def _mapped(self, values: Values, mapping: Element) -> Values:
        """Return the values under the target names of a parameter mapping.

        Raises
        ------
        SspError
            If a conversion is not linear, or its value is a text.
        """
        source = mapping.get("source")
        root = mapping if source is None else self._xml(source)
        found = {}
        for entry in root.iter(qualified("ssm:MappingEntry")):
            name = entry.get("source", "")
            target = entry.get("target", "")
            value = values.get(name)
            linear = entry.find("ssc:LinearTransformation", XML_NAMESPACES)
            if len(entry) and (linear is None or isinstance(value, str)):
                raise SspError(
                    f"cannot import '{self.where}': the mapping of parameter '{name}' to '{target}' is "
                    "not a linear conversion of a number; write the value under the FMU's own name"
                )
            if value is not None and linear is not None:
                factor = self._number(linear.get("factor", "1"), "factor")
                offset = self._number(linear.get("offset", "0"), "offset")
                value = factor * value + offset
            if value is not None:
                found[target] = value
        return found

    def _value(self, parameter: Element, name: str) -> Any:
        # The only child states type and value: ``<ssv:Real value="1.0"/>``.
        typed = next(iter(parameter), None)
        text = None if typed is None else typed.get("value")
        if typed is None or text is None:
            raise SspError(
                f"cannot read '{self.where}': parameter '{name}' has no value"
            )
        kind = typed.tag.rpartition("}")[2]
        if kind == "String":
            return text
        if kind == "Boolean":
            return float(text.strip() in ("true", "1"))
        return self._number(text, f"parameter '{name}'")


def _within(values: Values, name: str) -> Values:
    """Return the values for one element, whose names begin with that of the element."""
    prefix = f"{name}."
    return {
        k.removeprefix(prefix): v for k, v in values.items() if k.startswith(prefix)
    }
