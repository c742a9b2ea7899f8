"""The command line: ``python -m trussflow.fmu export module:block plant.fmu``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trussflow.command_arguments import (
    Outcome,
    add_json,
    block_of,
    ended,
    parser_of,
    values_of,
)
from trussflow.fmu.exporting.description.export_interface import DEFAULT_TOLERANCE
from trussflow.fmu.exporting.description.model_description import FMI_VERSIONS
from trussflow.fmu.exporting.export import SOLVERS, export
from trussflow.fmu.importing.block import Fmu

PROGRAM_NAME = "python -m trussflow.fmu"


def parser(prog: str = PROGRAM_NAME) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    whole = parser_of(
        prog,
        "Write blocks and diagrams as FMUs (FMI 2.0 and 3.0), or list the contents of an FMU.",
        "export trussflow.models:SpaceTruss.consistent plant.fmu   # C inside, runs without Python",
        "export loop.py:loop loop.fmu --version 3.0 --step 1e-3    # a diagram of yours",
        "export loop.py:loop loop.c --kind c                       # plain C, for a flight computer",
        "inspect plant.fmu --json                                  # ports, parameters, states",
    )
    commands = whole.add_subparsers(required=True, metavar="export|inspect")
    inspecting = commands.add_parser(
        "inspect", help="list the contents of an FMU without running it"
    )
    inspecting.add_argument("path", type=Path, help="the FMU")
    inspecting.set_defaults(perform=_inspect)
    exporting = commands.add_parser("export", help="write a block or diagram as an FMU")
    exporting.set_defaults(perform=_export)
    exporting.add_argument(
        "item",
        help="module:name or file.py:name of a block, or of a function that returns one",
    )
    exporting.add_argument("path", type=Path, help="file to write")
    exporting.add_argument("--kind", choices=SOLVERS, default="native")
    exporting.add_argument(
        "--solver",
        choices=SOLVERS["python"],
        default="rk4",
        help="solver of co-simulation",
    )
    exporting.add_argument(
        "--version", choices=FMI_VERSIONS, default="2.0", help="version of FMI"
    )
    exporting.add_argument("--step", type=float, default=1e-3, help="fixed step [s]")
    exporting.add_argument(
        "--stop-time", type=float, default=10.0, help="default stop time [s]"
    )
    exporting.add_argument(
        "--tolerance", type=float, default=DEFAULT_TOLERANCE, help="default tolerance"
    )
    exporting.add_argument(
        "--parameter",
        dest="parameters",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="value of a parameter, arrays as [1, 2]; may be repeated",
    )
    exporting.add_argument(
        "--platform",
        dest="platforms",
        action="append",
        metavar="NAME",
        help="such as x86_64-windows, or all; may be repeated; by default this one",
    )
    for command in (inspecting, exporting):
        # keeps --json given before the subcommand
        add_json(command, default=argparse.SUPPRESS)
    return whole


def main(words: Sequence[str] | None = None, prog: str = PROGRAM_NAME) -> int:
    """Run the command line and return the exit code.

    Parameters
    ----------
    words : sequence of str, optional
        The arguments; by default those of the process.
    prog : str
        Name of the command in messages.
    """
    return ended(_performed, parser(prog).parse_args(words))


def _performed(options: argparse.Namespace) -> Outcome:
    given = dict(vars(options))
    given.pop("json", None)
    outcome: Outcome = given.pop("perform")(**given)
    return outcome


def _export(item: str, path: Path, parameters: list[str], **settings: Any) -> Outcome:
    values = values_of("--parameter", parameters)
    path = export(block_of(item), path, parameters=values, **settings)
    size = path.stat().st_size
    return Outcome({"file": path, "bytes": size}, f"{path}: {size / 1e6:.2f} MB")


def _inspect(path: Path) -> Outcome:
    fmu = Fmu(path)
    return Outcome(fmu.variables, repr(fmu))


if __name__ == "__main__":
    sys.exit(main())
