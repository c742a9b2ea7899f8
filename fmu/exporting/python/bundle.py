"""Resource files of an FMU: this package under a private name, and its loader."""

from __future__ import annotations

import hashlib
import importlib
import re
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from trussflow.fmu.exporting.python import content, instance, slave, unpickling
from trussflow.fmu.exporting.python.closure import closure, loaded_libraries
from trussflow.fmu.exporting.python.pickling import Pickled
from trussflow.fmu.exporting.python.unpickling import PUBLIC_PACKAGE

RUNTIME_MODULES = (content, instance, slave, unpickling)
"""Modules of this folder that run inside the FMU."""

DATA_SUFFIXES = (".c", ".h", ".css", ".toml", ".json")
"""Suffixes of data files that modules read."""

COPIED_PACKAGES = ("pythonfmu", "cloudpickle")
"""Third-party packages whose modules are copied into the FMU."""

SLAVE_TEMPLATE = '''"""Made by trussflow: what pythonfmu's binary loads, and runs anew for each instance."""

from {private}.fmu.exporting.python.slave import slave

{name} = slave(globals(), {needs!r})
'''

Files = dict[str, bytes]
"""Contents by path."""


def bundle(name: str, pickle: Pickled, carried: Files) -> Files:
    """Return the files of the folder ``resources``.

    Parameters
    ----------
    name : str
        C identifier of the model.
    pickle : Pickled
        The pickled block and its requirements.
    carried : dict of str to bytes
        Pickle and facts, by file name.
    """
    files = _sources(pickle.modules)
    requirements = pickle.requirements(_libraries(files))
    for other in COPIED_PACKAGES:
        files |= _copied(other)
    files["pythonfmu/__init__.py"] = b""  # the original imports its builder
    files |= {f"{content.CONTENT_FOLDER}/{path}": data for path, data in carried.items()}
    private = f"{PUBLIC_PACKAGE}_{_digest(files)}"
    renamed = {path: _renamed(path, data, private) for path, data in files.items()}
    loaded = f"slave_{name}_{private[-8:]}"
    loader = SLAVE_TEMPLATE.format(
        private=private, name=f"Slave_{private[-8:]}", needs=", ".join(requirements)
    )
    return {f"{private}/{path}": data for path, data in renamed.items()} | {
        f"{loaded}.py": loader.encode(),
        "slavemodule.txt": loaded.encode(),
        "requirements.txt": ("\n".join(requirements) + "\n").encode(),
    }


def licences() -> Files:
    """Return the licences of the third-party packages, if they are installed."""
    found: Files = {}
    for name in COPIED_PACKAGES:
        try:
            files = distribution(name).files or []
        except PackageNotFoundError:
            continue
        for file in files:
            if re.search(r"licen[cs]e", file.name, re.IGNORECASE):
                found[f"{name}.txt"] = Path(str(file.locate())).read_bytes()
    return found


def _sources(modules: Iterable[str]) -> Files:
    """Return the files of modules of this package, of their imports, and their data files."""
    files: Files = {}
    for module, path in closure([*(m.__name__ for m in RUNTIME_MODULES), *modules]).items():
        place = module.partition(".")[2].replace(".", "/")
        inside = f"{place}/__init__.py" if path.name == "__init__.py" else f"{place}.py"
        files[inside] = path.read_bytes()
        folder = inside.rpartition("/")[0]
        for data in path.parent.rglob("*"):
            if data.suffix in DATA_SUFFIXES:
                files[f"{folder}/{data.relative_to(path.parent).as_posix()}"] = data.read_bytes()
    above = {folder for inside in files for folder in Path(inside).parents}
    for parent in sorted(above):
        files.setdefault((parent / "__init__.py").as_posix(), b"")
    return files


def _libraries(files: Files) -> set[str]:
    """Return the libraries that the modules import when they are loaded, and SciPy."""
    found = {"scipy"}  # imported on first use, so the loop does not find it
    for path, data in files.items():
        if path.endswith(".py"):
            found |= loaded_libraries(data)
    return found - sys.stdlib_module_names - {PUBLIC_PACKAGE, *COPIED_PACKAGES}


def _copied(package: str) -> Files:
    """Return the modules of another package."""
    folder = Path(str(importlib.import_module(package).__file__)).parent
    return {f"{package}/{path.name}": path.read_bytes() for path in sorted(folder.glob("*.py"))}


def _digest(files: Files) -> str:
    """Return a hash of the contents."""
    digest = hashlib.sha256()
    for path, data in sorted(files.items()):
        digest.update(f"{path}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()[:12]


def _renamed(path: str, data: bytes, private: str) -> bytes:
    """Change the imports of this package and of the copied ones to the private name."""
    if not path.endswith(".py") or path.startswith(tuple(f"{name}/" for name in COPIED_PACKAGES)):
        return data
    data = re.sub(
        rf"^from (?={'|'.join(COPIED_PACKAGES)})".encode(), f"from {private}.".encode(), data, flags=re.M
    )
    return re.sub(rf"\b{PUBLIC_PACKAGE}(?=\.)".encode(), private.encode(), data)
