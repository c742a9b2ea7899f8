"""``trussflow new``: a file to start from."""

from __future__ import annotations

import argparse
from importlib.resources import files
from pathlib import Path

from trussflow.blocks.framework.command_line import ended, parser_of
from trussflow.blocks.framework.errors import DiagramError
from trussflow.blocks.framework.files import replaced


def parser(prog: str) -> argparse.ArgumentParser:
    """Return what reads the words behind `prog`, the command."""
    found = parser_of(
        prog,
        "Write a small closed loop with a block of its own, to be run, drawn, exported and changed.",
        "loop.py         # then: python loop.py",
    )
    found.add_argument("path", type=Path, help="file to write, named .py; it must not be there yet")
    return found


def new(options: argparse.Namespace) -> int:
    """Write the file that the `options` ask for; return the exit code."""
    path: Path = options.path
    if path.suffix != ".py" or not path.stem.isidentifier():
        raise DiagramError(f"cannot write '{path}': name it .py, and so that it can be imported")
    if path.exists():
        raise DiagramError(f"cannot write '{path}': it is there already; name another file")
    try:
        with replaced(path) as partial:
            partial.write_bytes(files("trussflow").joinpath("starter.py").read_bytes())
    except OSError as error:
        raise DiagramError(f"cannot write '{path}': {error}") from error
    print(f"{path}: run it with 'python {path}' or 'trussflow run {path}:loop 10'")
    return 0


def main(words: list[str], prog: str) -> int:
    """Run the command `prog` with these `words`; return the exit code."""
    options = parser(prog).parse_args(words)
    return ended(lambda: new(options))
