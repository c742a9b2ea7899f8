"""``python -m reproduction``: run everything, and write the report."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import xarray as xr
from study_tools.cache import Job
from study_tools.evidence import is_fresh
from study_tools.ledger import Ledger
from study_tools.parallel import finish_all

from reproduction.context import Context
from reproduction.report import SECTIONS, chosen, write
from reproduction.results import Results
from reproduction.runs import all_missions
from reproduction.trusses import prepare
from trussflow.blocks.framework.command_line import FAILED, Outcome, ended, parser_of
from trussflow.blocks.framework.telling import counted, told

PROG = "python -m reproduction"

DURATION = 80.0  # s
"""As in the source's figures: the motion takes 60 s."""


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return what reads the words behind `prog`, the command."""
    found = parser_of(
        prog,
        "Reproduce and judge the results of Li, Wei, Chen (2026).\n"
        "Finished runs are kept, and reused by the next call.",
        "--output report                        # all of it; some minutes",
        "--sections claims --output report      # only what the paper claims",
        "--check --output docs/reproduction     # whether that report is of this code",
    )
    found.add_argument("--duration", type=float, default=DURATION, help="of a mission [s]")
    found.add_argument("--output", type=Path, default=Path("docs/reproduction"), help="folder of the report")
    found.add_argument(
        "--runs", type=Path, default=Path("results/reproduction"), help="folder of finished runs"
    )
    found.add_argument("--workers", type=int, help="processes at a time; default: one per core")
    found.add_argument(
        "--sections", nargs="+", default=[], metavar="NAME", help=f"only these: {', '.join(SECTIONS)}"
    )
    found.add_argument(
        "--check", action="store_true", help="only tell whether the report in --output is of this code"
    )
    return found


def reproduce(options: argparse.Namespace) -> Outcome:
    """Run what is missing and write the report."""
    if options.check:
        fresh, sentence = is_fresh(options.output, "make reproduce")
        return Outcome({"fresh": fresh, "message": sentence}, sentence, 0 if fresh else FAILED)
    started = time.perf_counter()
    sections = chosen(options.sections)
    needed = {name for section in sections.values() for name in section.missions}
    missions = [m for name, m in all_missions(options.duration).items() if name in needed]
    first: list[Job] = [j for s in sections.values() for j in s.jobs(None)]
    prepare(options.runs)
    done = finish_all([*first, *missions], options.runs, workers=options.workers)
    results = Results(missions, done, options.runs)
    second: list[Job] = [j for s in sections.values() for j in s.jobs(results)]
    done += finish_all([job for job in second if job not in first], options.runs, workers=options.workers)
    maps = {}
    for one in counted("reading runs", done):
        if one.name not in results:
            with xr.open_dataset(one.file) as data:
                maps[one.name] = data.load()
    with told("writing the report"):
        report = write(sections, Context(results, maps, Ledger(), options.output))
    reused = sum(one.reused for one in done)
    wall = time.perf_counter() - started
    facts = {"report": report, "runs": len(done), "reused": reused, "wall_time": wall}
    return Outcome(facts, f"{report}: {len(done)} runs, {reused} of them from before, in {wall:.0f} s")


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with these `words`, by default the process's; return the exit code."""
    return ended(reproduce, parser(prog).parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
