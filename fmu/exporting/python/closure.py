"""Which modules of this package others need: what they import, followed to the end."""

from __future__ import annotations

import ast
import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path

from trussflow.fmu.exporting.python.unpickling import PACKAGE


def closure(modules: Iterable[str]) -> dict[str, Path]:
    """Return the files of modules and of all that they import of this package, by module.

    Packages above them are not included: that a module is in a package does not mean that it
    needs what the package's own file imports.

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
    """Return the top-level names that a file imports when it is loaded, not only when it runs.

    Parameters
    ----------
    source : bytes
        The file.
    """
    found = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


def _file(module: str) -> Path | None:
    """Return the file of a module of ours; None for what is no module, or not ours."""
    if module.partition(".")[0] != PACKAGE or module == PACKAGE:
        return None
    try:
        spec = importlib.util.find_spec(module)
    except ModuleNotFoundError:  # the parent is a module: this is something in it
        return None
    return None if spec is None or spec.origin is None else Path(spec.origin)


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yield the modules that a file imports anywhere, but for the sake of types only."""
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
