"""The variables of a block or diagram, group by group, in the order of their value references."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import Entry
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import resolved
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.tracing.plan import Plan
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.dependencies import Pattern
from trussflow.fmu.exporting.description.initialization import setting_blocks
from trussflow.fmu.exporting.description.variables import Variable

Group = tuple[Variable, ...]


def variables(
    item: Block, plan: Plan, p: Vector, tunable: Pattern, start: Mapping[str, Any]
) -> tuple[Group, Group, Group, Group, Group, Group]:
    """Return time, inputs, parameters, states, derivatives and outputs.

    Parameters
    ----------
    item : Block
        What is exported.
    plan : Plan
        Its plan.
    p : Vector
        Values of the parameters [as declared].
    tunable : Pattern
        For each element of `p`, whether it matters once time goes on.
    start : mapping
        Start values of inputs by name [units of the ports].

    Raises
    ------
    ExportError
        If a start value is missing or of the wrong shape.
    """
    taken = {*item.ports, *getattr(item, "blocks", ())}
    name = "time" if "time" not in taken else "independent_time"
    time = Variable(name, (), 0, "independent", "continuous", "", None, ("s",), "simulation time")
    inputs = _numbered(_inputs(item, plan, start), 1)
    parameters = _numbered(_parameters(item, plan, p, tunable), 1 + plan.u.size)
    first = 1 + plan.u.size + plan.p.size
    states = _numbered(_states(item, plan, p), first)
    derivatives = tuple(_derivative(v, plan.x.size) for v in states)
    outputs = _numbered(_outputs(item), first + 2 * plan.x.size)
    return (time,), inputs, parameters, states, derivatives, outputs


def name_of(item: Block, entry: Entry) -> str:
    """Return the name of a parameter or state; within a single block its own name is enough.

    Parameters
    ----------
    item : Block
        What is exported.
    entry : Entry
        The place in the plan.
    """
    return f"{entry.path}.{entry.name}" if isinstance(item, Diagram) else entry.name


def calculated_states(plan: Plan) -> set[tuple[str, str]]:
    """Return the continuous states whose initial value follows from parameters or inputs."""
    setting = {block.path for block in setting_blocks(plan)}
    found = set()
    for e in plan.x:
        block = plan.system.blocks[e.path]
        named = isinstance(block.states()[e.name].initial, str)
        if e.path in setting or (named and type(block).initial is Block.initial):
            found.add((e.path, e.name))
    return found


def _numbered(group: Iterable[Variable], first: int) -> Group:
    """Give each variable its value reference."""
    found: list[Variable] = []
    for variable in group:
        found.append(replace(variable, reference=first))
        first += variable.size
    return tuple(found)


def _inputs(item: Block, plan: Plan, given: Mapping[str, Any]) -> Iterator[Variable]:
    """Yield the inputs, which start as given, at their declared default, or at zero.

    Raises
    ------
    ExportError
        If a name is unknown, or a value has the wrong shape or is not finite.
    """
    known = {port.name: port for port in item.inputs()}
    for name in given:
        if name not in known:
            raise ExportError(
                f"cannot export '{item.name}': no input '{name}' to start; the inputs are: "
                f"{', '.join(known) or 'none'}"
            )
    for name, port in known.items():
        shape = port.whole_shape or ()
        value = given.get(name, plan.system.external[name].start_value())
        try:
            start = np.broadcast_to(np.asarray(value, dtype=float), shape).astype(float).ravel()
            good = bool(np.isfinite(start).all())
        except (TypeError, ValueError):
            good = False
        if not good:
            raise ExportError(
                f"cannot export '{item.name}': input '{name}' cannot start at {value!r}; it takes "
                f"finite numbers of shape {shape}, given with start={{'{name}': ...}}"
            )
        units, meaning = port.element_units(), _meaning(port)
        yield Variable(name, shape, 0, "input", "continuous", "exact", start, units, meaning)


def _parameters(item: Block, plan: Plan, p: Vector, tunable: Pattern) -> Iterator[Variable]:
    for e in plan.p:
        declared: Parameter = plan.system.blocks[e.path]._declared[e.name]
        own = slice(e.start, e.stop)
        kind = "tunable" if tunable[own].any() else "fixed"
        units = (declared.unit or None,) * (e.stop - e.start)
        name, meaning = name_of(item, e), declared.meaning
        yield Variable(name, e.shape, 0, "parameter", kind, "exact", p[own].copy(), units, meaning)


def _states(item: Block, plan: Plan, p: Vector) -> Iterator[Variable]:
    x = plan.initial(p, {})[0]
    calculated = calculated_states(plan)
    for e in plan.x:
        declared = plan.system.blocks[e.path].states()[e.name]
        given, size = declared.unit, e.stop - e.start
        units = given if isinstance(given, tuple) else (given or None,) * size
        free = (e.path, e.name) not in calculated
        start = x[e.start : e.stop] if free else None
        initial = "exact" if free else "calculated"
        name, meaning = name_of(item, e), declared.meaning
        yield Variable(name, e.shape, 0, "local", "continuous", initial, start, units, meaning)


def _derivative(state: Variable, distance: int) -> Variable:
    units = tuple(f"({unit})/s" if unit else None for unit in state.units)
    return replace(
        state,
        name=f"der({state.name})",
        reference=state.reference + distance,
        initial="calculated",
        start=None,
        units=units,
        meaning=f"rate of {state.name}",
        state=state.name,
    )


def _outputs(item: Block) -> Iterator[Variable]:
    for port in item.outputs():
        held = resolved(port).block.sample_time is not None
        kind = "discrete" if held else "continuous"
        shape, units, meaning = port.whole_shape or (), port.element_units(), _meaning(port)
        yield Variable(port.name, shape, 0, "output", kind, "calculated", None, units, meaning)


def _meaning(port: Port) -> str:
    frame = f" [frame: {port.frame}]" if port.frame else ""
    return f"{resolved(port).declaration.meaning}{frame}".strip()
