"""Command ``python -m flight``: simulate the robustness campaigns and write the report."""

from __future__ import annotations

import argparse
import sys

from study_tools.command import checked, study_parser

from flight import comparison, report
from trussflow.blocks.support.validation import positive_whole
from trussflow.command_arguments import Outcome, ended


def parser() -> argparse.ArgumentParser:
    """Return the argument parser of the command."""
    found = study_parser(
        "flight",
        "Simulate the mean-axes controller on Monte Carlo samples, with faults and other deviations,\n"
        "and find the robustness limits of the control laws.",
        "--output report                    # everything; about an hour on two cores",
        "--draws 20 --output report         # fewer samples",
        "--samples 1000 --output docs/sweep # instead: compare the laws on 1000 samples; 90 minutes",
    )
    found.add_argument(
        "--draws", type=int, default=200, help="Monte Carlo samples of each case [-]"
    )
    found.add_argument(
        "--samples", type=int, help="compare the laws on so many samples instead [-]"
    )
    return found


def run(options: argparse.Namespace) -> Outcome:
    """Simulate the missing runs and write a report, or check one."""
    make, present, target, count = (
        (report.make_report, report.fingerprints, "flight", options.draws)
        if options.samples is None
        else (comparison.make_report, comparison.fingerprints, "sweep", options.samples)
    )
    if options.check:
        return checked(options.output, present(), target)
    positive_whole(samples=count)
    folder = options.runs / (f"{count}-samples" if options.samples else "report")
    file = make(count, options.output, folder, options.workers)
    return Outcome({"report": file}, f"wrote {file}")


def main(words: list[str] | None = None) -> int:
    """Run the command with `words`, by default those of the process; return the exit code."""
    return ended(run, parser().parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
