"""``trussflow analyse``: oscillating modes, margins and Bode plot of the loop through a port."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

from trussflow.blocks.errors import DiagramError, LinearAnalysisError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.command_arguments import (
    Outcome,
    add_diagram,
    block_of,
    main_of,
    parser_of,
)
from trussflow.run import picture


def parser(prog: str) -> argparse.ArgumentParser:
    """Return the parser of the arguments of the command `prog`."""
    found = parser_of(
        prog,
        "Print the oscillating modes of a loop and its margins at a port, and draw its Bode plot.",
        "loop.py:loop --at pendulum.torque                 # modes and margins",
        "loop.py:loop --at truss.modal_force --plot m.png  # with the Bode plot",
    )
    add_diagram(found)
    found.add_argument("--at", required=True, help="port where the loop is opened")
    found.add_argument("--plot", type=Path, help="picture to write")
    return found


def analyse(options: argparse.Namespace) -> Outcome:
    """Analyse the loop that the `options` name."""
    # slow to import
    from trussflow.blocks import loop_transfer, modal_bode, modal_table
    from trussflow.blocks.linear_analysis.loop_transfer import margins_of

    plotted, diagram, margins, unstable = (
        picture(options.plot),
        block_of(options.item),
        None,
        None,
    )
    if not isinstance(diagram, Diagram):
        raise DiagramError(
            f"cannot analyse '{options.item}': it is a single block, not a diagram"
        )
    loop, table = loop_transfer(diagram, options.at), modal_table(diagram, options.at)
    try:
        found = margins_of(loop)
        margins, lines = asdict(found), [str(found)]
    except LinearAnalysisError as error:  # the closed loop is unstable
        unstable = str(error)
        lines = [unstable]
    if plotted is not None:
        modal_bode(diagram, options.at, loop=loop).savefig(plotted)
        lines.append(f"written to {plotted}")
    modes = [
        {"frequency": m.frequency, "damping_ratio": m.damping_ratio}
        for m in table.modes
    ]
    facts = {"modes": modes, "margins": margins, "unstable": unstable, "file": plotted}
    return Outcome(facts, "\n".join([str(table), *lines]))


main = main_of(analyse, parser)
