"""The command line: ``python -m trussflow.fmu export module:block plant.fmu``."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.export_interface import TOLERANCE
from trussflow.fmu.exporting.description.model_description import VERSIONS
from trussflow.fmu.exporting.export import KINDS, export


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        The arguments; by default those of the process.
    """
    settings = vars(_parser().parse_args(arguments))
    try:
        settings["parameters"] = dict(map(_assignment, settings["parameters"]))
        path = export(load(settings.pop("item")), settings.pop("path"), **settings)
    except TrussflowError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
    return 0


def _parser() -> argparse.ArgumentParser:
    whole = argparse.ArgumentParser(prog="python -m trussflow.fmu", description=__doc__)
    commands = whole.add_subparsers(required=True)
    parser = commands.add_parser("export", help="write a block or diagram as an FMU")
    parser.add_argument("item", help="module:name of a block, or of what returns one when called")
    parser.add_argument("path", type=Path, help="file to write")
    parser.add_argument("--kind", choices=KINDS, default="native")
    parser.add_argument("--version", choices=VERSIONS, default="2.0", help="version of FMI")
    parser.add_argument("--step", type=float, default=1e-3, help="internal step [s]")
    parser.add_argument("--stop-time", type=float, default=10.0, help="default end [s]")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="default tolerance")
    parser.add_argument(
        "--parameter",
        dest="parameters",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="value of a parameter, arrays as [1, 2]; may be repeated",
    )
    parser.add_argument(
        "--platform",
        dest="platforms",
        action="append",
        metavar="NAME",
        help="such as x86_64-windows, or all; may be repeated; by default this one",
    )
    return whole


def load(reference: str) -> Block:
    """Return the block that ``module:name`` stands for.

    Parameters
    ----------
    reference : str
        A module and, within it, a block, or what returns one when called without arguments.

    Raises
    ------
    ExportError
        If there is no such thing, or it is no block.
    """
    module, _, name = reference.partition(":")
    try:
        thing: Any = importlib.import_module(module)
    except (ImportError, ValueError) as error:
        raise ExportError(f"cannot import '{module}' for '{reference}': {error}") from error
    for part in filter(None, name.split(".")):
        if not hasattr(thing, part):
            raise ExportError(f"'{reference}': {thing!r} has no '{part}'")
        thing = getattr(thing, part)
    if callable(thing) and not isinstance(thing, Block):
        try:
            thing = thing()
        except TypeError as error:
            raise ExportError(
                f"'{reference}' cannot be called without arguments: {error}; name a function that "
                "returns the block"
            ) from error
    if not isinstance(thing, Block):
        raise ExportError(f"'{reference}' is {thing!r}, no block; write module:name of a block")
    return thing


def _assignment(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``.

    Raises
    ------
    ExportError
        If it is no assignment of numbers.
    """
    name, _, value = text.partition("=")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError as error:
        raise ExportError(f"--parameter {text}: write name=number, or name=[number, number]") from error


if __name__ == "__main__":
    raise SystemExit(main())
