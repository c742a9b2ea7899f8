"""``trussflow live``: a page that simulates a diagram, as a file or served to the browser."""

from __future__ import annotations

import argparse
from pathlib import Path

from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.support.progress import status_line
from trussflow.command_arguments import (
    Outcome,
    add_diagram,
    block_of,
    main_of,
    parser_of,
)


def parser(prog: str) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Simulate a diagram in the browser, with sliders and charts: as one HTML file, or served until Ctrl-C.",
        "loop.py:loop --save loop.html                            # sliders and signals by default",
        "loop.py:loop --parameters law.proportional_gain --signals pendulum.angle",
        "loop.py:loop --save loop.html --at pendulum.torque       # with poles, Bode plot and margins",
        "loop.py:loop --pace 1                                    # sliders act on a run in real time",
    )
    add_diagram(found)
    found.add_argument(
        "--save",
        type=Path,
        help="page to write; without it, the page is served and may have Python blocks and FMUs",
    )
    found.add_argument(
        "--parameters",
        nargs="+",
        metavar="BLOCK.PARAMETER",
        help="parameters with a slider; default: up to 12 of the outermost blocks",
    )
    found.add_argument(
        "--signals",
        nargs="+",
        metavar="BLOCK.PORT",
        help="signals in charts; default: the exposed outputs",
    )
    found.add_argument("--at", help="scalar wire where the loop is opened")
    found.add_argument(
        "--duration", type=float, default=10.0, help="duration of a run [s]"
    )
    found.add_argument(
        "--step", type=float, help="step [s]; default: from the fastest mode"
    )
    found.add_argument(
        "--pace", type=float, help="simulated seconds in a second, of a served page"
    )
    return found


def live(options: argparse.Namespace) -> Outcome:
    """Write or serve the page of the `options`."""
    diagram = block_of(options.item)
    if not isinstance(diagram, Diagram):
        raise DiagramError(
            f"cannot make a live page of '{options.item}': it is a single block, not a diagram"
        )
    settings = {
        name: getattr(options, name)
        for name in ("parameters", "signals", "at", "duration", "step", "pace")
    }
    if options.save is None:
        diagram.live(**settings)
        return Outcome({"page": None}, "")
    with status_line("writing the page"):
        page = diagram.live(options.save, **settings)
    return Outcome({"page": page}, f"open {page} in a browser")


main = main_of(live, parser)
