"""Command ``python -m reproduction``: simulate all runs and write the report."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

from reproduction.report import EVIDENCE, fingerprints, reproduce
from trussflow.blocks.framework.command_arguments import (
    FAILED,
    Outcome,
    ended,
    parser_of,
)
from trussflow.blocks.support.files import reading
from trussflow.models.errors import ModelError

PROG = "PYTHONPATH=examples/studies python -m reproduction"


def parser() -> argparse.ArgumentParser:
    """Return the argument parser of the command."""
    found = parser_of(
        PROG,
        "Reproduce and check the results of Li, Wei, Chen (2026).\n"
        "Finished runs are kept, and reused by the next call.",
        "--output report                        # the report; some minutes",
        "--check --output docs/reproduction     # whether the present code gives that report",
    )
    found.add_argument(
        "--output",
        type=Path,
        default=Path("docs/reproduction"),
        help="folder of the report",
    )
    found.add_argument(
        "--runs",
        type=Path,
        default=Path("results/reproduction"),
        help="folder of finished runs",
    )
    found.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count(),
        help="processes; default: one per core",
    )
    found.add_argument(
        "--check",
        action="store_true",
        help="only compare the diagrams of the report with the present code",
    )
    return found


def run(options: argparse.Namespace) -> Outcome:
    """Simulate the missing runs and write the report, or check one."""
    if not options.check:
        report = reproduce(options.output, options.runs, workers=options.workers)
        return Outcome({"report": report}, f"wrote {report}")
    with reading(
        options.output / EVIDENCE, ModelError, "cannot read the evidence of a report in"
    ) as file:
        recorded = json.loads(file.read_text(encoding="utf-8")).get("diagrams", {})
    present = fingerprints(options.runs)
    changed = sorted(
        name
        for name in {*recorded, *present}
        if recorded.get(name) != present.get(name)
    )
    fresh = not changed
    message = f"the report in '{options.output}' has the equations and parameters of the present code"
    if changed:
        message = f"the report in '{options.output}' is old: changed are {', '.join(changed)}; run 'make reproduce'"
    return Outcome(
        {"fresh": fresh, "message": message}, message, 0 if fresh else FAILED
    )


def main(words: list[str] | None = None) -> int:
    """Run the command with `words`, by default those of the process; return the exit code."""
    return ended(run, parser().parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
