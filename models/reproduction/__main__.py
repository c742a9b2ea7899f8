"""``python -m trussflow.models.reproduction``: run everything, and write the report."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import xarray as xr

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.models.reporting.cache import Job
from trussflow.models.reporting.evidence import is_fresh
from trussflow.models.reporting.ledger import Ledger
from trussflow.models.reporting.parallel import finish_all
from trussflow.models.reproduction.context import Context
from trussflow.models.reproduction.report import SECTIONS, chosen, write
from trussflow.models.reproduction.results import Results
from trussflow.models.reproduction.runs import all_missions
from trussflow.models.reproduction.trusses import prepare

DURATION = 80.0  # s
"""As in the source's figures: the motion takes 60 s."""


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m trussflow.models.reproduction",
        description="Reproduce and judge the results of Li, Wei, Chen (2026).",
    )
    parser.add_argument("--duration", type=float, default=DURATION, help="of a mission [s]")
    parser.add_argument("--output", type=Path, default=Path("docs/reproduction"), help="folder of the report")
    parser.add_argument(
        "--runs", type=Path, default=Path("results/reproduction"), help="folder of finished runs"
    )
    parser.add_argument("--workers", type=int, help="processes at a time; default: one per core")
    parser.add_argument(
        "--sections", nargs="+", default=[], metavar="NAME", help=f"only these: {', '.join(SECTIONS)}"
    )
    parser.add_argument(
        "--check", action="store_true", help="only tell whether the report in --output is of this code"
    )
    return parser.parse_args(words)


def reproduce(options: argparse.Namespace) -> int:
    """Run what is missing and write the report; return the exit code."""
    if options.check:
        fresh, sentence = is_fresh(options.output, "make reproduce")
        print(sentence)
        return 0 if fresh else 1
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
    for one in done:
        if one.name not in results:
            with xr.open_dataset(one.file) as data:
                maps[one.name] = data.load()
    report = write(sections, Context(results, maps, Ledger(), options.output))
    reused = sum(one.reused for one in done)
    wall = time.perf_counter() - started
    print(f"{report}: {len(done)} runs, {reused} of them from before, in {wall:.0f} s")
    return 0


def main(words: list[str] | None = None) -> int:
    """Run the command; errors that the user can mend are a few lines, not a traceback."""
    try:
        return reproduce(arguments(words))
    except TrussflowError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; finished runs are kept", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
