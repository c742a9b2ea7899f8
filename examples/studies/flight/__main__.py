"""``python -m flight``: fly draws, find where each law ends, and write the report."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import xarray as xr
from study_tools.evidence import is_fresh
from study_tools.parallel import finish_all

from flight import samples_report
from flight.report import jobs, write
from flight.samples import studies
from flight.tuned import Tuning
from trussflow.blocks.framework.command_line import FAILED, Outcome, ended, parser_of
from trussflow.blocks.framework.telling import counted, told
from trussflow.blocks.framework.validation import positive_whole

PROG = "python -m flight"


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return what reads the words behind `prog`, the command."""
    found = parser_of(
        prog,
        "Fly the loop of the mean axes on many trusses and with losses, and find where other laws end.\n"
        "Finished flights are kept, and reused by the next call.",
        "--output report                    # all of it; about an hour on two cores",
        "--draws 20 --output report         # fewer trusses",
        "--check --output docs/flight       # whether that report is of this code",
        "--samples 1000 --output docs/sweep # instead: 1000 trusses by each law; an hour and a half",
    )
    found.add_argument("--draws", type=int, default=200, help="of each case [-]")
    found.add_argument("--samples", type=int, help="how often each law flies, in place of all that [-]")
    found.add_argument("--output", type=Path, default=Path("docs/flight"), help="folder of the report")
    found.add_argument("--runs", type=Path, default=Path("results/flight"), help="folder of finished runs")
    found.add_argument("--workers", type=int, help="processes at a time; default: one per core")
    found.add_argument(
        "--check", action="store_true", help="only tell whether the report in --output is of this code"
    )
    return found


def report(options: argparse.Namespace) -> Outcome:
    """Fly what is missing and write the report."""
    if options.check:
        fresh, sentence = is_fresh(options.output, f"make {options.output.name}")
        return Outcome({"fresh": fresh, "message": sentence}, sentence, 0 if fresh else FAILED)
    if options.samples is not None:
        return sampled(options)
    started = time.perf_counter()
    flown = jobs(options.draws)
    done = finish_all(flown, options.runs, workers=options.workers)
    found = {}
    for one in counted("reading runs", done):
        with xr.open_dataset(one.file) as data:
            found[one.name] = data.load()
    with told("writing the report"):
        file = write(found, flown, options.output)
    reused = sum(one.reused for one in done)
    wall = time.perf_counter() - started
    facts = {"report": file, "runs": len(done), "reused": reused, "wall_time": wall}
    return Outcome(facts, f"{file}: {len(done)} runs, {reused} of them from before, in {wall:.0f} s")


def sampled(options: argparse.Namespace) -> Outcome:
    """Fly samples by each law, those that are missing, and write the report on them."""
    positive_whole(samples=options.samples)
    flown = {}
    for study in studies():
        folder = options.runs / f"{options.samples}-samples"
        flown[study] = study.fly(options.samples, folder, workers=options.workers)
    lines = {study.name: int(found["flies"].sum()) for study, found in flown.items()}
    tuning = Tuning()
    with told("tuning the design of the mean axes"):
        tuned = tuning.fly(options.runs / "tuned", workers=options.workers)
    file = samples_report.write(flown, (tuning, tuned), options.output)
    said = [f"{name}: {count} of {options.samples} fly" for name, count in lines.items()]
    return Outcome({"report": file, "samples": options.samples, "fly": lines}, "\n".join([*said, f"{file}"]))


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with these `words`, by default the process's; return the exit code."""
    return ended(report, parser(prog).parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
