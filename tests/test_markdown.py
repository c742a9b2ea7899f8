"""What the Markdown files show is true: samples run and print what they say, commands exist."""

import importlib
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import trussflow.__main__
from trussflow.blocks import Block, Input, Output, Parameter, State, TransferFunction
from trussflow.fmu import export

ROOT = Path(__file__).parents[1]
FOLDERS = ("blocks", "models", "fmu", "docs", "examples")
MADE = ROOT / "docs" / "rooms"  # copies of these files, for the site
FILES = [
    *(ROOT / "README.md", ROOT / "CONTRIBUTING.md"),
    *sorted(
        path for folder in FOLDERS for path in (ROOT / folder).rglob("*.md") if not path.is_relative_to(MADE)
    ),
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAYS = re.compile(r"^print\(.*  # (.*)$", re.MULTILINE)
PYTHON, SHELL, PICTURE = ("python", "py"), "sh", ""
LONG = ("analyse", "reproduce")  # take minutes
TIME_LIMIT = 300  # s; for what hangs, not for what is slow


def fences(path):
    """Return language and text of what is set apart as code in a file."""
    return FENCE.findall(path.read_text(encoding="utf-8"))


SAMPLES = {
    f"{path.relative_to(ROOT).as_posix()}-{number}": text
    for path in FILES
    for number, (language, text) in enumerate(fences(path), start=1)
    if language in PYTHON
}
COMMANDS = sorted(
    {
        line
        for path in FILES
        for language, text in fences(path)
        if language == SHELL
        for line in text.splitlines()
        if line.strip()
    }
)


def test_fences_are_of_languages_that_are_checked_here():
    found = {language for path in FILES for language, _ in fences(path)}
    assert found <= {*PYTHON, SHELL, PICTURE}
    assert SAMPLES
    assert COMMANDS


class Pump(Block):
    """The FMU of a sample: what it pumps follows its valve."""

    opening = Input(unit="1")
    flow = Output(unit="m**3/s")
    pumped = State(unit="m**3")
    speed = Parameter(1.0, unit="rad/s")

    def output(self, t, x, u, p):
        return {"flow": p.speed * u.opening}

    def derivative(self, t, x, u, p):
        return {"pumped": p.speed * u.opening}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the FMUs that the samples read."""
    folder = tmp_path_factory.mktemp("samples")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRUSSFLOW_CACHE", str(folder / "compiled"))
        export(TransferFunction([1.0], [1.0, 0.2, 4.0]), folder / "plant.fmu")
        export(Pump(), folder / "pump.fmu")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("text", SAMPLES.values(), ids=SAMPLES)
def test_sample_runs_and_prints_what_it_says(text, folder):
    """What a line prints stands in the comment behind it."""
    script = folder / "sample.py"
    script.write_text(text, encoding="utf-8")
    assert run([sys.executable, str(script)], folder).splitlines() == SAYS.findall(text)


@pytest.mark.slow
@pytest.mark.parametrize("line", COMMANDS)
def test_command_in_a_shell_works(line, tmp_path):
    """Or, where it would take long or needs the network, that it exists and parses."""
    words = shlex.split(line, comments=True)
    program, *arguments = words
    if program == "make":
        run(["make", "--dry-run", *arguments], ROOT)
        return
    if re.fullmatch(r"(\.venv/bin/)?trussflow", program):
        arguments = ["-m", "trussflow", *arguments]
    else:
        assert re.fullmatch(r"(\.venv/bin/)?python3?", program)
    assert arguments[0] == "-m"
    module, *options = arguments[1:]
    if module in ("venv", "pip"):
        run([sys.executable, *arguments, "--help"], tmp_path)
    elif module == "trussflow" and options[0] in LONG:
        importlib.import_module(trussflow.__main__.COMMANDS[options[0]].module).parser("").parse_args(
            options[1:]
        )
    else:
        run([sys.executable, *arguments], tmp_path)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_commands_within_sentences_exist(path):
    text = path.read_text(encoding="utf-8")
    for target in set(re.findall(r"`make ([\w-]+)", text)):
        run(["make", "--dry-run", target], ROOT)
    for module in set(re.findall(r"`python3? -m ([\w.]+)", text)):
        spec = find_spec(module)
        assert spec is not None, module
        if spec.submodule_search_locations is None:  # a module by itself
            assert "if __name__ ==" in Path(str(spec.origin)).read_text(encoding="utf-8"), module
        else:
            assert find_spec(f"{module}.__main__"), module


def run(command, folder):
    """Run a command in a folder and return what it prints."""
    # conftest.py has chosen a plotting back end without windows; the environment passes it on.
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
