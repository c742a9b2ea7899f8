"""Samples in the documents print what their comments state, and commands in them work."""

import re
import shlex
import subprocess
import sys
from importlib import import_module

import pytest
from documents import COMMANDS, SAMPLES
from scripts import run

import trussflow.__main__
from trussflow.blocks import Block, Input, Output, Parameter, State, TransferFunction
from trussflow.fmu import export

PRINTED = re.compile(r"^print\(.*  # (.*)$", re.MULTILINE)
LONG = ("fly", "fmu export trussflow.models")
"""Beginnings of commands that simulate or compile a truss for long."""


class Pump(Block):
    """The FMU of a sample: y = p u, and its integral."""

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
    export(TransferFunction([1.0], [1.0, 0.2, 4.0]), folder / "plant.fmu")
    export(Pump(), folder / "pump.fmu")
    return folder


@pytest.mark.parametrize("text", SAMPLES.values(), ids=SAMPLES)
def test_sample_prints_what_its_comments_state(text, folder):
    script = folder / "sample.py"
    script.write_text(text, encoding="utf-8")
    assert run(script, folder).splitlines() == PRINTED.findall(text)


@pytest.mark.parametrize(
    "line", [line for line in COMMANDS if not line.startswith("make ")]
)
def test_command_in_a_shell_works(line, tmp_path):
    """Commands that take long or need the network are only parsed."""
    program, *arguments = shlex.split(line, comments=True)
    if re.fullmatch(r"(\.venv/bin/)?trussflow", program):
        arguments = ["-m", "trussflow", *arguments]
    else:
        assert re.fullmatch(r"(\.venv/bin/)?python3?", program)
    assert arguments[0] == "-m"
    module, *options = arguments[1:]
    if module in ("venv", "pip"):
        subprocess.run(
            [sys.executable, *arguments, "--help"], capture_output=True, check=True
        )
    elif " ".join(options).startswith(LONG):
        command = import_module(trussflow.__main__.COMMANDS[options[0]].module)
        command.parser("").parse_args(options[1:])
    else:
        run(module, tmp_path, options)
