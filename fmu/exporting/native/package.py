"""The files of a native FMU."""

from __future__ import annotations

from collections.abc import Sequence

from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description import fmi2_xml, fmi3_xml
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.xml_text import Kind
from trussflow.fmu.exporting.native.binaries import chosen, compile_binary
from trussflow.fmu.exporting.native.source import SOURCES, source

FMI2 = {
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
    "providesDirectionalDerivative": "true",
}
FMI3 = {
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "providesDirectionalDerivatives": "true",
    "providesAdjointDerivatives": "true",
}
STEPS = {"canHandleVariableCommunicationStepSize": "true"}

VERSIONS = ("2.0", "3.0")


def native_files(
    interface: ExportInterface, version: str, platforms: str | Sequence[str] | None
) -> dict[str, bytes]:
    """Return the files of a native FMU by their paths in the archive.

    Parameters
    ----------
    interface : Interface
        What to export.
    version : str
        ``"2.0"`` or ``"3.0"``.
    platforms : str, sequence of str or None
        Names of platforms in FMI 3; None means this one; none at all gives sources only.

    Raises
    ------
    ExportError
        If there are Python blocks, or no compiler.
    """
    targets = chosen(platforms)
    if version == "2.0":
        kinds = (
            Kind("ModelExchange", FMI2 | {"completedIntegratorStepNotNeeded": "true"}, SOURCES),
            Kind("CoSimulation", FMI2 | STEPS, SOURCES),
        )
        description = fmi2_xml.model_description(interface, kinds)
        token = fmi2_xml.guid(interface)
    elif version == "3.0":
        kinds = (Kind("ModelExchange", FMI3), Kind("CoSimulation", FMI3 | STEPS))
        description = fmi3_xml.model_description(interface, kinds)
        token = fmi3_xml.instantiation_token(interface)
    else:
        raise ExportError(f"unknown FMI version {version!r}; choose from: {', '.join(VERSIONS)}")
    code = source(interface, version, token)
    found = {
        "modelDescription.xml": description,
        "sources/all.c": code.wrapper,
        "sources/model.c": code.model,
    }
    if version == "3.0":
        found["sources/buildDescription.xml"] = fmi3_xml.build_description(interface, SOURCES)
    files = {path: text.encode() for path, text in found.items()}
    for target in targets:
        folder = target.folder(version, targets)
        name = f"binaries/{folder}/{interface.identifier}{target.suffix}"
        files[name] = compile_binary(code, target)
    return files
