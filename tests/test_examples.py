"""The examples stay short, and run to their end in a folder of their own."""

import ast
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))
PEERS = sorted((ROOT / "examples" / "peers").glob("[0-9]*.py"))
DATA = (".toml", ".urdf", ".bdf", ".op4")
NEEDS = {"32_antenna_mission": "pyyeti"}  # what is an extra
TIME_LIMIT = 300  # s; for what hangs, not for what is slow

over_examples = pytest.mark.parametrize("path", [*EXAMPLES, *PEERS], ids=lambda path: path.stem)


@over_examples
def test_example_is_short(path):
    """What explains it, for the gallery, does not count, nor do blank lines."""
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()[ast.parse(text).body[0].end_lineno :]
    assert len([line for line in lines if line.strip() and not line.lstrip().startswith("#")]) < 60


@over_examples
def test_example_begins_with_a_title(path):
    said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert said is not None
    title, line, blank, *text = said.splitlines()
    assert line == "=" * len(title)
    assert not blank
    assert text


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(path, tmp_path):
    if path.stem in NEEDS:
        pytest.importorskip(NEEDS[path.stem], reason="an extra that the example shows")
    run(path, tmp_path)


@pytest.mark.parametrize("path", PEERS, ids=lambda path: path.stem)
def test_other_peoples_system_agrees_as_it_asserts(path):
    """In this process: most of what a small script takes is to import libraries."""
    runpy.run_path(str(path))


def code_lines(path):
    """Return how many lines of code a script has: no blank lines, comments and docstrings."""
    text = path.read_text(encoding="utf-8")
    said: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            said.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines = enumerate(text.splitlines(), 1)
    return sum(k not in said and bool(line.strip()) and line.strip()[0] != "#" for k, line in lines)


def test_table_of_other_peoples_systems_is_true():
    table = (ROOT / "docs" / "peers.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| \[(\d\d_\w+)\]\(gallery/peers/\1\.rst\) \| (\d+) \| (\d+) \|", table, flags=re.MULTILINE
    )
    assert [(name, int(ours)) for name, ours, _ in rows] == [(path.stem, code_lines(path)) for path in PEERS]
    assert [name for name, ours, theirs in rows if int(ours) > int(theirs)] == []


def run(script, folder):
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
