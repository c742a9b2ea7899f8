"""Rules about the source files: imports between packages, the packages listed, faults that can be planted."""

import ast
from graphlib import TopologicalSorter

from planted_faults import FAULTS
from sources import (
    ALL_FILES,
    MODULES,
    PACKAGE_FILES,
    ROOT,
    SETUPTOOLS,
    module_of,
    place,
    tree_of,
)

# Packages that the modules of a package may import, besides their own, `blocks.errors`, `blocks.support` and
# the loose modules of their top package. `__init__` and `__main__` may import everything below them.
(
    FRAMEWORK,
    TRACING,
    RESULTS,
    SIMULATION,
    LIBRARY,
    COSIMULATION,
    LINEAR,
    CONTROL,
    DRAWING,
    LIVE,
    SWEEPS,
    TESTING,
) = (
    f"trussflow.blocks.{name}"
    for name in (
        *(
            "framework",
            "tracing",
            "results",
            "simulation",
            "library",
            "cosimulation",
            "linear_analysis",
        ),
        *("control", "drawing", "live", "sweeps", "testing"),
    )
)
BLOCKS = (
    FRAMEWORK,
    TRACING,
    SIMULATION,
    LIBRARY,
    COSIMULATION,
    LINEAR,
    f"{LINEAR}.frequency",
    CONTROL,
)
ERRORS, SUPPORT = "trussflow.blocks.errors", "trussflow.blocks.support"
FMU, MODELS = "trussflow.fmu", "trussflow.models"
PHYSICS = tuple(
    f"{MODELS}.{name}" for name in ("geometry", "truss", "robots", "dynamics", "plant")
)
EXPORTING = (FRAMEWORK, TRACING, RESULTS, SIMULATION, f"{FMU}.exporting.description")
PACKAGES = {
    "trussflow": (
        *(FRAMEWORK, RESULTS, SIMULATION, LIBRARY, LINEAR, DRAWING, SWEEPS),
        "trussflow.blocks",
        f"{FMU}.importing",
    ),
    "trussflow.blocks": (),
    SUPPORT: (),
    FRAMEWORK: (),
    RESULTS: (FRAMEWORK,),
    TRACING: (FRAMEWORK,),
    SIMULATION: (FRAMEWORK, RESULTS, TRACING),
    LIBRARY: (FRAMEWORK, TRACING),
    COSIMULATION: (FRAMEWORK, RESULTS, TRACING, SIMULATION),
    LINEAR: (FRAMEWORK, TRACING, SIMULATION, LIBRARY),
    f"{LINEAR}.frequency": (FRAMEWORK, TRACING, SIMULATION, LIBRARY, LINEAR),
    f"{LINEAR}.uncertainty": (FRAMEWORK, LINEAR),
    CONTROL: (FRAMEWORK, TRACING, LIBRARY, LINEAR),
    DRAWING: (FRAMEWORK, TRACING),
    LIVE: (FRAMEWORK, RESULTS, TRACING, SIMULATION, LINEAR),
    SWEEPS: (FRAMEWORK, RESULTS, TRACING, SIMULATION),
    TESTING: (FRAMEWORK, TRACING, SIMULATION, LINEAR),
    FMU: (FRAMEWORK,),
    f"{FMU}.runtime": (FRAMEWORK, RESULTS, SIMULATION),
    f"{FMU}.importing": (FRAMEWORK, f"{FMU}.runtime"),
    f"{FMU}.exporting.description": (FRAMEWORK, TRACING, RESULTS, SIMULATION, LIBRARY),
    f"{FMU}.exporting.native": EXPORTING,
    f"{FMU}.exporting.python": EXPORTING,
    f"{FMU}.exporting.plain_c": (*EXPORTING, f"{FMU}.exporting.native"),
    f"{FMU}.exporting": (
        *EXPORTING,
        *(f"{FMU}.exporting.{kind}" for kind in ("native", "python", "plain_c")),
    ),
    f"{FMU}.ssp": (
        FRAMEWORK,
        *(
            f"{FMU}.{name}"
            for name in ("runtime", "importing", "exporting", "exporting.description")
        ),
    ),
    MODELS: (FRAMEWORK,),
    f"{MODELS}.reporting": ("trussflow.blocks", FRAMEWORK, SIMULATION),
    f"{MODELS}.geometry": (FRAMEWORK,),
    f"{MODELS}.truss": (FRAMEWORK, *PHYSICS[:1]),
    f"{MODELS}.robots": (FRAMEWORK, *PHYSICS[:2]),
    f"{MODELS}.dynamics": (FRAMEWORK, TRACING, *PHYSICS[:3]),
    f"{MODELS}.plant": (FRAMEWORK, TRACING, *PHYSICS[:4]),
    f"{MODELS}.hardware": (FRAMEWORK, LIBRARY, *PHYSICS),
    f"{MODELS}.feasibility": (FRAMEWORK, CONTROL, *PHYSICS),
    f"{MODELS}.mean_axes": (FRAMEWORK, TRACING, LIBRARY, CONTROL, *PHYSICS),
    f"{MODELS}.viewer": (FRAMEWORK, RESULTS, LIVE, *PHYSICS),
    f"{MODELS}.transport": (
        *BLOCKS,
        *PHYSICS,
        *(
            f"{MODELS}.{name}"
            for name in ("feasibility", "hardware", "mean_axes", "reporting", "viewer")
        ),
    ),
}

# Arguments that must be stated in comparisons of numbers, since the defaults of NumPy and math fit no case.
TOLERANCES = {
    "assert_allclose": {"rtol"},
    "allclose": {"rtol", "atol"},
    "np.isclose": {"rtol", "atol"},
    "isclose": {"rel_tol"},
}


def import_nodes(tree):
    """Yield (line, module) of each import; `from p import m` gives p.m if that is a module of ours."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                member = f"{node.module}.{alias.name}"
                yield (
                    node.lineno,
                    member
                    if member in MODULES
                    else "." * node.level + (node.module or ""),
                )


def runtime_imports(path):
    """Return the modules of ours that a file imports when it runs, not for types alone."""
    typing_only = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            typing_only.update(range(node.lineno, node.end_lineno + 1))
    imports = import_nodes(tree_of(path))
    return {
        name for line, name in imports if name in MODULES and line not in typing_only
    }


def package_of(module):
    """Return the package that a module lies in."""
    return (
        module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]
    )


def top_of(module):
    """Return the top package of a module: trussflow.blocks, trussflow.models or trussflow.fmu."""
    return ".".join(module.split(".")[:2])


def test_imports_are_absolute_and_under_the_namespace():
    wrong = [
        f"{place(path, line)} imports {name or '.'}"
        for path in ALL_FILES
        for line, name in import_nodes(tree_of(path))
        if name.split(".")[0] in ("", "blocks", "models", "fmu")
    ]
    assert wrong == []


def test_packages_import_only_what_they_may():
    wrong = []
    for module, path in MODULES.items():
        imported = runtime_imports(path)
        if path.name in ("__init__.py", "__main__.py"):
            forbidden = {MODELS, FMU} - {top_of(module)}
            wrong += [
                f"{module} imports {name}"
                for name in imported
                if top_of(name) in forbidden
            ]
        else:
            package = package_of(module)
            allowed = {package, top_of(package), ERRORS, SUPPORT, *PACKAGES[package]}
            wrong += [
                f"{module} imports {name}"
                for name in imported
                if {name, package_of(name)}.isdisjoint(allowed)
            ]
    assert wrong == []


def test_every_package_has_its_rule():
    assert set(PACKAGES) == {
        package_of(name) for name, path in MODULES.items() if path.name[:2] != "__"
    }


def test_no_module_imports_itself_in_a_circle():
    graph = {name: runtime_imports(path) - {name} for name, path in MODULES.items()}
    TopologicalSorter(graph).prepare()  # raises CycleError, with the circle


def test_every_package_is_listed():
    packages = {module_of(path) for path in PACKAGE_FILES if path.name == "__init__.py"}
    assert set(SETUPTOOLS["packages"]) == packages
    assert [
        path for path in PACKAGE_FILES if module_of(path.parent) not in packages
    ] == []


def test_planted_faults_fit_the_code():
    """The campaign of CI plants every eighth of them only."""
    wrong = [
        f"{fault.file}: {fault.old}"
        for fault in FAULTS
        if (ROOT / fault.file).read_text(encoding="utf-8").count(fault.old) != 1
    ]
    assert wrong == []


def test_tolerances_are_stated():
    """Write rtol=0 where only atol is meant."""
    wrong = []
    for path in ALL_FILES:
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                needed = TOLERANCES.get(
                    called, TOLERANCES.get(called.rpartition(".")[2], set())
                )
                if needed - {keyword.arg for keyword in node.keywords}:
                    wrong.append(
                        f"{place(path, node.lineno)}: {called} without {', '.join(needed)}"
                    )
    assert wrong == []
