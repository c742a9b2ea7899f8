"""Command ``python -m flight``: simulate the robustness campaigns and write the report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from study_tools.fingerprints import outdated

from flight import comparison, report
from flight.campaigns import all_campaigns
from flight.loops import LAWS
from flight.tuning import Tuning
from trussflow.blocks.framework.command_arguments import (
    FAILED,
    Outcome,
    ended,
    parser_of,
)
from trussflow.blocks.support.validation import positive_whole

PROG = "PYTHONPATH=examples/studies python -m flight"


def parser() -> argparse.ArgumentParser:
    """Return the argument parser of the command."""
    found = parser_of(
        PROG,
        "Simulate the mean-axes controller on Monte Carlo samples, with failures and in off-nominal cases,\n"
        "and find the robustness limits of the control laws. Finished runs are kept, and reused by the next "
        "call.",
        "--output report                    # everything; about an hour on two cores",
        "--draws 20 --output report         # fewer samples",
        "--check --output docs/flight       # whether the present code gives that report",
        "--samples 1000 --output docs/sweep # instead: compare the laws on 1000 samples; 90 minutes",
    )
    found.add_argument(
        "--draws", type=int, default=200, help="Monte Carlo samples of each case [-]"
    )
    found.add_argument(
        "--samples", type=int, help="compare the laws on so many samples instead [-]"
    )
    found.add_argument(
        "--output", type=Path, default=Path("docs/flight"), help="folder of the report"
    )
    found.add_argument(
        "--runs",
        type=Path,
        default=Path("results/flight"),
        help="folder of finished runs",
    )
    found.add_argument(
        "--workers", type=int, help="parallel runs; default: one per core"
    )
    found.add_argument(
        "--check",
        action="store_true",
        help="only compare the diagrams of the report with the present code",
    )
    return found


def run(options: argparse.Namespace) -> Outcome:
    """Simulate the missing runs and write a report, or check one."""
    count = options.draws if options.samples is None else options.samples
    positive_whole(samples=count)
    folder = options.runs / f"{count}-samples"
    if options.samples is not None:
        campaigns, tuning = comparison.all_campaigns(count), Tuning()
        loops: dict[str, list[float]] = {}
        recorded = {one.name: one.fingerprint(loops) for one in campaigns} | {
            "tuning": tuning.fingerprint()
        }
    else:
        campaigns = all_campaigns(count)
        recorded = report.fingerprints(campaigns)
    if options.check:
        changed = outdated(options.output, recorded)
        message = f"the report in '{options.output}' has the equations and parameters of the present code"
        if changed:
            message = f"the report in '{options.output}' is outdated: changed are {', '.join(changed)}"
        return Outcome(
            {"fresh": not changed, "message": message},
            message,
            FAILED if changed else 0,
        )
    if options.samples is None:
        file = report.make_report(
            campaigns, options.output, folder, options.workers, recorded
        )
        return Outcome({"report": file}, f"wrote {file}")
    found = {
        one.name: comparison.with_uncertainties(
            one.run(folder, workers=options.workers),
            LAWS[one.section].truss().dynamics.modes.modes,
        )
        for one in campaigns
    }
    tuned = tuning.run(folder, workers=options.workers)
    file = comparison.write(found, tuned, options.output, recorded)
    return Outcome({"report": file}, f"wrote {file}")


def main(words: list[str] | None = None) -> int:
    """Run the command with `words`, by default those of the process; return the exit code."""
    return ended(run, parser().parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
