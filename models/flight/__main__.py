"""``python -m trussflow.models.flight``: fly draws, find where each law ends, and write the report."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import xarray as xr

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.models.flight.report import jobs, write
from trussflow.models.reporting.evidence import is_fresh
from trussflow.models.reporting.parallel import finish_all


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m trussflow.models.flight",
        description="Fly the loop of the mean axes on many trusses, and find where other laws end.",
    )
    parser.add_argument("--draws", type=int, default=200, help="of each case [-]")
    parser.add_argument("--output", type=Path, default=Path("docs/flight"), help="folder of the report")
    parser.add_argument("--runs", type=Path, default=Path("results/flight"), help="folder of finished runs")
    parser.add_argument("--workers", type=int, help="processes at a time; default: one per core")
    parser.add_argument(
        "--check", action="store_true", help="only tell whether the report in --output is of this code"
    )
    return parser.parse_args(words)


def report(options: argparse.Namespace) -> int:
    """Fly what is missing and write the report; return the exit code."""
    if options.check:
        fresh, sentence = is_fresh(options.output, "make flight")
        print(sentence)
        return 0 if fresh else 1
    started = time.perf_counter()
    flown = jobs(options.draws)
    done = finish_all(flown, options.runs, workers=options.workers)
    found = {}
    for one in done:
        with xr.open_dataset(one.file) as data:
            found[one.name] = data.load()
    file, reused = write(found, flown, options.output), sum(one.reused for one in done)
    wall = time.perf_counter() - started
    print(f"{file}: {len(done)} runs, {reused} of them from before, in {wall:.0f} s")
    return 0


def main(words: list[str] | None = None) -> int:
    """Run the command; errors that the user can mend are a few lines, not a traceback."""
    try:
        return report(arguments(words))
    except TrussflowError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped; finished runs are kept", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
