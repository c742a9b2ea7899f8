"""``trussflow``: what it offers, what its help says, how it ends, and what it writes."""

import argparse
import io
import json
import re
import shlex
import subprocess
import sys
import time
from contextlib import redirect_stderr
from importlib import import_module
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import trussflow
from trussflow.__main__ import COMMANDS, main
from trussflow.blocks import TransferFunction
from trussflow.blocks.support import progress
from trussflow.blocks.tracing import compiler
from trussflow.blocks.tracing.compile_cache import cache_folder
from trussflow.command_arguments import ended, json_of
from trussflow.fmu import export


@pytest.fixture
def loop(tmp_path):
    """Return what ``new`` wrote, as other commands call it."""
    path = tmp_path / "loop.py"
    assert main(["new", str(path)]) == 0
    return f"{path}:loop"


@pytest.fixture(scope="module")
def lag(tmp_path_factory):
    """Return the path of an FMU with one state."""
    return str(
        export(
            TransferFunction([3.0], [0.1, 1.0]),
            tmp_path_factory.mktemp("fmu") / "lag.fmu",
        )
    )


class Terminal(io.StringIO):
    """A terminal that keeps its text."""

    def isatty(self):
        return True


@pytest.mark.parametrize("name", COMMANDS)
def test_help_teaches_by_examples_that_parse(name, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([name, "--help"])
    assert stopped.value.code == 0
    text = capsys.readouterr().out
    examples = [
        line for line in text.partition("examples:\n")[2].splitlines() if line.strip()
    ]
    assert examples
    for line in examples:
        words = shlex.split(line, comments=True)
        assert words[:2] == ["trussflow", name]
        import_module(COMMANDS[name].module).parser("").parse_args(words[2:])


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit) as stopped:
        main([])
    text = capsys.readouterr().out
    assert stopped.value.code == 0
    assert all(
        f"  {name} " in text and command.does in text
        for name, command in COMMANDS.items()
    )


def test_version(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    version, cache = capsys.readouterr().out.splitlines()
    assert version == f"trussflow {trussflow.__version__}"
    assert re.fullmatch(
        rf"compiled code: [\d.]+ MB in {re.escape(str(cache_folder()))}", cache
    )
    assert trussflow.__version__[0].isdigit() or trussflow.__version__ == "unknown"


def test_the_package_says_where_things_are():
    with pytest.raises(
        AttributeError, match="write 'from trussflow\\.blocks import simulate'"
    ):
        trussflow.simulate  # noqa: B018


def test_completion_knows_commands_and_their_options(tmp_path, capsys):
    script = tmp_path / "completion"
    with pytest.raises(SystemExit):
        main(["--print-completion", "bash"])
    script.write_text(capsys.readouterr().out, encoding="utf-8")
    asked = "COMP_WORDS=(trussflow {}) COMP_CWORD={}; _shtab_trussflow; echo ${{COMPREPLY[@]}}"
    for words, number, found in (("f", 1, "fmu fly"), ("fly --pl", 2, "--plant")):
        bash = ["bash", "-c", f". {script}; {asked.format(words, number)}"]
        done = subprocess.check_output(bash, text=True)
        assert done.split() == found.split()


def test_new_loop_runs_by_itself(loop):
    script = [sys.executable, loop.removesuffix(":loop")]
    assert "pendulum.angle" in subprocess.check_output(script, text=True)


def test_run_gives_figures_file_and_picture(tmp_path, loop, capsys):
    capsys.readouterr()
    files = ["--output", str(tmp_path / "run.nc"), "--plot", str(tmp_path / "run.png")]
    assert (
        main(
            [
                "run",
                loop,
                "5",
                "--step",
                "0.01",
                "--log",
                "pendulum.angle",
                "--parameter",
                "pendulum.mass=2",
                "--json",
                *files,
            ]
        )
        == 0
    )
    (row,) = json.loads(capsys.readouterr().out)
    with xr.open_dataset(tmp_path / "run.nc") as result:
        angle = result["pendulum.angle"].values
        assert json.loads(result.attrs["parameters"])["pendulum.mass"] == [2.0]
    figures = {"end": angle[-1], "least": angle.min(), "greatest": angle.max()}
    assert row == {"signal": "pendulum.angle", "unit": "rad", **figures}
    assert (tmp_path / "run.png").read_bytes()[1:4] == b"PNG"


def test_run_of_an_fmu_under_an_input(lag, capsys):
    assert main(["run", lag, "5", "--input", "u=2", "--log", "block.y", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["end"] == pytest.approx(6.0, abs=1e-9)
    assert main(["run", lag, "5", "--input", "v=2"]) == 2
    assert "there is no input 'v'; there is u" in capsys.readouterr().err


def test_draw_gives_tree_and_picture(tmp_path, loop, capsys):
    assert main(["draw", loop]) == 0
    assert "└─ pendulum: Pendulum" in capsys.readouterr().out
    assert main(["draw", loop, str(tmp_path / "loop.svg")]) == 0
    assert (tmp_path / "loop.svg").read_text(encoding="utf-8").startswith("<svg")


@pytest.mark.usefixtures("ziglang")
def test_live_writes_a_page(tmp_path, loop, capsys):
    page = tmp_path / "loop.html"
    words = ["live", loop, "--save", str(page), "--duration", "2"]
    assert (
        main(
            [*words, "--parameters", "law.proportional_gain", "--at", "pendulum.torque"]
        )
        == 0
    )
    assert str(page) in capsys.readouterr().out
    assert "pendulum.torque" in page.read_text(encoding="utf-8")
    assert main([*words, "--signals", "pendulum.speed"]) == 2
    assert "no port 'speed'" in capsys.readouterr().err


def test_analyse_gives_modes_margins_and_picture(tmp_path, loop, capsys):
    """Law and pendulum at 0.5 rad: s^2 + (k_d s + k_p) / (m l^2) - g cos(0.5) / l."""
    gravity = 9.81 / 0.5 * np.cos(0.5)
    omega = np.sqrt(20.0 / 0.25 - gravity)
    assert (
        main(
            [
                "analyse",
                loop,
                "--at",
                "pendulum.torque",
                "--plot",
                str(tmp_path / "loop.png"),
            ]
        )
        == 0
    )
    assert (tmp_path / "loop.png").stat().st_size > 0
    gain = 20.0 * np.log10(gravity / 80.0)
    assert f"pendulum/torque  {gain:.1f} to inf dB" in capsys.readouterr().out
    assert main(["analyse", loop, "--at", "pendulum.torque", "--json"]) == 0
    (mode,) = json.loads(capsys.readouterr().out)["modes"]
    assert mode["frequency"] == pytest.approx(omega / (2 * np.pi), rel=1e-9)
    assert mode["damping_ratio"] == pytest.approx(3.0 / 0.25 / (2 * omega), rel=1e-9)


def test_fmu_tells_what_it_holds(lag, capsys):
    assert main(["fmu", "inspect", lag]) == 0
    assert "FMI 2" in capsys.readouterr().out
    assert main(["fmu", "inspect", lag, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["u"] == ["u"]


@pytest.mark.filterwarnings("ignore:simulations run in CasADi")
def test_fly_prints_its_summary_as_json(tmp_path, capsys, monkeypatch):
    # a short run does not pay for compiling
    monkeypatch.setattr(compiler, "find_compiler", lambda: None)
    # takes seconds
    monkeypatch.setattr("trussflow.models.transport.__main__.draw", lambda *_: None)
    words = ["fly", "--duration", "0.1", "--json", "--output", str(tmp_path)]
    assert main(words) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads(
        (tmp_path / "summary.json").read_text(encoding="utf-8")
    )
    assert json.loads(said.out)["run"]["command"] == f"trussflow {shlex.join(words)}"
    assert "index.html" in said.err


ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    "words, fact",
    [
        ("new {0}/other.py --json", ("file", "{0}/other.py")),
        ("draw {1} --json", ("wires.0.1", "law.reference_position")),
        ("draw {1} {0}/loop.svg --json", ("file", "{0}/loop.svg")),
        ("fmu export {1} {0}/loop.fmu --json", ("file", "{0}/loop.fmu")),
        ("fmu --json export {1} {0}/loop.fmu", ("file", "{0}/loop.fmu")),
        ("fly --explain --json", ("0.place", "transport.toml")),
    ],
)
def test_every_command_tells_its_facts_as_json_and_nothing_else(
    words, fact, tmp_path, loop, capsys
):
    with Path(loop.removesuffix(":loop")).open("a", encoding="utf-8") as script:
        script.write("\nprint('a word of the user')\n")
    capsys.readouterr()
    code = main([word.format(tmp_path, loop, ROOT / "docs") for word in words.split()])
    said = capsys.readouterr()
    found, (place, expected) = json.loads(said.out), fact
    assert ("a word of the user" in said.err) == ("{1}" in words)
    for step in place.split("."):
        found = found[int(step) if step.isdigit() else step]
    assert found if expected is None else found == expected.format(tmp_path)
    assert code in (0, 1)


def test_a_reader_that_has_enough_gets_no_traceback():
    command = [
        sys.executable,
        "-m",
        "trussflow",
        "draw",
        "trussflow.starter:loop",
        "--json",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 1


def test_json_has_no_numbers_that_other_programs_do_not_know():
    thing = {
        "a": np.array([1.0, np.nan]),
        "b": [float("inf"), np.int64(2), True, None],
        3: Path("x"),
    }
    assert json.loads(json_of(thing)) == {
        "a": [1.0, None],
        "b": [None, 2, True, None],
        "3": "x",
    }


def code_of(words):
    """Return the exit code of the command."""
    try:
        return main(words)
    except SystemExit as stopped:
        return stopped.code


@pytest.mark.usefixtures("loop")
@pytest.mark.parametrize(
    "words, message",
    [
        ("nonsense", "invalid choice: 'nonsense'"),
        ("new loop.py", "cannot write 'loop.py': it exists already"),
        (
            "new no-name.py",
            "its name must end with .toml, or be a module name with .py",
        ),
        ("draw trussflow.blocks:Integrator block.svg", "not a diagram"),
        (
            "analyse trussflow.blocks:Integrator --at u",
            "it is a single block, not a diagram",
        ),
        (
            "run loop.py:loop 1 --parameter pendulum.mass=heavy",
            "write name=number, or name=[number, number]",
        ),
        ("run loop.py:loop long", "invalid float value: 'long'"),
        ("run gone.py:x 1", "cannot import 'gone.py'"),
        ("run broken.py:x 1", "invalid syntax (broken.py, line 1)"),
        ("run loop.py:lop 1", "'loop.py:lop': there is no 'lop'; did you mean 'loop'?"),
        (
            "run loop.py:loop 1 --plot loop.txt",
            "use .png, .svg, .pdf in an existing folder",
        ),
        (
            "run loop.py:loop 1 --plot gone/loop.png",
            "use .png, .svg, .pdf in an existing folder",
        ),
        (
            "run loop.py:loop 1 --log pendulum.angel",
            "has no port 'angel'; inputs: torque; outputs: angle, rate",
        ),
        ("view gone.nc", "cannot show 'gone.nc': No such file"),
        ("view loop.py", "cannot show 'loop.py': it is not a complete netCDF file"),
    ],
)
def test_misuse_ends_with_its_code_and_one_message(
    words, message, tmp_path, capsys, monkeypatch
):
    (tmp_path / "broken.py").write_text("def x(:")
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()
    assert code_of(words.split()) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert "error: " in error
    assert message in error


def test_ctrl_c_ends_with_its_code(capsys):
    def stopped(_):
        raise KeyboardInterrupt

    assert ended(stopped, argparse.Namespace(json=False)) == 130
    assert "stopped" in capsys.readouterr().err


@pytest.mark.parametrize("plain", ["", "1"])
def test_colours_are_for_terminals_only(plain, monkeypatch):
    monkeypatch.setenv("NO_COLOR", plain)
    with redirect_stderr(Terminal()) as terminal:
        main(["run", "gone.py:x", "1"])
    assert ("\033[31merror:\033[0m" in terminal.getvalue()) == (not plain)


def test_work_is_reported_with_the_time_left(monkeypatch):
    monkeypatch.setattr("tqdm.std.time", count(0.0, 1.0).__next__)
    with redirect_stderr(Terminal()) as terminal:
        for _ in progress.counted("drawing", range(40)):
            pass
    assert re.search(r"drawing: +\d+%.* \d+/40 \[\d+:\d+<\d+:\d+", terminal.getvalue())


def test_long_work_is_named_and_its_line_cleared(monkeypatch):
    monkeypatch.setattr(progress, "DISPLAY_DELAY", 0.01)
    with redirect_stderr(Terminal()) as terminal, progress.status_line("writing"):
        time.sleep(0.5)
    assert terminal.getvalue() == "\r\033[Kwriting ...\r\033[K"


def test_quick_work_is_not_reported():
    with redirect_stderr(Terminal()) as terminal, progress.status_line("compiling"):
        pass
    assert terminal.getvalue() == ""


def test_work_is_reported_on_terminals_only(monkeypatch, capsys):
    monkeypatch.setattr(progress, "DISPLAY_DELAY", 0.01)
    for _ in progress.counted("drawing", range(2)):
        time.sleep(0.05)
    assert capsys.readouterr().err == ""
