"""``python -m trussflow.models.viewer``: write the page of a run, pictures and films."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trussflow.blocks.support.progress import status_line
from trussflow.command_arguments import Outcome, ended, parser_of
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import STRUCTURES
from trussflow.models.viewer.movie import movie
from trussflow.models.viewer.page import replay
from trussflow.models.viewer.still import CAMERAS, still

PROG = "python -m trussflow.models.viewer"


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Write a run as one HTML file: animation of the truss and charts of all logged signals.",
        "results/case1/result.nc                             # writes replay.html",
        "results/case1/result.nc --frame 30 --png truss.png  # page and picture",
        "results/case1/index.html --png truss.png            # picture of an existing page",
        "results/case1/index.html --movie truss.gif          # film of eight seconds",
    )
    found.add_argument(
        "result",
        type=Path,
        help="netCDF file of a run, or existing page for --png or --movie",
    )
    found.add_argument(
        "--truss",
        choices=STRUCTURES,
        help="plant of the run; default: that in the result",
    )
    found.add_argument(
        "--output", type=Path, default=Path("replay.html"), help="page to write"
    )
    found.add_argument(
        "--png", type=Path, help="picture to write; needs Chromium or Chrome"
    )
    found.add_argument(
        "--movie", type=Path, help="animated .gif to write; needs Chromium or Chrome"
    )
    found.add_argument(
        "--frame",
        type=float,
        help="time of the picture [s]; default: the first instant",
    )
    found.add_argument(
        "--camera",
        choices=CAMERAS,
        default="oblique",
        help="view of the picture and of the film",
    )
    return found


def view(options: argparse.Namespace) -> Outcome:
    """Write page, picture and film of the `options`."""
    page, lines = options.result, []
    if page.suffix == ".html" and options.png is None and options.movie is None:
        raise ModelError(
            f"'{page}' is a page: open it in a browser, or set --png or --movie for a picture or a film of it"
        )
    if page.suffix != ".html":
        with status_line("writing the page"):
            page = replay(
                options.result, options.truss, options.output, title=str(options.result)
            )
        lines.append(f"open {page} in a browser")
    if options.png is not None:
        with status_line("taking the picture"):
            still(page, options.png, time=options.frame, camera=options.camera)
        lines.append(f"written: {options.png}")
    if options.movie is not None:
        with status_line("taking the film"):
            movie(page, options.movie, camera=options.camera)
        lines.append(f"written: {options.movie}")
    files = {"page": page, "picture": options.png, "film": options.movie}
    return Outcome(files, "\n".join(lines))


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with `words`, by default those of the process; return the exit code."""
    return ended(view, parser(prog).parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
