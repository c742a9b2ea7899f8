"""``trussflow``, or ``python -m trussflow``: command line of the package."""

from __future__ import annotations

import argparse
import gc
import importlib
import sys
from typing import Any, NamedTuple

import shtab

from trussflow import __version__


class Command(NamedTuple):
    """Subcommand: help text `does`, and the `module` with ``parser(prog)`` and ``main(words, prog)``."""

    does: str
    module: str


class Version(argparse.Action):
    """Print the version, and size and folder of the compile cache."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print, and end with exit code 0."""
        # slow to import
        from trussflow.blocks.tracing.compile_cache import cache_folder, cache_size

        print(
            f"trussflow {__version__}\ncompiled code: {cache_size() / 1e6:.1f} MB in {cache_folder()}"
        )
        parser.exit()


COMMANDS = {
    "new": Command("write an example script or mission file", "trussflow.new"),
    "run": Command("simulate a diagram or an FMU", "trussflow.run"),
    "draw": Command("draw a diagram", "trussflow.draw"),
    "live": Command("write a page that simulates a diagram", "trussflow.live"),
    "fmu": Command(
        "export a diagram as an FMU, describe an FMU", "trussflow.fmu.__main__"
    ),
    "fly": Command(
        "simulate a mission: result, figures, page",
        "trussflow.models.transport.__main__",
    ),
    "view": Command(
        "write a page with the animation of a result",
        "trussflow.models.viewer.__main__",
    ),
    "analyse": Command("modes, margins and Bode plot of any loop", "trussflow.analyse"),
}
"""Subcommands by name; a module is imported only when its command is called."""

GARBAGE_THRESHOLD = 50_000
"""Number of new objects between collections of cyclic garbage; Python's default is 700 or more [-]."""

HELP_EXAMPLES = """examples:
  trussflow new loop.py                          # a controlled pendulum
  trussflow run loop.py:loop 10 --plot loop.png  # simulate it for 10 s
  trussflow draw loop.py:loop loop.svg           # draw it
  trussflow live loop.py:loop --save loop.html   # a page with sliders that simulates it
  trussflow fmu export loop.py:loop loop.fmu     # export it as an FMU
  trussflow fly --case 1                         # the space truss; writes results/case1/index.html

exit codes: 0 success, 1 failure, 2 wrong arguments or models, 130 stopped by Ctrl-C
tab completion: trussflow --print-completion bash > ~/.local/share/bash-completion/completions/trussflow"""


def parser(*, whole: bool) -> argparse.ArgumentParser:
    """Return the argument parser; only the `whole` one includes the arguments of the subcommands."""
    found = argparse.ArgumentParser(
        prog="trussflow",
        description="Block diagrams for guidance and control, and a space truss carried by four robots.",
        epilog=HELP_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    found.add_argument(
        "--version", action=Version, nargs=0, help="print version and size of the cache"
    )
    shtab.add_argument_to(found, help="print the completion script of a shell")
    commands = found.add_subparsers(metavar="command", required=True, title="commands")
    for name, command in COMMANDS.items():
        parents = [_module(command).parser(f"trussflow {name}")] if whole else []
        commands.add_parser(name, help=command.does, parents=parents, add_help=False)
    return found


def main(words: list[str] | None = None) -> int:
    """Run the subcommand in `words`, by default those of the process; return the exit code."""
    words = sys.argv[1:] if words is None else words
    command = COMMANDS.get(words[0]) if words else None
    if command is None:
        # Help, version, completion or misuse: all of these exit.
        parser(whole=words[:1] == ["--print-completion"]).parse_args(
            words or ["--help"]
        )
        return 0
    # Imports and expressions make no cyclic garbage, and its collection took a tenth of the start.
    usual = gc.get_threshold()
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        code: int = _module(command).main(words[1:], f"trussflow {words[0]}")
    finally:
        gc.set_threshold(*usual)
    return code


def _module(command: Command) -> Any:
    return importlib.import_module(command.module)


if __name__ == "__main__":
    sys.exit(main())
