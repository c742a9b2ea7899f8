"""Pickling a block for an FMU: the code of its author goes with it, libraries stay outside."""

from __future__ import annotations

import dis
import functools
import io
import re
import sys
import sysconfig
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import packages_distributions, version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import cloudpickle

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import leaves
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.python.unpickling import BESIDE, PACKAGE


@dataclass(slots=True)
class Pickled:
    """A pickled block, and what reading it takes.

    Attributes
    ----------
    data : bytes
        The pickle.
    modules : set of str
        Modules of ours that it refers to.
    libraries : set of str
        Top-level names of other libraries that it refers to.
    has_code : bool
        Whether it holds compiled code, which only this version of Python can run.
    """

    data: bytes = b""
    modules: set[str] = field(default_factory=set)
    libraries: set[str] = field(default_factory=set)
    has_code: bool = False

    def requirements(self, always: set[str]) -> list[str]:
        """Return what the target must have installed, with the versions that are here.

        Parameters
        ----------
        always : set of str
            Top-level names that are needed in any case.
        """
        known = _distributions()
        needed = {*self.libraries, *always} - {*BESIDE}
        names = {d for name in needed for d in known.get(name, [name])[:1]}
        return sorted(f"{name}>={_release(version(name))}" for name in names)


@functools.cache
def _distributions() -> Mapping[str, list[str]]:
    """Return the distributions of each top-level package; cached, as this reads all installed files."""
    return packages_distributions()


def pickled(item: Block) -> Pickled:
    """Pickle a block with all code that is neither installed nor ours.

    Parameters
    ----------
    item : Block
        The block or diagram.

    Raises
    ------
    ExportError
        If something in it cannot be pickled, or code imports its author's modules only when it
        runs.
    """
    try:
        return _pickled(item)
    except ExportError:
        raise
    except Exception as error:  # pickling runs code of any kind
        raise ExportError(
            f"cannot export '{item.name}': {_culprit(item)} cannot be taken along: "
            f"{type(error).__name__}: {error}. Make what cannot be pickled (files, locks, "
            "connections) in open() of a Python block"
        ) from error


def _pickled(item: object) -> Pickled:
    found, buffer = Pickled(), io.BytesIO()
    pickler = _Pickler(buffer, found)
    try:
        pickler.dump(item)
    finally:
        for module in pickler.registered:
            cloudpickle.unregister_pickle_by_value(module)
    found.data = buffer.getvalue()
    return found


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]
    """Takes along, by value, what the target cannot import."""

    def __init__(self, file: io.BytesIO, found: Pickled) -> None:
        super().__init__(file)
        self._found = found
        self.registered: list[ModuleType] = []

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, type | FunctionType | ModuleType):
            self._admit(obj)
        elif isinstance(obj, CodeType):
            self._found.has_code = True
            _check_imports(obj)
        return super().reducer_override(obj)

    def _admit(self, obj: Any) -> None:
        """Decide how a class, function or module gets to the target."""
        name = obj.__name__ if isinstance(obj, ModuleType) else obj.__module__
        module = sys.modules.get(name or "")
        if module is None or name == "__main__":
            return  # cloudpickle takes along what no module of that name has
        home = _home(name)
        if home == "ours":
            self._found.modules.add(name)
        elif home == "installed":
            self._found.libraries.add(name.partition(".")[0])
        elif home == "user" and name not in cloudpickle.list_registry_pickle_by_value():
            cloudpickle.register_pickle_by_value(module)
            self.registered.append(module)


def _home(name: str) -> str:
    """Say whose a module is: ours, standard, installed, or the user's own."""
    top = name.partition(".")[0]
    if top == PACKAGE:
        return "ours"
    if top in sys.stdlib_module_names or top in sys.builtin_module_names:
        return "standard"
    module = sys.modules.get(name) or sys.modules.get(top)
    file = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", ())), None)
    if file is None:
        return "installed" if module is None else "user"
    folders = {Path(sysconfig.get_path(kind)).resolve() for kind in ("purelib", "platlib")}
    path = Path(file)
    within = {*path.parents, *path.resolve().parents}
    other = any(part in ("site-packages", "dist-packages") for part in path.parts)
    return "installed" if other or folders & within else "user"


def _check_imports(code: CodeType) -> None:
    """Refuse code that imports what the target will not have under that name.

    Raises
    ------
    ExportError
        Naming function and module.
    """
    for instruction in dis.get_instructions(code):
        name = str(instruction.argval)
        home = _home(name) if instruction.opname == "IMPORT_NAME" else ""
        if home == "ours" or (home == "user" and name in sys.modules):
            raise ExportError(
                f"cannot export: '{code.co_name}' ({Path(code.co_filename).name}:"
                f"{code.co_firstlineno}) imports '{name}' only when it runs, and the target will "
                "not have that; import it at the top of the file"
            )


def _culprit(item: Block) -> str:
    """Name the attribute that cannot be pickled, as well as can be found."""
    for block in leaves(item):
        for name, value in vars(block).items():
            if name not in ("parent", "ports", "inferred_shape"):
                try:
                    _pickled(value)
                except Exception:  # noqa: BLE001 - this is what is looked for
                    return f"attribute '{name}' of block '{block.path}' ({type(block).__name__})"
    return "something in it"


def _release(text: str) -> str:
    """Return a version without its local part and development suffixes."""
    whole = re.match(r"\d+(\.\d+)*(?=[.+]|$)", text)
    return whole[0] if whole else "0"
