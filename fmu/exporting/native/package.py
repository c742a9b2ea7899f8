"""Files of a native FMU."""

from __future__ import annotations

from collections.abc import Sequence

from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.model_description import (
    build_description,
    model_description,
    token,
)
from trussflow.fmu.exporting.native.binaries import chosen, compile_binary
from trussflow.fmu.exporting.native.source import COMPILED_FILE, source

CAPABILITY_FLAGS = {
    "2.0": {
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    },
    "3.0": {
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
        "providesAdjointDerivatives": "true",
    },
}


def native_files(
    interface: ExportInterface, version: str, platforms: str | Sequence[str] | None
) -> dict[str, bytes]:
    """Return the files of a native FMU by their paths in the archive.

    Parameters
    ----------
    interface : ExportInterface
        The exported interface.
    version : str
        ``"2.0"`` or ``"3.0"``.
    platforms : str, sequence of str or None
        Names of platforms in FMI 3; None is this platform; an empty sequence exports sources only.

    Raises
    ------
    ExportError
        If there are Python blocks, or there is no compiler.
    """
    targets = chosen(platforms)
    exchange = dict(CAPABILITY_FLAGS[version])
    simulation = exchange | {"canHandleVariableCommunicationStepSize": "true"}
    # Algebraic loops need the completed step: their solution there starts the next iteration.
    # Histories of signals store a point there.
    completed = interface.plan.guesses.size + interface.plan.histories.size > 0
    if version == "3.0" and completed:
        exchange["needsCompletedIntegratorStep"] = "true"
    # The two versions state opposite flags: not needed, and needed.
    if version == "2.0" and not completed:
        exchange["completedIntegratorStepNotNeeded"] = "true"
    if version == "3.0" and interface.plan.has_events:
        simulation["mightReturnEarlyFromDoStep"] = "true"
    description = model_description(
        interface,
        version,
        {"ModelExchange": exchange, "CoSimulation": simulation},
        COMPILED_FILE if version == "2.0" else "",
    )
    code = source(interface, version, token(interface, version))
    texts = {
        "modelDescription.xml": description,
        "sources/all.c": code.wrapper,
        "sources/model.c": code.model,
    }
    if version == "3.0":
        texts["sources/buildDescription.xml"] = build_description(
            interface, COMPILED_FILE
        )
    files = {path: text.encode() for path, text in texts.items()}
    for target in targets:
        folder = target.folder(version, targets)
        files[f"binaries/{folder}/{interface.identifier}{target.suffix}"] = (
            compile_binary(code, target)
        )
    return files
