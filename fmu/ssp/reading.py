"""Import of an SSP file as a diagram of FMUs."""

from __future__ import annotations

import json
import os
import shutil
import weakref
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from trussflow.blocks.errors import Explained
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.support.validation import as_path, one_of, shown
from trussflow.fmu.errors import FmuArchiveError, SspError
from trussflow.fmu.importing.block import Fmu
from trussflow.fmu.runtime.archive import MAX_BYTES, remove, unpack
from trussflow.fmu.runtime.array_ports import legal_names
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.safe_xml import check_xml
from trussflow.fmu.ssp.names import (
    FMU_TYPE,
    IMPLEMENTATION_NAMES,
    OPTION_TYPES,
    OPTIONS_FILE,
    STRUCTURE_FILE,
    XML_NAMESPACES,
    qualified,
)
from trussflow.fmu.ssp.wiring import Place, wire

Values = dict[str, Any]
"""Values by the FMU's variable names."""

RESERVED_NAMES = frozenset(dir(Diagram)) | {
    "blocks",
    "wires",
    "exposed",
    "name",
    "parent",
    "ports",
}


def import_ssp(
    path: str | Path,
    folder: str | Path | None = None,
    *,
    step: float | None = None,
    open_inputs: str = "expose",
    max_bytes: float = MAX_BYTES,
) -> Diagram:
    """Return the diagram of an SSP 1.0 file, with its FMUs as blocks.

    Nested systems become nested diagrams, and system connectors become exposed ports. Unconnected
    inputs keep their start values. FMUs are native code that runs with the rights of the user: use
    trusted files only.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.
    folder : str or pathlib.Path, optional
        Folder for the unpacked FMUs; by default a temporary folder, deleted with the diagram.
    step : float, optional
        Communication step size of all FMUs for co-simulation [s]; by default that of the file, or
        the suggestion of each FMU.
    open_inputs : str
        Treatment of the inputs of the system: ``"expose"`` makes them inputs of the diagram, ``"start"``
        leaves them at the start values that the FMUs declare.
    max_bytes : float
        Maximum unpacked size [B].

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
    unpacked = unpack(path, max_bytes)
    try:
        with Explained(lambda e: SspError(f"cannot unpack into {shown(folder)}: {e}")):
            kept = unpacked if folder is None else _moved(unpacked, Path(folder))
        with Explained(
            lambda e: SspError(f"cannot read '{path.name}': {type(e).__name__}: {e}")
        ):
            diagram = _Reader(path.name, kept, step, open_inputs, max_bytes).read()
    except BaseException:
        remove(unpacked)
        raise
    if folder is None:
        weakref.finalize(diagram, remove, unpacked)
    else:
        remove(unpacked)
    return diagram


def _moved(unpacked: Path, folder: Path) -> Path:
    """Copy the unpacked files to the folder of the user.

    Raises
    ------
    SspError
        If the folder exists and is not empty.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SspError(
            f"cannot unpack into '{folder}': it exists already and is not an empty folder"
        )
    shutil.copytree(unpacked, folder, dirs_exist_ok=True)
    return folder


class _Reader:
    """Reader of one SSP file; `where` is its name in error messages."""

    def __init__(
        self,
        where: str,
        folder: Path,
        step: float | None,
        open_inputs: str,
        max_bytes: float,
    ) -> None:
        self.where = where
        self.folder = folder
        self.step = step
        self.max_bytes = max_bytes
        self.open_inputs = open_inputs

    def read(self) -> Diagram:
        root = self._xml(STRUCTURE_FILE)
        if root.tag != qualified("ssd:SystemStructureDescription"):
            raise SspError(
                f"cannot read '{self.where}': it is not a system structure of SSP 1"
            )
        system = root.find("ssd:System", XML_NAMESPACES)
        if system is None:
            raise SspError(f"cannot read '{self.where}': it has no System")
        master = system.find(".//oms:FixedStepMaster", XML_NAMESPACES)
        stated = None if master is None else master.get("stepSize")
        self.master_step = None if stated is None else self._number(stated, "stepSize")
        name, notes = self._notes()
        fed = None if self.open_inputs == "expose" else set[str]()
        return self._system(system, name or system.get("name", ""), {}, notes, fed)[0]

    def _notes(self) -> tuple[str, Values]:
        """Return the name of the diagram and the options by path of the FMU from trussflow's file."""
        if not (self.folder / OPTIONS_FILE).is_file():
            return "", {}
        fault = f"cannot read '{self.where}': its '{OPTIONS_FILE}' is damaged"
        try:
            notes = json.loads(self._inside(OPTIONS_FILE).read_bytes())
            name = str(notes["name"])
            fmus = dict(notes["fmus"])
            wrong = [
                f"'{option}' of '{path}' is {value!r}"
                for path, options in fmus.items()
                for option, value in dict(options).items()
                if not isinstance(value, OPTION_TYPES.get(option, ()))
            ]
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise SspError(f"{fault} ({type(error).__name__}: {error})") from None
        if wrong:
            raise SspError(f"{fault}: {wrong[0]}")
        return name, fmus

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
        parts = PurePosixPath(name).parts
        if (
            not parts
            or name.startswith("/")
            or ".." in parts
            or ":" in name
            or "\\" in name
        ):
            raise SspError(
                f"cannot read '{self.where}': '{name}' is not inside of it; only SSP files that "
                "contain all their resources can be imported"
            )
        file = self.folder.joinpath(*parts)
        if not os.path.isfile(file):
            raise SspError(f"cannot read '{self.where}': it contains no file '{name}'")
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
        self,
        system: Element,
        title: str,
        outer: Values,
        notes: Values,
        fed: set[str] | None,
    ) -> tuple[Diagram, dict[str, Place]]:
        """Return the diagram of a system and the targets of its connectors.

        If `fed` is given, only the inputs in it are kept.
        """
        diagram = Diagram(title)
        values = outer | self._values(system)
        elements = system.findall("ssd:Elements/*", XML_NAMESPACES)
        known = {qualified("ssd:Component"), qualified("ssd:System")}
        if {e.tag for e in elements} - known or system.find(
            "ssd:SignalDictionaries", XML_NAMESPACES
        ) is not None:
            raise SspError(
                f"cannot import '{title}' of '{self.where}': it has a signal dictionary, which "
                "diagrams do not support"
            )
        connections = [
            c
            for c in self._wires(system, values)
            if fed is None or c.get("startElement") or c.get("startConnector") in fed
        ]
        names = [e.get("name", "") for e in elements]
        if len(set(names)) < len(names):
            raise SspError(
                f"cannot import '{title}' of '{self.where}': two elements have the same name"
            )
        legal = legal_names(names, RESERVED_NAMES)
        driven = {(c.get("endElement"), c.get("endConnector")) for c in connections}
        places: dict[str, dict[str, Place]] = {}
        for element, name in zip(elements, names, strict=True):
            inner = self._within(values, name, names)
            connected = {c for e, c in driven if e == name and c is not None}
            if element.tag == qualified("ssd:System"):
                own = self._within(notes, name, names)
                inputs = None if fed is None else connected
                block, places[name] = self._system(element, name, inner, own, inputs)
                diagram.add(**{legal[name]: block})
            else:
                places[name] = self._component(
                    element, inner, notes.get(name, {}), connected, diagram, legal[name]
                )
        return diagram, wire(diagram, places, connections, system, self.where)

    def _wires(self, system: Element, values: Values) -> list[Element]:
        """Return the connections of signals; apply connections of system parameters to `values`."""
        parameters = "ssd:Connectors/ssd:Connector[@kind='parameter']"
        names = {
            connector.get("name")
            for connector in system.findall(parameters, XML_NAMESPACES)
        }
        found = []
        for connection in self._connections(system):
            name = connection.get("startConnector", "")
            if connection.get("startElement") or name not in names:
                found.append(connection)
            elif name in values:
                values[
                    f"{connection.get('endElement')}.{connection.get('endConnector')}"
                ] = values[name]
        return found

    def _connections(self, system: Element) -> Iterator[Element]:
        for connection in system.findall(
            "ssd:Connections/ssd:Connection", XML_NAMESPACES
        ):
            if any(child.tag.endswith("Transformation") for child in connection):
                raise SspError(
                    f"cannot import '{system.get('name')}' of '{self.where}': the connection from "
                    f"'{connection.get('startConnector')}' to '{connection.get('endConnector')}' "
                    "converts values, which wires do not support; convert them in one of the FMUs"
                )
            yield connection

    def _within(self, values: Values, name: str, others: list[str]) -> Values:
        """Return the values for one element, whose names begin with that of the element."""
        prefix = f"{name}."
        longer = tuple(f"{o}." for o in others if o.startswith(prefix))
        return {
            k.removeprefix(prefix): v
            for k, v in values.items()
            if k.startswith(prefix) and not (longer and k.startswith(longer))
        }

    def _component(
        self,
        component: Element,
        outer: Values,
        options: dict[str, Any],
        connected: set[str],
        diagram: Diagram,
        name: str,
    ) -> dict[str, Place]:
        """Add one FMU; return the targets of its connectors."""
        kind = component.get("type", FMU_TYPE)
        source = component.get("source", "")
        if kind != FMU_TYPE:
            raise SspError(
                f"cannot import '{component.get('name')}' of '{self.where}': it is of type "
                f"'{kind}'; only FMUs can be imported"
            )
        file = self._inside(source)
        kinds = {text: short for short, text in IMPLEMENTATION_NAMES.items()}
        wanted = kinds.get(component.get("implementation", "any"))
        description = FmuFile.read(file, self.max_bytes).description
        values = outer | self._values(component)
        if wanted != "me" and "cs" in description.kinds:
            options = (
                {"step": self.master_step}
                | options
                | ({} if self.step is None else {"step": self.step})
            )
        grounded = {
            v.name
            for v in description.having("input")
            if v.name not in connected and values.get(v.name) == 0.0
        }
        open_ = [
            v for v in description.having("input") if v.name not in connected | grounded
        ]
        starts = {v.name: v.start for v in open_ if v.start is not None and not v.shape}
        values = {**starts, **{k: v for k, v in values.items() if k not in grounded}}
        block = Fmu(
            file, kind=wanted, start=values, max_bytes=self.max_bytes, **options
        )
        diagram.add(**{name: block})
        places: dict[str, Place] = {}
        for port in [*block.inputs(), *block.outputs()]:
            names = block.variables[port.name]
            if len(names) == port.size:
                places |= {n: Place(port, i) for i, n in enumerate(names)}
            zero = [i for i, n in enumerate(names) if n in grounded]
            if zero:
                diagram.ground(port if len(zero) == port.size else port[zero])
        return places

    # -- values -------------------------------------------------------------------------------

    def _values(self, element: Element) -> Values:
        """Return the parameter values of an element, by name."""
        found: Values = {}
        for binding in element.findall(
            "ssd:ParameterBindings/ssd:ParameterBinding", XML_NAMESPACES
        ):
            source = binding.get("source")
            prefix = binding.get("prefix", "")
            roots = binding.findall(
                "ssd:ParameterValues/ssv:ParameterSet", XML_NAMESPACES
            )
            if source is not None:
                roots = [self._xml(source)]
            values: Values = {}
            for parameter in (
                p for r in roots for p in r.iter(qualified("ssv:Parameter"))
            ):
                name = parameter.get("name", "")
                values[prefix + name] = self._value(parameter, name)
            found |= self._mapped(
                values, binding.find("ssd:ParameterMapping", XML_NAMESPACES)
            )
        return found

    def _mapped(self, values: Values, mapping: Element | None) -> Values:
        """Return the values under the target names of a parameter mapping, if there is one."""
        if mapping is None:
            return values
        source = mapping.get("source")
        found = {}
        for entry in (mapping if source is None else self._xml(source)).iter(
            qualified("ssm:MappingEntry")
        ):
            name = entry.get("source", "")
            target = entry.get("target", "")
            linear = entry.find("ssc:LinearTransformation", XML_NAMESPACES)
            if linear is None and len(entry):
                raise SspError(
                    f"cannot import '{self.where}': the mapping of parameter '{name}' to '{target}' is "
                    "not linear; write the value under the FMU's own name"
                )
            if name not in values:
                continue
            value = values[name]
            if linear is not None:
                if isinstance(value, str):
                    raise SspError(
                        f"cannot import '{self.where}': the mapping of parameter '{name}' to '{target}' "
                        f"converts a number, but the value is the text '{value}'; remove the conversion"
                    )
                factor = self._number(linear.get("factor", "1"), "factor")
                value = factor * value + self._number(
                    linear.get("offset", "0"), "offset"
                )
            found[target] = value
        return found

    def _value(self, parameter: Element, name: str) -> Any:
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
