"""``trussflow``, or ``python -m trussflow``: one command for all that can be done without writing code."""

from __future__ import annotations

import argparse
import gc
import importlib
import sys
from typing import Any, NamedTuple

import shtab

from trussflow import __version__


class Command(NamedTuple):
    """What a command does, and the `module` that has its ``parser(prog)`` and ``main(words, prog)``."""

    does: str
    module: str


class Version(argparse.Action):
    """Print the version, and how much compiled code is kept where."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print, and end with exit code 0."""
        from trussflow.blocks.tracing.compile_cache import cache_folder, cache_size  # slow to import

        print(f"trussflow {__version__}\ncompiled code: {cache_size() / 1e6:.1f} MB in {cache_folder()}")
        parser.exit()


COMMANDS = {
    "new": Command("write a first loop or mission to start from", "trussflow.new"),
    "run": Command("simulate a diagram or an FMU", "trussflow.run"),
    "sweep": Command("run a diagram many times, here or on a cluster", "trussflow.sweep"),
    "draw": Command("draw a diagram", "trussflow.draw"),
    "fmu": Command("write a diagram as an FMU, look into an FMU", "trussflow.fmu.__main__"),
    "fly": Command("fly a mission: figures, page, result", "trussflow.models.transport.__main__"),
    "view": Command("show a result in motion, as one page", "trussflow.models.viewer.__main__"),
    "analyse": Command("modes, margins and Bode plot of any loop", "trussflow.analyse"),
    "flight": Command(
        "fly many trusses and losses, and find where laws end", "trussflow.models.flight.__main__"
    ),
    "reproduce": Command("reproduce and judge the whole paper", "trussflow.models.reproduction.__main__"),
}
"""A new one is a line here; its module is imported only when it is called."""

FEW_CYCLES = 50_000
"""New objects after which garbage in circles is looked for; Python's own number is 700 or more [-]."""

EXAMPLES = """examples:
  trussflow new loop.py                          # a pendulum under control, to be changed
  trussflow run loop.py:loop 10 --plot loop.png  # simulated
  trussflow draw loop.py:loop loop.svg           # as a picture
  trussflow fmu export loop.py:loop loop.fmu     # for other tools
  trussflow fly --case 1                         # the space truss; open results/case1/index.html

exit codes: 0 all is well, 1 what was wanted did not succeed, 2 it made no sense, 130 stopped by Ctrl-C
tab completion: trussflow --print-completion bash > ~/.local/share/bash-completion/completions/trussflow"""


def parser(*, whole: bool) -> argparse.ArgumentParser:
    """Return the parser of the command; only the `whole` one knows the arguments of its commands."""
    found = argparse.ArgumentParser(
        prog="trussflow",
        description="Block diagrams for guidance and control, and a space truss carried by four robots.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    found.add_argument("--version", action=Version, nargs=0, help="print version and size of the cache")
    shtab.add_argument_to(found, help="print what makes a shell complete commands and options at a tab")
    commands = found.add_subparsers(metavar="command", required=True, title="commands")
    for name, command in COMMANDS.items():
        parents = [_module(command).parser(f"trussflow {name}")] if whole else []
        commands.add_parser(name, help=command.does, parents=parents, add_help=False)
    return found


def main(words: list[str] | None = None) -> int:
    """Run the command that `words` begin with, by default the process's; return the exit code."""
    words = sys.argv[1:] if words is None else words
    command = COMMANDS.get(words[0]) if words else None
    if command is None:
        # Help, version, completion or misuse: all of these exit.
        parser(whole=words[:1] == ["--print-completion"]).parse_args(words or ["--help"])
        return 0
    # Imports and expressions leave none behind; looking for them took a tenth of the start.
    usual = gc.get_threshold()
    gc.set_threshold(FEW_CYCLES)
    try:
        code: int = _module(command).main(words[1:], f"trussflow {words[0]}")
    finally:
        gc.set_threshold(*usual)
    return code


def _module(command: Command) -> Any:
    return importlib.import_module(command.module)


if __name__ == "__main__":
    sys.exit(main())
