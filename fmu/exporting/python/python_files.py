"""The files of an FMU that runs this package, and the block, in the Python of the target."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pythonfmu

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.fmi2_xml import model_description
from trussflow.fmu.exporting.description.xml_text import Kind
from trussflow.fmu.exporting.python.bundle import Files, bundle, licences
from trussflow.fmu.exporting.python.content import FACTS, PICKLE
from trussflow.fmu.exporting.python.pickling import Pickled, pickled
from trussflow.fmu.exporting.python.trial import Abilities, tried


def python_files(item: Block, interface: ExportInterface, version: str = "2.0", solver: str = "rk4") -> Files:
    """Return the files of an FMI 2.0 co-simulation FMU that needs Python on the target.

    The target needs the libraries that ``resources/requirements.txt`` lists, and the same version
    of Python if code of the user's is in the block. A C compiler makes it fast, but it does
    without. This package itself is in the FMU, under a name of its own, so that it neither needs
    nor disturbs an installed one. Each instance has Python blocks of its own; a saved state holds
    what their hooks hand over (see `Lifecycle`).

    Parameters
    ----------
    item : Block
        What to export; a copy of it, as it is now, goes into the FMU.
    interface : Interface
        Its description.
    version : str
        Version of FMI; there is only ``"2.0"``.
    solver : str
        As for `Session`; the step is that of the interface.

    Raises
    ------
    ExportError
        If something in the block cannot be taken along, or the copy does not run.
    """
    if version != "2.0":
        raise ExportError(f"an FMU of kind 'python' has version 2.0 of FMI, not {version!r}")
    found = pickled(item)
    carried = {PICKLE: found.data, FACTS: json.dumps(_facts(interface, found, solver), indent=1).encode()}
    resources = bundle(interface.identifier, found, carried)
    try:
        abilities = tried(resources)
    except TrussflowError:
        raise
    except Exception as error:  # code of the user's, loaded for the first time
        raise ExportError(
            f"cannot export '{item.name}': the copy that would go into the FMU does not run: "
            f"{type(error).__name__}: {error}"
        ) from error
    files = {f"resources/{name}": data for name, data in resources.items()}
    files |= {f"documentation/licenses/{name}": data for name, data in licences().items()}
    files |= _binaries(interface.identifier)
    files["modelDescription.xml"] = model_description(interface, (_kind(abilities),)).encode()
    return files


def _facts(interface: ExportInterface, found: Pickled, solver: str) -> dict[str, Any]:
    """Return what the FMU must know to run."""
    u = [float(s) for v in interface.inputs if v.start is not None for s in v.start]
    x = interface.initial()[0]
    exact = [float(v.initial == "exact") for v in interface.states for _ in range(v.size)]
    tunable = [float(v.variability == "tunable") for v in interface.parameters for _ in range(v.size)]
    python = f"{sys.version_info.major}.{sys.version_info.minor}" if found.has_code else None
    return {
        "name": interface.name,
        "token": interface.token,
        "step": interface.step,
        "solver": solver,
        "python": python,
        "u": u,
        "p": interface.p.tolist(),
        "x": x.tolist(),
        "exact": exact,
        "tunable": tunable,
        "names": [name for v in interface.variables for name in v.scalars()],
    }


def _kind(abilities: Abilities) -> Kind:
    """Return the capability flags, which say what was tried."""
    return Kind(
        "CoSimulation",
        {
            "needsExecutionTool": "false",
            "canHandleVariableCommunicationStepSize": "true",
            "canBeInstantiatedOnlyOncePerProcess": "false",
            "canNotUseMemoryManagementFunctions": "true",
            "canGetAndSetFMUstate": str(abilities.states).lower(),
            "canSerializeFMUstate": str(abilities.bytes).lower(),
        },
    )


def _binaries(identifier: str) -> Files:
    """Return the wrappers of all platforms that pythonfmu has."""
    folder = Path(str(pythonfmu.__file__)).parent / "resources" / "binaries"
    return {
        f"binaries/{path.parent.name}/{identifier}{path.suffix}": path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".so", ".dll", ".dylib")
    }
