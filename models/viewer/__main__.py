"""``python -m trussflow.models.viewer``: a page that shows a run, and still pictures of it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.models.viewer.page import replay
from trussflow.models.viewer.scene import PLANTS
from trussflow.models.viewer.still import CAMERAS, still


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m trussflow.models.viewer", description="Show a run in one HTML file."
    )
    parser.add_argument("result", type=Path, help="netCDF file of a run")
    parser.add_argument("--truss", choices=PLANTS, help="what flew; by default what the result says")
    parser.add_argument("--other", type=Path, help="a second run, shown over the first")
    parser.add_argument("--other-truss", choices=PLANTS, help="what flew there")
    parser.add_argument("--names", nargs=2, default=["run", "other run"], help="of the two runs")
    parser.add_argument("--title", default="Replay", help="of the page")
    parser.add_argument("--output", type=Path, default=Path("replay.html"), help="page to write")
    parser.add_argument("--png", type=Path, help="picture to write as well; needs Chromium or Chrome")
    parser.add_argument("--frame", type=float, default=0.0, help="instant of the picture [s]")
    parser.add_argument("--camera", choices=CAMERAS, default="oblique", help="where from")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    """Run the command; errors that the user can mend are one line, not a traceback."""
    options = arguments(words)
    try:
        page = replay(
            options.result,
            options.truss,
            options.output,
            other=options.other,
            other_truss=options.other_truss,
            names=options.names,
            title=options.title,
        )
        print(f"open {page} in a browser")
        if options.png is not None:
            print(f"written: {still(page, options.png, time=options.frame, camera=options.camera)}")
    except TrussflowError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
