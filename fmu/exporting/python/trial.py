"""Trial run of the content of an FMU before it is written."""

from __future__ import annotations

import importlib
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import numpy as np

from trussflow.blocks.framework.temporary import process_folder
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.python.bundle import Files


def tried(resources: Files) -> tuple[bool, bool]:
    """Load the private package from a temporary folder, initialize the model and save its state.

    Return whether its state can be saved, and whether it can be serialized.

    Parameters
    ----------
    resources : dict of str to bytes
        The files of the folder ``resources``.

    Raises
    ------
    ExportError
        If an output is not finite at the start.
    """
    private = next(iter(resources)).partition("/")[0]
    with tempfile.TemporaryDirectory(dir=process_folder()) as folder:
        for name, data in resources.items():
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        running = _taken_out(private)  # modules of an equal FMU that runs in this process
        sys.path.insert(0, folder)
        importlib.invalidate_caches()
        try:
            return _tried(private)
        finally:
            sys.path.remove(folder)
            _taken_out(private)
            sys.modules.update(running)


def _taken_out(package: str) -> dict[str, ModuleType]:
    """Remove a package and its modules from the loaded modules; return them."""
    names = [name for name in sys.modules if f"{name}.".startswith(f"{package}.")]
    return {name: sys.modules.pop(name) for name in names}


def _tried(private: str) -> tuple[bool, bool]:
    content = importlib.import_module(f"{private}.fmu.exporting.python.content").load(compiled=False)
    module = importlib.import_module(f"{private}.fmu.exporting.python.instance")
    instance = module.Instance(content)
    try:
        instance.initialize()
        values = np.array(instance.get(range(1, 1 + len(content.names))))
        if not np.isfinite(values).all():
            name = content.names[int(np.argmin(np.isfinite(values)))]
            raise ExportError(f"'{name}' is not finite at the start")
        states = instance.restores
        try:
            if states:
                module.to_bytes(instance.save(), content.facts["token"])
        except TypeError:
            return states, False
        return states, states
    finally:
        instance.close()
