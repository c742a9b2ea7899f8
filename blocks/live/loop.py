"""Loop of a live page: the derivatives of the opened diagram, as a program of its states and parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.loop_transfer import refuse_open
from trussflow.blocks.linear_analysis.opened_model import RATES_AND_OUTPUTS
from trussflow.blocks.linear_analysis.references import Reference
from trussflow.blocks.support.packing import packed
from trussflow.blocks.tracing.program import Program


class Loop(NamedTuple):
    """A loop opened at one scalar wire.

    Attributes
    ----------
    port : Port
        The wire.
    program : Program
        Derivative of (dx/dt, returned signal) along a direction of (x, sent signal); the direction is at the end
        of its argument d.
    data : dict
        Name, size and element of the wire; d of the opened diagram, its size before the inputs, and the index of the
        sent signal in it.
    """

    port: Port
    program: Program
    data: dict[str, Any]


def loop_of(diagram: Diagram, at: Reference) -> Loop:
    """Return the loop of a diagram, opened at a scalar wire.

    Parameters
    ----------
    diagram : Diagram
        The closed loop.
    at : Port or str
        The wire, as for `loop_transfer`.

    Raises
    ------
    LinearAnalysisError
        If no loop passes there, the wire is not scalar, or the diagram has sampled blocks or iterated loops.
    """
    one = refuse_open(diagram, at)
    cannot = f"cannot analyse the loop at '{one.port.full_path}' in a live page"
    size = one.port.elements().size
    if size != 1:
        raise LinearAnalysisError(
            f"{cannot}: it has {size} elements; name one of them, such as '{one.port.full_path}[0]'"
        )
    whole = one.leaf.block.port(one.leaf.name)
    model, _, (x, d, _) = Linearizer(diagram, [at], [at], cut=[at]).opened()
    plan = model.plan
    reasons = {
        "sampled blocks": plan.system.clocks,
        "algebraic loops that are iterated": plan.guesses.size,
    }
    for reason in filter(reasons.get, reasons):
        raise LinearAnalysisError(
            f"{cannot}: the diagram has {reason}; use loop_margins in Python, and leave out at="
        )
    rates = model.programs[RATES_AND_OUTPUTS]
    t, states, values, parameters = rates.inputs
    sent = int(model.input_columns[0]) - x.size
    direction = ca.SX.sym("direction", x.size + 1)
    rows = [*range(x.size), *model.output_rows.tolist()]
    slope = ca.jtimes(
        rates.expanded(*rates.inputs)[rows], ca.vertcat(states, values[sent]), direction
    )
    program = Program(
        "slope",
        (t, states, ca.vertcat(values, direction), parameters),
        (),
        ca.densify(slope),
    )
    data = {
        "name": one.port.full_path,
        "values": packed(d),
        "kept": plan.fired.span.stop,
        "sent": sent,
        "size": whole.size,
        "element": int(one.leaf.elements().ravel()[0]),
    }
    return Loop(whole, program, data)
