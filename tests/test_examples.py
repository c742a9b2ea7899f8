"""The examples stay short, and run to their end in a folder of their own."""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))
DATA = (".toml", ".urdf", ".bdf", ".op4")
NEEDS = {"32_antenna_mission": "pyyeti"}  # what is an extra
TIME_LIMIT = 300  # s; for what hangs, not for what is slow

over_examples = pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)


@over_examples
def test_example_is_short(path: Path) -> None:
    """What explains it, for the gallery, does not count, nor do blank lines."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()[ast.parse(text).body[0].end_lineno :]
    assert len([line for line in lines if line.strip() and not line.lstrip().startswith("#")]) < 60


@over_examples
def test_example_begins_with_a_title(path: Path) -> None:
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert said is not None
    title, line, blank, *text = said.splitlines()
    assert line == "=" * len(title)
    assert not blank
    assert text


@over_examples
def test_example_runs(path: Path, tmp_path: Path) -> None:
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem], reason="an extra that the example shows")
    run(path, tmp_path)


def run(script: Path, folder: Path) -> str:
    """Run a script in a folder and return what it prints."""
    for data in EXAMPLES[0].parent.iterdir():
        if data.suffix in DATA:
            shutil.copy(data, folder)
    # conftest.py has chosen a plotting back end without windows; the environment passes it on.
    done = subprocess.run(
        [sys.executable, script], cwd=folder, capture_output=True, text=True, timeout=TIME_LIMIT, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
