"""Command ``python -m reproduction``: simulate all runs and write the report."""

from __future__ import annotations

import argparse
import sys

from study_tools.command import checked, study_parser

from reproduction.report import fingerprints, reproduce
from trussflow.command_arguments import Outcome, ended


def parser() -> argparse.ArgumentParser:
    """Return the argument parser of the command."""
    return study_parser(
        "reproduction",
        "Reproduce and check the results of Li, Wei, Chen (2026).",
        "--output report                        # the report; some minutes",
    )


def run(options: argparse.Namespace) -> Outcome:
    """Simulate the missing runs and write the report, or check one."""
    if options.check:
        present = fingerprints(options.runs)
        return checked(options.output, present, "reproduce")
    file = reproduce(options.output, options.runs, workers=options.workers)
    return Outcome({"report": file}, f"wrote {file}")


def main(words: list[str] | None = None) -> int:
    """Run the command with `words`, by default those of the process; return the exit code."""
    return ended(run, parser().parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
