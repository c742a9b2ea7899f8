"""Who may import whom, and what else holds of the source files as such."""

import ast
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FRAMEWORK = "trussflow.blocks.framework"

# The modules of blocks/framework, lowest first; each may import only those before it, except
# to name a type of a higher floor, which `if TYPE_CHECKING` allows.
FLOORS = (
    *("errors", "types", "units", "validation"),
    *("tracing", "linear_algebra", "program", "operations", "codegen", "compiler"),
    *(
        "port",
        "declarations",
        "lifecycle",
        "event_hooks",
        "block",
        "clock",
        "layout",
        "template",
        "isolation",
    ),
    *("wiring", "junction", "diagram", "external", "system", "injection"),
    *("evaluation", "plan"),
    *("progress", "events", "adaptive", "results", "schedule"),
    *("executor", "python_units", "live", "preparation", "run", "scheduler", "session"),
)

# What the modules below a package must not import.
FORBIDDEN = {
    FRAMEWORK: ("trussflow.blocks.library",),
    "trussflow.blocks": ("trussflow.models", "trussflow.fmu"),
    "trussflow.models": ("trussflow.fmu",),
    "trussflow.fmu": ("trussflow.models",),
}
MAX_LINES = 400

PACKAGE_FILES = sorted(
    path for folder in ("blocks", "models", "fmu") for path in (ROOT / folder).rglob("*.py")
)
ALL_FILES = PACKAGE_FILES + sorted(
    path for folder in ("tests", "examples") for path in (ROOT / folder).rglob("*.py")
)


def name_of(path: Path) -> str:
    """Return the path from the repository root, as tests are named and messages say it."""
    return path.relative_to(ROOT).as_posix()


def module_of(path: Path) -> str:
    """Return the import name of a file of one of the packages."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(("trussflow", *parts)).removesuffix(".__init__")


MODULES = {module_of(path) for path in PACKAGE_FILES}

over_all_files = pytest.mark.parametrize("path", ALL_FILES, ids=name_of)
over_package_files = pytest.mark.parametrize("path", PACKAGE_FILES, ids=name_of)


def imports_in(tree: ast.AST) -> set[str]:
    """Return the modules imported anywhere in a file; `from p import m` gives p.m if m is ours."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            members = (f"{node.module}.{alias.name}" for alias in node.names)
            found.update(member if member in MODULES else node.module for member in members)
    return found


def runtime_imports_in(tree: ast.AST) -> set[str]:
    """Return the modules imported when the code runs, not only when types are checked."""
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    return imports_in(tree)


def is_within(module: str, package: str) -> bool:
    """Tell whether `module` is `package` or lies below it."""
    return f"{module}.".startswith(f"{package}.")


@over_all_files
def test_imports_are_absolute_and_under_the_namespace(path: Path) -> None:
    tree = ast.parse(path.read_text())
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    relative = [node.lineno for node in froms if node.level]
    assert not relative, f"{name_of(path)}: relative imports in lines {relative}"
    bare = {name for name in imports_in(tree) if name.split(".")[0] in ("blocks", "models", "fmu")}
    assert not bare, f"{name_of(path)} imports {bare}: say trussflow.blocks and so on"


@over_package_files
def test_packages_import_downwards(path: Path) -> None:
    own = module_of(path)
    upward = {
        name
        for package, above in FORBIDDEN.items()
        if is_within(own, package)
        for name in imports_in(ast.parse(path.read_text()))
        if any(is_within(name, other) for other in above)
    }
    assert not upward, f"{own} must not import {upward}"


def test_every_framework_module_has_its_floor() -> None:
    modules = {name.removeprefix(f"{FRAMEWORK}.") for name in MODULES if is_within(name, FRAMEWORK)}
    assert modules - {FRAMEWORK} == set(FLOORS), "FLOORS must list the modules of blocks/framework"


@pytest.mark.parametrize("floor", range(len(FLOORS)), ids=FLOORS)
def test_framework_imports_only_lower_floors(floor: int) -> None:
    path = ROOT / "blocks" / "framework" / f"{FLOORS[floor].replace('.', '/')}.py"
    lower = {f"{FRAMEWORK}.{name}" for name in FLOORS[:floor]}
    imported = runtime_imports_in(ast.parse(path.read_text()))
    wrong = {name for name in imported if is_within(name, "trussflow")} - lower
    assert not wrong, f"{FLOORS[floor]} must not import {wrong}"


def test_every_package_is_listed() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    packages = {module_of(path) for path in PACKAGE_FILES if path.name == "__init__.py"}
    assert set(settings["packages"]) == packages
    loose = {name_of(path) for path in PACKAGE_FILES if module_of(path.parent) not in packages}
    assert not loose, f"no __init__.py beside {loose}"


@over_all_files
def test_file_is_not_too_long(path: Path) -> None:
    lines = len(path.read_text().splitlines())
    assert lines <= MAX_LINES, f"{name_of(path)} has {lines} lines; which could move out?"
