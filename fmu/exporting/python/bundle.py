"""The files of an FMU: this package under a private name, and what its loader needs."""

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
from trussflow.fmu.exporting.python.unpickling import PACKAGE

RUNTIME = (content, instance, slave, unpickling)
"""The modules of this folder that run inside the FMU."""

DATA = (".c", ".h", ".css", ".toml", ".json")
"""Suffixes of files that modules read."""

OTHERS = ("pythonfmu", "cloudpickle")
"""Other people's packages of which an FMU holds parts."""

SLAVE = '''"""Made by trussflow: what pythonfmu's binary loads, and runs anew for each instance."""

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
        What the pickled block refers to.
    carried : dict of str to bytes
        Pickle and facts.
    """
    files = _sources(pickle.modules)
    requirements = pickle.requirements(_libraries(files))
    for other in OTHERS:
        files |= _copied(other)
    files["pythonfmu/__init__.py"] = b""  # the original imports its builder
    files |= {f"{content.FOLDER}/{path}": data for path, data in carried.items()}
    private = f"{PACKAGE}_{_digest(files)}"
    renamed = {path: _renamed(path, data, private) for path, data in files.items()}
    loaded = f"slave_{name}_{private[-8:]}"
    loader = SLAVE.format(private=private, name=f"Slave_{private[-8:]}", needs=", ".join(requirements))
    return {f"{private}/{path}": data for path, data in renamed.items()} | {
        f"{loaded}.py": loader.encode(),
        "slavemodule.txt": loaded.encode(),
        "requirements.txt": ("\n".join(requirements) + "\n").encode(),
    }


def licences() -> Files:
    """Return the licences of what others wrote, as far as they are installed with it."""
    found: Files = {}
    for name in OTHERS:
        try:
            files = distribution(name).files or []
        except PackageNotFoundError:
            continue
        for file in files:
            if re.search(r"licen[cs]e", file.name, re.IGNORECASE):
                found[f"{name}.txt"] = Path(str(file.locate())).read_bytes()
    return found


def _sources(modules: Iterable[str]) -> Files:
    """Return the files of modules of ours, of what they import, and the data beside them."""
    files: Files = {}
    for module, path in closure([*(m.__name__ for m in RUNTIME), *modules]).items():
        place = module.partition(".")[2].replace(".", "/")
        inside = f"{place}/__init__.py" if path.name == "__init__.py" else f"{place}.py"
        files[inside] = path.read_bytes()
        folder = inside.rpartition("/")[0]
        for data in path.parent.rglob("*"):
            if data.suffix in DATA:
                files[f"{folder}/{data.relative_to(path.parent).as_posix()}"] = data.read_bytes()
    above = {folder for inside in files for folder in Path(inside).parents}
    for parent in sorted(above):
        files.setdefault((parent / "__init__.py").as_posix(), b"")
    return files


def _libraries(files: Files) -> set[str]:
    """Return the top-level names that our modules import when they are loaded, and SciPy."""
    found = {"scipy"}  # which is imported when it is first used
    for path, data in files.items():
        if path.endswith(".py"):
            found |= loaded_libraries(data)
    return found - sys.stdlib_module_names - {PACKAGE, *OTHERS}


def _copied(package: str) -> Files:
    """Return the modules of another package."""
    folder = Path(str(importlib.import_module(package).__file__)).parent
    return {f"{package}/{path.name}": path.read_bytes() for path in sorted(folder.glob("*.py"))}


def _digest(files: Files) -> str:
    """Return a name for contents: others have another."""
    digest = hashlib.sha256()
    for path, data in sorted(files.items()):
        digest.update(f"{path}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()[:12]


def _renamed(path: str, data: bytes, private: str) -> bytes:
    """Let our own modules import each other, and what is copied beside them, by the private name."""
    if not path.endswith(".py") or path.startswith(tuple(f"{name}/" for name in OTHERS)):
        return data
    data = re.sub(rf"^from (?={'|'.join(OTHERS)})".encode(), f"from {private}.".encode(), data, flags=re.M)
    return re.sub(rf"\b{PACKAGE}(?=\.)".encode(), private.encode(), data)
