"""Pickling of a block for an FMU: with its author's code, but without installed packages."""

from __future__ import annotations

import dis
import functools
import io
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import packages_distributions, version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import cloudpickle

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import leaves
from trussflow.blocks.results.dataset import own_version
from trussflow.fmu.errors import ExportError

OWN_PACKAGE = __name__.partition(".")[0]

PACKAGE_FOLDERS = {"site-packages", "dist-packages"}
"""Names of the folders of installed packages."""


@dataclass(slots=True)
class Pickled:
    """A pickled block and its requirements.

    Attributes
    ----------
    data : bytes
        The pickle.
    libraries : set of str
        Top-level names of the installed packages that the pickle refers to.
    has_code : bool
        Whether the pickle contains compiled code, which only this version of Python can run.
    """

    data: bytes
    libraries: set[str]
    has_code: bool

    def requirements(self) -> list[str]:
        """Return the distributions that the target needs.

        The version of trussflow must be equal, because the attributes of its blocks may change in any
        version. Other distributions must have at least the version that is installed here.
        """
        known = _distributions()
        libraries = self.libraries - {OWN_PACKAGE} | {"cloudpickle"}
        names = {known.get(name, [name])[0] for name in libraries}
        others = [f"{name}>={_release(version(name))}" for name in names]
        return sorted([f"{OWN_PACKAGE}=={own_version()}", *others])


@functools.cache
def _distributions() -> Mapping[str, list[str]]:
    """Return the distributions of each top-level package; cached, because it reads all their files."""
    return packages_distributions()


def pickled(item: Block, facts: Any) -> Pickled:
    """Pickle a block with all code that is not part of an installed package.

    Parameters
    ----------
    item : Block
        The block or diagram.
    facts : object
        Further contents.

    Raises
    ------
    ExportError
        If an attribute cannot be pickled, or a function of the author imports the author's modules
        inside its body.
    """
    try:
        return _pickled((item, facts))
    except ExportError:
        raise
    except Exception as error:  # pickling may run arbitrary code
        raise ExportError(
            f"cannot export '{item.name}': {_culprit(item)} cannot be pickled: "
            f"{type(error).__name__}: {error}. Create objects that cannot be pickled (files, locks, "
            "connections) in open() of a Python block"
        ) from error


def _pickled(item: object) -> Pickled:
    buffer = io.BytesIO()
    pickler = _Pickler(buffer)
    try:
        pickler.dump(item)
    finally:
        for module in pickler.registered:
            # The register is global to cloudpickle, which others may use as well.
            cloudpickle.unregister_pickle_by_value(module)
    return Pickled(buffer.getvalue(), pickler.libraries, pickler.has_code)


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]
    """Pickler that stores by value the code that the target cannot import."""

    has_code = False

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self.libraries: set[str] = set()
        self.registered: list[ModuleType] = []

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, type | FunctionType | ModuleType):
            self._admit(obj)
        elif isinstance(obj, CodeType):
            self.has_code = True
            _check_imports(obj)
        return super().reducer_override(obj)

    def _admit(self, obj: Any) -> None:
        """Record the module of a class, function or module, or register it for pickling by value."""
        name = obj.__name__ if isinstance(obj, ModuleType) else obj.__module__
        module = sys.modules.get(name or "")
        if module is None or name == "__main__":
            return  # cloudpickle pickles such objects by value
        home = _home(name)
        if home == "installed":
            self.libraries.add(name.partition(".")[0])
        elif home == "user" and name not in cloudpickle.list_registry_pickle_by_value():
            cloudpickle.register_pickle_by_value(module)
            self.registered.append(module)


def _home(name: str) -> str:
    """Return the origin of a module: ``"standard"``, ``"installed"`` or ``"user"``."""
    top = name.partition(".")[0]
    if top == OWN_PACKAGE:  # its files are elsewhere in a development installation
        return "installed"
    if top in sys.stdlib_module_names or top in sys.builtin_module_names:
        return "standard"
    module = sys.modules.get(name) or sys.modules.get(top)
    file = getattr(module, "__file__", None) or next(
        iter(getattr(module, "__path__", ())), None
    )
    if file is None:
        return "installed" if module is None else "user"
    path = Path(file)
    folders = {*path.parts, *path.resolve().parts}
    return "installed" if folders & PACKAGE_FOLDERS else "user"


def _check_imports(code: CodeType) -> None:
    """Raise an error for code that imports a module which the target does not have.

    Raises
    ------
    ExportError
        If there is such an import; the message names the function and the module.
    """
    for instruction in dis.get_instructions(code):
        name = str(instruction.argval)
        # Imports at the top of a module are resolved already when it is pickled.
        imports = instruction.opname == "IMPORT_NAME" and name in sys.modules
        if imports and _home(name) == "user":
            raise ExportError(
                f"cannot export: '{code.co_name}' ({Path(code.co_filename).name}:"
                f"{code.co_firstlineno}) imports '{name}' inside a function, and the target does "
                "not have that module; import it at the top of the file"
            )


def _culprit(item: Block) -> str:
    """Return a description of the attribute that cannot be pickled, if it is found."""
    for block in leaves(item):
        for name, value in vars(block).items():
            # These lead to the whole diagram, so each block would seem to be at fault.
            if name not in ("parent", "ports", "inferred_shape"):
                try:
                    _pickled(value)
                except Exception:  # noqa: BLE001 - pickling may raise any error
                    return f"attribute '{name}' of block '{block.path}' ({type(block).__name__})"
    return "an object in it"


def _release(text: str) -> str:
    """Return a version without its local part and development suffixes."""
    whole = re.match(r"\d+(\.\d+)*(?=[.+]|$)", text)
    return whole[0] if whole else "0"
