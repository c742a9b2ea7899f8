"""Files of an FMU that runs the block in the Python of the target, which has trussflow installed."""

from __future__ import annotations

import hashlib
import re
import sys
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np
import pythonfmu

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.results.dataset import own_version
from trussflow.blocks.results.state_file import encode
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import ExportInterface
from trussflow.fmu.exporting.description.model_description import model_description
from trussflow.fmu.exporting.python.instance import Instance
from trussflow.fmu.exporting.python.payload import (
    PICKLE_FILE,
    REQUIREMENTS_FILE,
    Payload,
)
from trussflow.fmu.exporting.python.pickling import pickled

SLAVE_TEMPLATE = '''"""Written by trussflow; pythonfmu's binary runs this file anew for each instance."""

import logging
import sys
from importlib.metadata import version

try:
    if version("trussflow") != {version!r}:
        raise ImportError("the version of trussflow is " + version("trussflow"))
    here = "%d.%d" % sys.version_info[:2]
    made = {python!r}
    if made not in ("any", here):
        raise ImportError("its author's code is compiled for Python " + made + "; this is Python " + here)
    from trussflow.fmu.exporting.python.slave import slave

    {name} = slave(globals())
except Exception as error:
    message = f"{{error}}; this FMU needs {needs}"
    logging.getLogger("trussflow_fmu").error(message)  # the importer may have switched the FMU's log off
    raise ImportError(message) from error
'''
"""Python file in an FMU; an error in it makes the importer's instantiation fail with its message."""

Files = dict[str, bytes]
"""Contents by path."""


def python_files(
    item: Block, interface: ExportInterface, version: str = "2.0"
) -> Files:
    """Return the files of an FMI 2.0 co-simulation FMU that needs Python on the target.

    The target needs this version of trussflow and the packages that ``resources/requirements.txt``
    lists. It needs the same version of Python if the block contains code of the user. A C compiler is
    optional and makes it faster. Each instance has separate Python blocks; a saved state includes their
    states (see `Running`).

    Parameters
    ----------
    item : Block
        The block or diagram, which is copied into the FMU.
    interface : ExportInterface
        Its interface.
    version : str
        Version of FMI; only ``"2.0"`` is supported.

    Raises
    ------
    ExportError
        If an attribute of the block cannot be pickled, or the copy does not run.
    """
    if version != "2.0":
        raise ExportError(
            f"an FMU of kind 'python' has version 2.0 of FMI, not {version!r}"
        )
    pickle = pickled(item, _facts(interface))
    try:
        saves, serializes = _self_test(pickle.data)
    except TrussflowError:
        raise
    except Exception as error:  # loading the copy runs code of the user
        raise ExportError(
            f"cannot export '{item.name}': the copy for the FMU does not run: {type(error).__name__}: {error}"
        ) from error
    # Python keeps loaded modules by name, so each content needs a name of its own.
    digest = hashlib.sha256(pickle.data).hexdigest()[:8]
    module = f"slave_{interface.identifier}_{digest}"
    requirements = pickle.requirements()
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    loader = SLAVE_TEMPLATE.format(
        version=own_version(),
        python=python if pickle.has_code else "any",
        name=f"Slave_{digest}",
        needs=", ".join(requirements),
    )
    resources = {
        PICKLE_FILE: pickle.data,
        f"{module}.py": loader.encode(),
        "slavemodule.txt": module.encode(),
        REQUIREMENTS_FILE: ("\n".join(requirements) + "\n").encode(),
    }
    files = {f"resources/{name}": data for name, data in resources.items()}
    files |= _wrapper(interface.identifier)
    capabilities = {
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": str(saves).lower(),
        "canSerializeFMUstate": str(serializes).lower(),
    }
    description = model_description(interface, version, {"CoSimulation": capabilities})
    files["modelDescription.xml"] = description.encode()
    return files


def _facts(interface: ExportInterface) -> dict[str, Any]:
    """Return the settings that the FMU needs to run, and the facts of each scalar variable."""
    shown = [*interface.variables.scalarized()]
    inputs = np.array([v.causality == "input" for v in shown])
    return {
        "identity": {"FMU": interface.token},
        "settings": {"step": interface.step, "solver": interface.solver},
        "names": [v.name for v in shown],
        "values": np.array([0.0 if v.start is None else v.start[0] for v in shown]),
        "early": inputs | np.array([v.initial == "exact" for v in shown]),
        "late": inputs | np.array([v.variability == "tunable" for v in shown]),
    }


def _self_test(pickle: bytes) -> tuple[bool, bool]:
    """Load a payload, initialize the model and save its state.

    Return whether its state can be saved, and whether it can be serialized.

    Raises
    ------
    ExportError
        If an output is not finite at the start.
    """
    payload = Payload(pickle, compiled=False)
    instance = Instance(payload)
    try:
        instance.initialize()
        finite = np.isfinite(instance.get(range(1, 1 + len(payload.names))))
        if not finite.all():
            raise ExportError(
                f"'{payload.names[int(np.argmin(finite))]}' is not finite at the start"
            )
        if not instance.restores:
            return False, False
        try:
            encode(instance.save(), payload.identity)
        except TypeError:
            return True, False
        return True, True
    finally:
        instance.close()


def _wrapper(identifier: str) -> Files:
    """Return pythonfmu's wrapper binaries for all its platforms, and its licence."""
    folder = Path(str(pythonfmu.__file__)).parent / "resources" / "binaries"
    files = {
        f"binaries/{path.parent.name}/{identifier}{path.suffix}": path.read_bytes()
        # Sorted, because equal exports must give equal archives.
        for path in sorted(folder.rglob("*"))
        if path.suffix in (".so", ".dll", ".dylib")
    }
    for file in distribution("pythonfmu").files or []:
        if re.search(r"licen[cs]e", file.name, re.IGNORECASE):
            files["documentation/licenses/pythonfmu.txt"] = Path(
                str(file.locate())
            ).read_bytes()
    return files
