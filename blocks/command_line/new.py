"""``trussflow new``: a first diagram or mission file."""

from __future__ import annotations

import argparse
from pathlib import Path

from trussflow.blocks.errors import DiagramError
from trussflow.blocks.support.files import written
from trussflow.blocks.support.texts import package_text
from trussflow.command_arguments import Outcome, main_of, parser_of

MISSION_TEMPLATE = "parameters/new_mission.toml"
"""Path of the mission template in the package `models`, which is found by name, not imported."""


def parser(prog: str) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Write an example script with a block and a closed loop, or a mission file of the space truss\n"
        "with comments.",
        "loop.py         # then: python loop.py",
        "mission.toml    # then: trussflow fly mission.toml",
    )
    found.add_argument(
        "path", type=Path, help="file to write, named .py or .toml; it must not exist"
    )
    return found


def new(options: argparse.Namespace) -> Outcome:
    """Write the file of the `options`."""
    path: Path = options.path
    mission = path.suffix == ".toml"
    if not mission and (path.suffix != ".py" or not path.stem.isidentifier()):
        raise DiagramError(
            f"cannot write '{path}': its name must end with .toml, or be a module name with .py"
        )
    package, file = (
        ("trussflow.models", MISSION_TEMPLATE)
        if mission
        else ("trussflow", "starter.py")
    )
    if path.exists():
        raise DiagramError(
            f"cannot write '{path}': it exists already; name another file"
        )
    written(path, package_text(file, package), DiagramError, "cannot write")
    text = f"run it with 'python {path}' or 'trussflow run {path}:loop 10'"
    if mission:
        text = f"run it with 'trussflow fly {path}'; '--explain' prints all values"
    return Outcome({"file": path}, f"{path}: {text}")


main = main_of(new, parser)
