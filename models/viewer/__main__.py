"""``python -m trussflow.models.viewer``: write the page of a run, and still pictures."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trussflow.blocks.framework.command_line import Outcome, ended, parser_of
from trussflow.blocks.framework.telling import told
from trussflow.models.errors import ModelError
from trussflow.models.viewer.page import replay
from trussflow.models.viewer.scene import PLANTS
from trussflow.models.viewer.still import CAMERAS, still

PROG = "python -m trussflow.models.viewer"


def parser(prog: str = PROG) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Show a run in one HTML file: the truss in motion, and charts of all that was logged.",
        "results/case1/result.nc                             # writes replay.html",
        "results/case1/result.nc smc/result.nc --names ismc smc      # the second over the first",
        "results/case1/result.nc --frame 30 --png truss.png  # a picture as well",
        "results/case1/index.html --png truss.png            # a picture of a page that is there",
    )
    found.add_argument("result", type=Path, help="netCDF file of a run, or a page to take a picture of")
    found.add_argument("other", type=Path, nargs="?", help="a second run, shown over the first")
    found.add_argument("--truss", choices=PLANTS, help="what flew; by default what the result says")
    found.add_argument("--other-truss", choices=PLANTS, help="what flew there")
    found.add_argument("--names", nargs=2, default=["run", "other run"], help="of the two runs")
    found.add_argument("--title", default="Replay", help="of the page")
    found.add_argument("--output", type=Path, default=Path("replay.html"), help="page to write")
    found.add_argument("--png", type=Path, help="picture to write as well; needs Chromium or Chrome")
    found.add_argument("--frame", type=float, help="instant of the picture [s]; by default the first")
    found.add_argument("--camera", choices=CAMERAS, default="oblique", help="where from")
    return found


def view(options: argparse.Namespace) -> Outcome:
    """Write what the `options` ask for."""
    page, lines = options.result, []
    if page.suffix == ".html" and options.png is None:
        raise ModelError(f"'{page}' is a page: open it in a browser, or name a picture to take of it, --png")
    if page.suffix != ".html":
        with told("writing the page"):
            page = replay(
                options.result,
                options.truss,
                options.output,
                other=options.other,
                other_truss=options.other_truss,
                names=options.names,
                title=options.title,
            )
        lines.append(f"open {page} in a browser")
    if options.png is not None:
        with told("taking the picture"):
            still(page, options.png, time=options.frame, camera=options.camera)
        lines.append(f"written: {options.png}")
    return Outcome({"page": page, "picture": options.png}, "\n".join(lines))


def main(words: list[str] | None = None, prog: str = PROG) -> int:
    """Run the command `prog` with these `words`, by default the process's; return the exit code."""
    return ended(view, parser(prog).parse_args(words))


if __name__ == "__main__":
    sys.exit(main())
