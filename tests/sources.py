"""Python files of the project and the modules that they make, for rules about the code itself."""

import ast
import functools
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
MISSIONS = ROOT / "examples" / "missions"
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "tool"
]["setuptools"]


def python_files(*folders):
    """Return the Python files below some folders of the repository."""
    return sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py"))


def module_of(path):
    """Return the import name of a file of one of the packages."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    if parts[:2] == ("blocks", "command_line"):
        # the folder of the package `trussflow` itself
        parts = parts[2:]
    return ".".join(("trussflow", *parts)).removesuffix(".__init__")


PACKAGE_FILES = python_files("blocks", "models", "fmu")
ALL_FILES = PACKAGE_FILES + python_files("tests", "examples")
MODULES = {module_of(path): path for path in PACKAGE_FILES}
PUBLIC_MODULES = sorted(
    name for name, path in MODULES.items() if path.name != "__main__.py"
)


@functools.cache
def tree_of(path):
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def place(path, line):
    """Return file and line as messages name them."""
    return f"{path.relative_to(ROOT).as_posix()}:{line}"
