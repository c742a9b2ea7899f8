"""Files of a native FMU."""

from __future__ import annotations

from collections.abc import Sequence

from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.model_description import (
    Use,
    build_description,
    model_description,
    token,
)
from trussflow.fmu.exporting.native.binaries import chosen, compile_binary
from trussflow.fmu.exporting.native.source import COMPILED_FILES, source

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
NO_STEP_FLAGS = {"2.0": {"completedIntegratorStepNotNeeded": "true"}, "3.0": {}}
COMPLETED_STEP_FLAGS = {"2.0": {}, "3.0": {"needsCompletedIntegratorStep": "true"}}
EARLY_RETURN_FLAGS = {"2.0": {}, "3.0": {"mightReturnEarlyFromDoStep": "true"}}
VARIABLE_STEP_FLAGS = {"canHandleVariableCommunicationStepSize": "true"}


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
    common = CAPABILITY_FLAGS[version]
    listed = COMPILED_FILES if version == "2.0" else ()
    # Algebraic loops need the completed step: their solution there starts the next iteration.
    step_flags = COMPLETED_STEP_FLAGS if interface.plan.guesses.size else NO_STEP_FLAGS
    uses = [
        Use("ModelExchange", common | step_flags[version], listed),
        Use(
            "CoSimulation",
            common
            | VARIABLE_STEP_FLAGS
            | (EARLY_RETURN_FLAGS[version] if interface.plan.has_events else {}),
            listed,
        ),
    ]
    description = model_description(interface, version, uses)
    code = source(interface, version, token(interface, version))
    texts = {
        "modelDescription.xml": description,
        "sources/all.c": code.wrapper,
        "sources/model.c": code.model,
    }
    if version == "3.0":
        texts["sources/buildDescription.xml"] = build_description(
            interface, COMPILED_FILES
        )
    files = {path: text.encode() for path, text in texts.items()}
    for target in targets:
        folder = target.folder(version, targets)
        files[f"binaries/{folder}/{interface.identifier}{target.suffix}"] = (
            compile_binary(code, target)
        )
    return files
