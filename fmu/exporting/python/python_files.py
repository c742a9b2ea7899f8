"""Files of an FMU that runs this package and the block in the Python of the target."""

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
from trussflow.fmu.exporting.description.model_description import Use, model_description
from trussflow.fmu.exporting.python.bundle import Files, bundle, licences
from trussflow.fmu.exporting.python.content import FACTS_FILE, PICKLE_FILE
from trussflow.fmu.exporting.python.pickling import pickled
from trussflow.fmu.exporting.python.trial import tried


def python_files(item: Block, interface: ExportInterface, version: str = "2.0", solver: str = "rk4") -> Files:
    """Return the files of an FMI 2.0 co-simulation FMU that needs Python on the target.

    The target needs the libraries that ``resources/requirements.txt`` lists, and the same version
    of Python if the block contains code of the user. A C compiler is optional and makes it faster.
    The FMU contains this package under a private name, so that it is independent of an installed
    version. Each instance has separate Python blocks; a saved state includes their states (see
    `Running`).

    Parameters
    ----------
    item : Block
        The block or diagram, which is copied into the FMU.
    interface : ExportInterface
        Its interface.
    version : str
        Version of FMI; only ``"2.0"`` is supported.
    solver : str
        Solver, as for `Session`; its step size is that of the interface.

    Raises
    ------
    ExportError
        If an attribute of the block cannot be pickled, or the copy does not run.
    """
    if version != "2.0":
        raise ExportError(f"an FMU of kind 'python' has version 2.0 of FMI, not {version!r}")
    pickle = pickled(item)
    facts = json.dumps(_facts(interface, pickle.has_code, solver), indent=1)
    resources = bundle(interface.identifier, pickle, {PICKLE_FILE: pickle.data, FACTS_FILE: facts.encode()})
    try:
        saves, serializes = tried(resources)
    except TrussflowError:
        raise
    except Exception as error:  # loading the copy runs code of the user
        raise ExportError(
            f"cannot export '{item.name}': the copy for the FMU does not run: {type(error).__name__}: {error}"
        ) from error
    files = {f"resources/{name}": data for name, data in resources.items()}
    files |= {f"documentation/licenses/{name}": data for name, data in licences().items()}
    files |= _binaries(interface.identifier)
    capabilities = {
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": str(saves).lower(),
        "canSerializeFMUstate": str(serializes).lower(),
    }
    description = model_description(interface, version, [Use("CoSimulation", capabilities)])
    files["modelDescription.xml"] = description.encode()
    return files


def _facts(interface: ExportInterface, has_code: bool, solver: str) -> dict[str, Any]:
    """Return the settings and start values that the FMU needs to run."""
    shown = interface.variables
    python = f"{sys.version_info.major}.{sys.version_info.minor}" if has_code else None
    return {
        "name": interface.name,
        "token": interface.token,
        "step": interface.step,
        "solver": solver,
        "python": python,
        "u": [float(value) for v in shown.inputs if v.start is not None for value in v.start],
        "p": interface.p.tolist(),
        "x": interface.x.tolist(),
        "exact": [*map(float, shown.settable_states())],
        "tunable": [*map(float, shown.tunable_parameters())],
        "names": [name for v in shown for name in v.scalars()],
    }


def _binaries(identifier: str) -> Files:
    """Return pythonfmu's wrapper binaries for all its platforms."""
    folder = Path(str(pythonfmu.__file__)).parent / "resources" / "binaries"
    return {
        f"binaries/{path.parent.name}/{identifier}{path.suffix}": path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".so", ".dll", ".dylib")
    }
