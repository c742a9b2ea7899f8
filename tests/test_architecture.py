"""Who may import whom, and what else holds of the source files as such."""

import ast
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
# Which rooms the modules of a room may import, besides their own and the loose modules of their
# package (errors, validation). Facades (`__init__`) and command lines (`__main__`) see all below them.
FRAMEWORK, TRACING, SIMULATION, LIBRARY, COSIMULATION, LINEAR, ESTIMATION, DRAWING, SWEEPS = (
    f"trussflow.blocks.{room}"
    for room in (
        *("framework", "tracing", "simulation", "library", "cosimulation", "linear_analysis"),
        "estimation",
        "drawing",
        "sweeps",
    )
)
BLOCKS = (FRAMEWORK, TRACING, SIMULATION, LIBRARY, COSIMULATION, LINEAR, f"{LINEAR}.frequency", ESTIMATION)
FMU, MODELS = "trussflow.fmu", "trussflow.models"
PHYSICS = tuple(f"{MODELS}.{room}" for room in ("geometry", "truss", "robots", "dynamics", "plant"))
STUDY = (*BLOCKS, *PHYSICS, f"{MODELS}.reporting", f"{MODELS}.transport")
EXPORTING = (FRAMEWORK, TRACING, SIMULATION, f"{FMU}.exporting.description")
ROOMS = {
    "trussflow": (FRAMEWORK, SIMULATION, LIBRARY, DRAWING, SWEEPS, "trussflow.blocks", f"{FMU}.importing"),
    FRAMEWORK: (),
    TRACING: (FRAMEWORK,),
    SIMULATION: (FRAMEWORK, TRACING),
    LIBRARY: (FRAMEWORK, TRACING),
    COSIMULATION: (FRAMEWORK, TRACING, SIMULATION),
    LINEAR: (FRAMEWORK, TRACING, SIMULATION),
    f"{LINEAR}.frequency": (FRAMEWORK, TRACING, SIMULATION, LIBRARY, LINEAR),
    f"{LINEAR}.uncertainty": (FRAMEWORK, LINEAR),
    ESTIMATION: (FRAMEWORK, TRACING, LIBRARY, LINEAR),
    DRAWING: (FRAMEWORK, TRACING),
    SWEEPS: (FRAMEWORK, TRACING, SIMULATION),
    FMU: (FRAMEWORK,),
    f"{FMU}.runtime": (FRAMEWORK,),
    f"{FMU}.importing": (FRAMEWORK, f"{FMU}.runtime"),
    f"{FMU}.exporting.description": (FRAMEWORK, TRACING, SIMULATION),
    f"{FMU}.exporting.native": EXPORTING,
    f"{FMU}.exporting.python": EXPORTING,
    f"{FMU}.exporting.plain_c": (*EXPORTING, f"{FMU}.exporting.native"),
    f"{FMU}.exporting": (
        *EXPORTING,
        *(f"{FMU}.exporting.{kind}" for kind in ("native", "python", "plain_c")),
    ),
    f"{FMU}.ssp": (
        FRAMEWORK,
        *(f"{FMU}.{room}" for room in ("runtime", "importing", "exporting", "exporting.description")),
    ),
    MODELS: (FRAMEWORK,),
    f"{MODELS}.reporting": ("trussflow.blocks", FRAMEWORK, SIMULATION),
    f"{MODELS}.geometry": (FRAMEWORK,),
    f"{MODELS}.truss": (FRAMEWORK, *PHYSICS[:1]),
    f"{MODELS}.robots": (FRAMEWORK, *PHYSICS[:2]),
    f"{MODELS}.dynamics": (FRAMEWORK, TRACING, *PHYSICS[:3]),
    f"{MODELS}.plant": (FRAMEWORK, TRACING, *PHYSICS[:4]),
    f"{MODELS}.hardware": (FRAMEWORK, LIBRARY, *PHYSICS),
    f"{MODELS}.feasibility": (FRAMEWORK, LIBRARY, *PHYSICS),
    f"{MODELS}.mean_axes": (FRAMEWORK, TRACING, LIBRARY, ESTIMATION, *PHYSICS),
    f"{MODELS}.viewer": (FRAMEWORK, *PHYSICS),
    f"{MODELS}.transport": (
        *BLOCKS,
        *PHYSICS,
        *(f"{MODELS}.{room}" for room in ("feasibility", "hardware", "mean_axes", "reporting", "viewer")),
    ),
    f"{MODELS}.modal_analysis": STUDY,
    f"{MODELS}.reproduction": STUDY,
    f"{MODELS}.flight": (
        *(*STUDY, SWEEPS),
        *(f"{MODELS}.{room}" for room in ("hardware", "mean_axes", "feasibility")),
    ),
}
MAX_LINES = 400

PACKAGE_FILES = sorted(
    path for folder in ("blocks", "models", "fmu") for path in (ROOT / folder).rglob("*.py")
)
ALL_FILES = PACKAGE_FILES + sorted(
    path for folder in ("tests", "examples") for path in (ROOT / folder).rglob("*.py")
)


def name_of(path):
    """Return the path from the repository root, as tests are named and messages say it."""
    return path.relative_to(ROOT).as_posix()


def module_of(path):
    """Return the import name of a file of one of the packages."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    own = parts[2:] if parts[:2] == ("blocks", "command") else parts  # the folder of the package itself
    return ".".join(("trussflow", *own)).removesuffix(".__init__")


MODULES = {module_of(path): path for path in PACKAGE_FILES}

over_all_files = pytest.mark.parametrize("path", ALL_FILES, ids=name_of)
over_package_files = pytest.mark.parametrize("path", PACKAGE_FILES, ids=name_of)


def imports_in(tree):
    """Return the modules imported anywhere in a file; `from p import m` gives p.m if m is ours."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            members = (f"{node.module}.{alias.name}" for alias in node.names)
            found.update(member if member in MODULES else node.module for member in members)
    return found


def runtime_imports_in(tree):
    """Return the modules imported when the code runs, not only when types are checked."""
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    return imports_in(tree)


def is_within(module, package):
    """Tell whether `module` is `package` or lies below it."""
    return f"{module}.".startswith(f"{package}.")


@over_all_files
def test_imports_are_absolute_and_under_the_namespace(path):
    tree = ast.parse(path.read_text())
    froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    relative = [node.lineno for node in froms if node.level]
    assert not relative, f"{name_of(path)}: relative imports in lines {relative}"
    folders = ("blocks", "models", "fmu")
    bare = {name for name in imports_in(tree) if name.split(".")[0] in folders}
    assert not bare, f"{name_of(path)} imports {bare}: say trussflow.blocks and so on"


def room_of(module):
    """Return the folder that a module lies in, as a package."""
    return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]


@over_package_files
def test_rooms_import_only_what_they_may(path):
    own = module_of(path)
    if path.name in ("__init__.py", "__main__.py"):
        top = ".".join(own.split(".")[:2])  # the command imports by name what it is asked for
        other = {MODELS, FMU, "trussflow.blocks"} - {top, "trussflow.blocks"}
        wrong = {n for n in imports_in(ast.parse(path.read_text())) if any(is_within(n, o) for o in other)}
        assert not wrong, f"{own} must not import {wrong}"
        return
    room = room_of(own)
    package = ".".join(room.split(".")[:2])  # its loose modules are for all its rooms
    allowed = {room, package, *ROOMS[room]}
    imported = {name for name in runtime_imports_in(ast.parse(path.read_text())) if name in MODULES}
    wrong = {name for name in imported if room_of(name) not in allowed}
    assert not wrong, f"{room} may import {ROOMS[room]}; {own} imports {wrong}"


def test_every_room_has_its_rule():
    rooms = {room_of(name) for name, path in MODULES.items() if path.name[:2] != "__"}
    assert set(ROOMS) == rooms


def test_no_module_imports_itself_in_a_circle():
    """At run time; a name that is needed for a type alone may come from anywhere."""
    graph = {
        name: {n for n in runtime_imports_in(ast.parse(path.read_text())) if n in MODULES and n != name}
        for name, path in MODULES.items()
    }
    TopologicalSorter(graph).prepare()  # raises CycleError, with the circle


def test_every_package_is_listed():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    packages = {module_of(path) for path in PACKAGE_FILES if path.name == "__init__.py"}
    assert set(settings["packages"]) == packages
    loose = {name_of(path) for path in PACKAGE_FILES if module_of(path.parent) not in packages}
    assert not loose, f"no __init__.py beside {loose}"


@over_all_files
def test_file_is_not_too_long(path):
    lines = len(path.read_text().splitlines())
    assert lines <= MAX_LINES, f"{name_of(path)} has {lines} lines; which could move out?"


# What compares numbers, and those of its tolerances that are not zero unless they are stated.
UNSTATED = {
    "assert_allclose": {"rtol"},
    "allclose": {"rtol", "atol"},
    "np.isclose": {"rtol", "atol"},
    "isclose": {"rel_tol"},
}


@over_all_files
def test_tolerances_are_stated(path):
    """What NumPy and math allow by default fits no case: write rtol=0 where only atol is meant."""
    faults = []
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        needed = UNSTATED.get(called) or UNSTATED.get(called.rpartition(".")[2], set())
        if missing := needed - {keyword.arg for keyword in node.keywords}:
            faults.append(f"line {node.lineno}: {called} without {', '.join(sorted(missing))}")
    assert not faults, f"{name_of(path)}: {'; '.join(faults)}"
