"""Transitive closure of the imports between modules of this package."""

from __future__ import annotations

import ast
import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path

from trussflow.fmu.exporting.python.unpickling import PUBLIC_PACKAGE


def closure(modules: Iterable[str]) -> dict[str, Path]:
    """Return the files of modules and of their imports from this package, by module name.

    Parent packages are not included, because a module does not need the imports of its package's
    ``__init__.py``.

    Parameters
    ----------
    modules : iterable of str
        Names of modules to start from.
    """
    found: dict[str, Path] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        path = None if name in found else _file(name)
        if path is not None:
            found[name] = path
            waiting += _imported(ast.parse(path.read_bytes()))
    return dict(sorted(found.items()))


def loaded_libraries(source: bytes) -> set[str]:
    """Return the top-level names of the module-level imports of a file.

    Parameters
    ----------
    source : bytes
        Content of the file.
    """
    found = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


def _file(module: str) -> Path | None:
    """Return the file of a module of this package, or None for any other name."""
    if module.partition(".")[0] != PUBLIC_PACKAGE or module == PUBLIC_PACKAGE:
        return None
    try:
        spec = importlib.util.find_spec(module)
    except ModuleNotFoundError:  # the parent is a module and the name one of its members
        return None
    return None if spec is None or spec.origin is None else Path(spec.origin)


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yield the modules that a file imports anywhere, except for type checking."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            members = [f"{node.module}.{alias.name}" for alias in node.names]
            modules = [member for member in members if _file(member) is not None]
            yield from modules
            if len(modules) < len(members):
                yield node.module
        waiting += ast.iter_child_nodes(node)
