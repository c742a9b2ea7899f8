"""FMUs made for the tests: packed from model.c and a model description written here."""

import subprocess
import zipfile
from pathlib import Path

import fmpy
import pytest

from trussflow.blocks.tracing.compiler import find_compiler

HEADERS = Path(fmpy.__file__).parent / "c-code"
SOURCE = Path(__file__).with_name("model.c")

# Name, type, value reference, causality, variability, further attributes.
COMMON = [
    ("fault", "Integer", 1, "parameter", "fixed", 'start="0"'),
    ("hmax", "Real", 10, "parameter", "tunable", 'start="1e9"'),
    ("text", "String", 0, "parameter", "fixed", 'start="nothing"'),
]
VARIABLES = {
    "ball": [
        ("h", "Real", 0, "output", "continuous", 'initial="exact" start="1" unit="m"'),
        ("v", "Real", 1, "local", "continuous", 'initial="exact" start="0" unit="m/s"'),
        ("der(h)", "Real", 2, "local", "continuous", 'unit="m/s"'),
        ("der(v)", "Real", 3, "local", "continuous", 'unit="m/s2"'),
        ("g", "Real", 4, "parameter", "tunable", 'start="9.81" unit="m/s2"'),
        ("e", "Real", 5, "parameter", "fixed", 'start="0.7"'),
        ("bounces", "Integer", 0, "output", "discrete", ""),
    ],
    "stair": [
        ("y", "Real", 8, "output", "discrete", ""),
        ("period", "Real", 9, "parameter", "fixed", 'start="0.35" unit="s"'),
    ],
    "relay": [
        ("x", "Real", 0, "output", "continuous", 'initial="exact" start="0"'),
        ("der(x)", "Real", 2, "local", "continuous", ""),
        ("u", "Real", 6, "input", "continuous", 'start="0"'),
        ("d", "Real", 7, "input", "discrete", 'start="0"'),
    ],
    "types": [
        ("u", "Real", 6, "input", "continuous", 'start="0" unit="N.m"'),
        ("number", "Integer", 2, "input", "discrete", 'start="0"'),
        ("flag", "Boolean", 0, "input", "discrete", 'start="false"'),
        ("y", "Real", 8, "output", "continuous", 'unit="N.m"'),
        ("next", "Integer", 3, "output", "discrete", ""),
        ("inverse", "Boolean", 1, "output", "discrete", ""),
    ],
}
STATES = {"ball": ["h", "v"], "relay": ["x"]}
INDICATORS = {"ball": 1, "relay": 1}
ARRAYS = """
<UInt64 name="n" valueReference="20" causality="structuralParameter" variability="fixed" start="3"/>
<Float64 name="in" valueReference="100" causality="input" start="0 0 0"><Dimension valueReference="20"/></Float64>
<Float64 name="out" valueReference="101" causality="output"><Dimension valueReference="20"/></Float64>
<Float64 name="gains" valueReference="102" causality="parameter" variability="fixed" start="2 2 2"><Dimension valueReference="20"/></Float64>
"""  # noqa: E501
UNITS = """<UnitDefinitions>
<Unit name="m"><BaseUnit m="1"/></Unit>
<Unit name="s"><BaseUnit s="1"/></Unit>
<Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>
<Unit name="m/s2"><BaseUnit m="1" s="-2"/></Unit>
<Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit>
</UnitDefinitions>"""
OFFSETS3 = {"Real": 0, "Integer": 200, "Boolean": 300, "String": 400}
TYPES3 = {
    "Real": "Float64",
    "Integer": "Int32",
    "Boolean": "Boolean",
    "String": "String",
}

FLAGS2 = 'canGetAndSetFMUstate="true" canSerializeFMUstate="true"'
FLAGS3 = 'canGetAndSetFMUState="true" canSerializeFMUState="true"'


def _scalar2(variable):
    name, kind, reference, causality, variability, rest = variable
    initial = 'initial="exact"' if 'initial="exact"' in rest else ""
    rest = rest.replace('initial="exact"', "")
    if name.startswith("der("):
        rest += ' derivative="{index}"'
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}" {initial}><{kind} {rest}/></ScalarVariable>'
    )


def _scalar3(variable):
    name, kind, reference, causality, variability, rest = variable
    # unlike in FMI 2, all types share one set of references
    reference += OFFSETS3[kind]
    head = (
        f'<{TYPES3[kind]} name="{name}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}"'
    )
    if kind == "String":
        return f'{head}><Start value="nothing"/></String>'
    if name.startswith("der("):
        rest += f' derivative="{reference - 2}"'
    return f"{head} {rest}/>"


def description(model, version, kinds, flags=""):
    """Return a model description."""
    variables = VARIABLES[model] + COMMON
    names = [v[0] for v in variables]
    outputs = [v for v in variables if v[3] == "output"]
    tags = {"cs": "CoSimulation", "me": "ModelExchange"}
    own = FLAGS2 if version == 2 else FLAGS3
    step = 'canHandleVariableCommunicationStepSize="true"'
    done = 'needsCompletedIntegratorStep="true"' if version == 3 else ""
    offers = "".join(
        f'<{tags[k]} modelIdentifier="model" {own} {f"{step} {flags}" if k == "cs" else done}/>'
        for k in kinds
    )
    states = STATES.get(model, [])
    depends = {
        "x": [],
        "h": [],
        "y": ["u"],
        "next": ["number"],
        "inverse": ["flag"],
        "bounces": [],
    }
    if model == "stair":
        depends["y"] = []
    if version == 2:
        listed = "".join(
            _scalar2(v).replace(
                "{index}", str(names.index(v[0][4:-1]) + 1 if v[0][:4] == "der(" else 0)
            )
            for v in variables
        )
        structure = (
            "<Outputs>"
            + "".join(
                f'<Unknown index="{names.index(v[0]) + 1}" dependencies="'
                f'{" ".join(str(names.index(d) + 1) for d in depends[v[0]])}"/>'
                for v in outputs
            )
            + "</Outputs>"
        )
        if states:
            structure += (
                "<Derivatives>"
                + "".join(
                    f'<Unknown index="{names.index(f"der({s})") + 1}"/>' for s in states
                )
                + "</Derivatives>"
            )
        token, fmi = "guid", "2.0"
        head = f'numberOfEventIndicators="{INDICATORS.get(model, 0)}"'
    else:
        references = {v[0]: v[2] + OFFSETS3[v[1]] for v in variables}
        listed = "".join(map(_scalar3, variables)) + (
            ARRAYS if model == "types" else ""
        )
        if model in INDICATORS:
            listed += '<Float64 name="z" valueReference="50" causality="local"/>'
        structure = "".join(
            f'<Output valueReference="{references[v[0]]}" dependencies="'
            f'{" ".join(str(references[d]) for d in depends[v[0]])}"/>'
            for v in outputs
        )
        if model == "types":
            structure += '<Output valueReference="101" dependencies="100"/>'
        structure += "".join(
            f'<ContinuousStateDerivative valueReference="{references[f"der({s})"]}"/>'
            for s in states
        )
        if model in INDICATORS:
            structure += '<EventIndicator valueReference="50"/>'
        token, fmi, head = "instantiationToken", "3.0", ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{fmi}" '
        f'modelName="{model}" {token}="{model}" {head}>{offers}{UNITS}'
        f"<ModelVariables>{listed}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>"
    )


def compiled(folder, *flags):
    """Return the compiled model, for both versions of FMI."""
    compiler = find_compiler()
    if compiler is None:
        pytest.skip("needs a C compiler")
    found = {}
    for version, choice in ((2, "-DFMI2"), (3, "-DFMI3")):
        library = folder / f"model{version}.so"
        always = (
            "-O1",
            "-fPIC",
            "-shared",
            f"-I{HEADERS}",
            str(SOURCE),
            "-o",
            str(library),
            "-lm",
        )
        subprocess.run([*compiler, choice, *flags, *always], check=True)
        found[version] = library.read_bytes()
    return found


@pytest.fixture(params=[2, 3])
def version(request):
    """Return each version of FMI in turn."""
    return request.param


@pytest.fixture(params=["cs", "me"])
def kind(request):
    """Return each kind of FMU in turn."""
    return request.param


@pytest.fixture(scope="session")
def binaries(tmp_path_factory):
    """Return the compiled model, for both versions of FMI."""
    return compiled(tmp_path_factory.mktemp("model"))


@pytest.fixture(scope="session")
def hostile_binaries(tmp_path_factory):
    """Return files of FMUs that do what ``misdeeds.h`` says, by their names: those of both versions."""
    made = compiled(tmp_path_factory.mktemp("hostile"), "-DHOSTILE")
    return {binary_name(version): content for version, content in made.items()}


def binary_name(version):
    """Return where the binary belongs in an FMU."""
    folder = fmpy.platform if version == 2 else fmpy.platform_tuple
    return f"binaries/{folder}/model{fmpy.sharedLibraryExtension}"


@pytest.fixture
def make_fmu(binaries, tmp_path):
    """Return a function that writes an FMU: model, version, kinds, flags, changes of the XML."""

    def make(model, version=2, kinds=("cs", "me"), flags="", replace=None, more=None):
        text = description(model, version, kinds, flags)
        for old, new in (replace or {}).items():
            assert old in text, f"{old} is not in {text}"
            text = text.replace(old, new)
        files = {
            "modelDescription.xml": text,
            binary_name(version): binaries[version],
            **(more or {}),
        }
        path = tmp_path / f"{model}{version}.fmu"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in files.items():
                if content is not None:
                    archive.writestr(name, content)
        return path

    return make


@pytest.fixture(scope="session")
def children():
    """Return a function that lists the child processes of this one."""
    return lambda: {
        p
        for f in Path("/proc/self/task").glob("*/children")
        for p in f.read_text().split()
    }


@pytest.fixture(autouse=True)
def nothing_left(tmp_path, monkeypatch):
    """Check that no test leaves unpacked files behind."""
    import tempfile

    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    yield
    left = [p for p in scratch.glob("trussflow-*/*") if p.name != "lock"]
    assert not left, f"left on disk: {left}"
