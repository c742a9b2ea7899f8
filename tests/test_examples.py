"""Rules about the examples: they are short, have a title, and run to their end in a folder of their own."""

import ast
import re
import runpy
import shutil
import subprocess
import sys

import pytest
from scripts import run
from sources import ROOT, tree_of

FOLDER = ROOT / "examples"
EXAMPLES = sorted(
    path
    for path in FOLDER.glob("**/*.py")
    if path.relative_to(FOLDER).parts[0] not in ("peers", "studies")
)
PEERS = sorted(
    [*FOLDER.glob("peers/*.py"), *(ROOT / "tests/peers").glob("*.py")],
    key=lambda path: path.name,
)
DATA = (".toml", ".urdf", ".bdf", ".op4")
ELSEWHERE = {
    *("02_linearize_and_margins", "03_sampled_control", "04_fmu"),
    *("05_thousands_of_runs", "identify_damping", "pid", "cosimulation"),
    *("antenna_mission", "ring_mission", "live_transport"),
    *("own_frame", "own_robot", "hardware"),
}
"""Examples of over 3 s whose functions other tests call. `make docs` runs them, as all examples."""
MAX_LINES = 60
MAX_TUTORIAL_LINES = 90
"""Tutorials are the numbered examples; they explain several steps."""
RUFF = (sys.executable, "-m", "ruff", "format", "--line-length", "110")


def code_lines(path):
    """Return the lines of code of a script in 110 columns, without blank lines, comments and docstrings."""
    text = subprocess.run(
        [*RUFF, "--stdin-filename", path, "-"],
        input=path.read_bytes(),
        stdout=subprocess.PIPE,
        check=True,
    ).stdout.decode()
    documented = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(
            node, ast.Module | ast.ClassDef | ast.FunctionDef
        ) and ast.get_docstring(node):
            documented.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    lines = enumerate(text.splitlines(), 1)
    return sum(
        k not in documented and line.strip()[:1] not in ("", "#") for k, line in lines
    )


def test_examples_are_short():
    limits = {
        path: MAX_TUTORIAL_LINES if path.parent == FOLDER else MAX_LINES
        for path in EXAMPLES + PEERS
    }
    assert [p.name for p, limit in limits.items() if code_lines(p) >= limit] == []


def test_examples_begin_with_a_title():
    titled = re.compile(r"(.+)\n(=+)\n\n\S")
    for path in EXAMPLES + PEERS:
        title = titled.match(ast.get_docstring(tree_of(path)) or "")
        assert title is not None, path.name
        assert len(title[1]) == len(title[2]), path.name


@pytest.mark.parametrize(
    "path",
    [path for path in EXAMPLES if path.stem not in ELSEWHERE],
    ids=lambda path: path.stem,
)
def test_example_runs(path, tmp_path):
    for data in path.parent.iterdir():
        if data.suffix in DATA:
            shutil.copy(data, tmp_path)
    run(path, tmp_path)


@pytest.mark.parametrize("path", PEERS, ids=lambda path: path.stem)
def test_other_peoples_system_agrees_as_it_asserts(path):
    runpy.run_path(str(path))


def test_table_of_other_peoples_systems_is_true():
    table = (ROOT / "docs" / "peers.md").read_text(encoding="utf-8")
    row = re.compile(
        r"^\| \[(\w+)\]\(\.\./(\w+/peers/\1\.py)\) \| (\d+) \| (\d+) \|", re.MULTILINE
    )
    rows = [
        (file, int(ours), int(theirs)) for _, file, ours, theirs in row.findall(table)
    ]
    assert [(file, ours) for file, ours, _ in rows] == [
        (path.relative_to(ROOT).as_posix(), code_lines(path)) for path in PEERS
    ]
    assert [name for name, ours, theirs in rows if ours > theirs] == []
