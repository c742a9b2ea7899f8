"""Commands of the studies: write a report, or check whether it has the equations of the present code."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from study_tools.evidence import outdated
from trussflow.command_arguments import FAILED, Outcome, parser_of


def study_parser(
    name: str, description: str, *examples: str
) -> argparse.ArgumentParser:
    """Return the argument parser of a study.

    Parameters
    ----------
    name : str
        Package of the study.
    description : str
        Purpose of the command.
    *examples : str
        Example arguments, each with a comment after ``#``.
    """
    found = parser_of(
        f"PYTHONPATH=examples/studies python -m {name}",
        f"{description}\nFinished runs are kept, and reused by the next call.",
        *examples,
        f"--check --output docs/{name}  # whether the present code gives that report",
    )
    for option, folder, content in (
        ("--output", "docs", "the report"),
        ("--runs", "results", "finished runs"),
    ):
        found.add_argument(
            option, type=Path, default=Path(folder, name), help=f"folder of {content}"
        )
    found.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count(),
        help="parallel runs; default: one per core",
    )
    found.add_argument(
        "--check",
        action="store_true",
        help="only compare the loops of the report with the present code",
    )
    return found


def checked(
    folder: Path, fingerprints: Mapping[str, Sequence[float]], target: str
) -> Outcome:
    """Return whether the report in a folder has the present fingerprints; `target` of make writes it."""
    changed = outdated(folder, fingerprints)
    message = f"the report in '{folder}' " + (
        f"is old: changed are {', '.join(changed)}; run 'make {target}'"
        if changed
        else "has the equations and parameters of the present code"
    )
    return Outcome(
        {"fresh": not changed, "message": message}, message, FAILED if changed else 0
    )
