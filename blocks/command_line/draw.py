"""``trussflow draw``: a diagram as a picture, or as a tree in the terminal."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.diagram import Diagram
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
        "Draw a diagram as SVG or HTML, or print it as a tree of blocks with ports, rates and states.",
        "loop.py:loop                # print the tree",
        "loop.py:loop loop.svg       # write the picture",
        "loop.py:loop loop.html      # write a page with zoom, groups that open, and search",
    )
    add_diagram(found)
    found.add_argument(
        "path",
        type=Path,
        nargs="?",
        help="file to write, with the suffix .svg or .html",
    )
    return found


def draw(options: argparse.Namespace) -> Outcome:
    """Draw the diagram of the `options`, or return its tree."""
    diagram, text = block_of(options.item), ""
    wires = diagram.wires if isinstance(diagram, Diagram) else []
    if options.path is None:
        text = repr(diagram)
    elif isinstance(diagram, Diagram):
        diagram.draw(options.path)
        text = f"{options.path}: {len(diagram.blocks)} blocks"
    else:
        raise DiagramError(
            f"cannot draw '{options.item}': it is a single block, not a diagram"
        )
    # a grounded input has no source
    ends = [[port.full_path for port in wire.ends] for wire in wires]
    return Outcome(
        {"file": options.path, "tree": asdict(diagram._described()), "wires": ends},
        text,
    )


main = main_of(draw, parser)
