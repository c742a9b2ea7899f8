"""Groups of FMU variables of a block or diagram, in the order of their value references."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import KINDS, TIMED, Event, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.layout import Entry, Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import resolved
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import finite_array, one_of
from trussflow.blocks.tracing.initialization import setting_blocks
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.sparsity import Pattern
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.variables import (
    Variable,
    VariableGroup,
    Variables,
)

Starts = dict[str, Vector]
"""Start values of inputs by name, in the shape of the port."""


def variables(
    item: Block,
    plan: Plan,
    p: Vector,
    x: Vector,
    d: Vector,
    starts: Starts,
    tunable: Pattern,
) -> Variables:
    """Return all variables of an exported item.

    Parameters
    ----------
    item : Block
        The exported block or diagram.
    plan : Plan
        Its plan.
    p, x, d : Vector
        Values of the parameters, and values of the states and discrete values before initialization
        [as declared].
    starts : dict of str to array
        Start values of all inputs [units of the ports].
    tunable : Pattern
        Whether each element of `p` has an effect after initialization.
    """
    reference = 2  # that of the time is 1

    def numbered(group: Iterable[Variable]) -> VariableGroup:
        """Return the variables with the next value references."""
        nonlocal reference
        found: list[Variable] = []
        for variable in group:
            found.append(replace(variable, reference=reference))
            reference += variable.size
        return tuple(found)

    # FMI requires unique names; a port or block may be named "time".
    taken = {*item.ports, *getattr(item, "blocks", ())}
    name = "time" if "time" not in taken else "independent_time"
    time = Variable(
        name,
        (),
        ("s",),
        "simulation time",
        causality="independent",
        initial="",
        reference=1,
    )
    modes = (
        replace(v, variability="discrete", initial="calculated", start=None)
        for v in _states(item, plan, plan.modes, d)
    )
    inputs = numbered(_input(port, starts) for port in item.inputs())
    parameters = numbered(_parameters(item, plan, p, tunable))
    states = numbered(_states(item, plan, plan.x, x))
    shown = {
        "derivatives": numbered(map(_derivative, states)),
        "outputs": numbered(map(_of_port, item.outputs())),
        "modes": numbered(modes),
        "indicators": numbered(_indicators(item, plan)),
    }
    # Not published, so numbered by the place in d instead of a reference.
    reference = plan.memory.span.start
    memory = numbered(_states(item, plan, plan.memory, d))
    return Variables(time, inputs, parameters, states, **shown, memory=memory)


def name_of(item: Block, entry: Entry) -> str:
    """Return the FMU's name of a parameter or state; for a single block it has no path.

    Parameters
    ----------
    item : Block
        The exported block or diagram.
    entry : Entry
        Entry of the parameter or state in the plan.
    """
    return f"{entry.path}.{entry.name}" if isinstance(item, Diagram) else entry.name


def input_starts(item: Block, plan: Plan, chosen: Mapping[str, Any]) -> Starts:
    """Return the start values of the inputs: as chosen, their declared default, or zero.

    Parameters
    ----------
    item : Block
        The exported block or diagram.
    plan : Plan
        Its plan.
    chosen : mapping
        Values by name [units of the ports].

    Raises
    ------
    ExportError
        If a name is unknown.
    ParameterError
        If a value has the wrong shape or is not finite.
    """
    ports = {port.name: port for port in item.inputs()}
    for name in chosen:
        one_of(f"input of '{item.name}'", name, [*ports], ExportError)
    starts = {}
    for name, port in ports.items():
        value = chosen.get(name, plan.system.external[name].start_value())
        what = f"the start of input '{name}' of '{item.name}'"
        starts[name] = finite_array(what, value, port.whole_shape or ()).copy()
    return starts


def _of_port(port: Port) -> Variable:
    """Return the variable of an output."""
    inner = resolved(port)
    frame = f" [frame: {port.frame}]" if port.frame else ""
    # Outputs of sampled blocks change at sample instants only.
    held = not port.is_input and inner.block.sample_time is not None
    return Variable(
        port.name,
        port.whole_shape or (),
        port.element_units(),
        (inner.declaration.meaning + frame).strip(),
        causality="output",
        variability="discrete" if held else "continuous",
    )


def _input(port: Port, starts: Starts) -> Variable:
    start = starts[port.name].ravel()
    return replace(_of_port(port), causality="input", initial="", start=start)


def _of_entry(item: Block, plan: Plan, e: Entry) -> Variable:
    """Return the variable of a parameter, a state or an event."""
    declared = plan.system.blocks[e.path]._declared[e.name]
    unit = declared.unit
    units = unit if isinstance(unit, tuple) else (unit or None,) * (e.stop - e.start)
    return Variable(name_of(item, e), e.shape, units, declared.meaning)


def _parameters(
    item: Block, plan: Plan, p: Vector, tunable: Pattern
) -> Iterator[Variable]:
    for e in plan.p:
        yield replace(
            _of_entry(item, plan, e),
            causality="parameter",
            variability="tunable" if tunable[e.start : e.stop].any() else "fixed",
            initial="exact",
            start=p[e.start : e.stop].copy(),
        )


def _states(
    item: Block, plan: Plan, layout: Layout, values: Vector
) -> Iterator[Variable]:
    setting = setting_blocks(plan)
    for e in layout:
        block = plan.system.blocks[e.path]
        declared = block.declared(State)[e.name]
        # An `initial` that is text names a parameter, from which the state follows.
        of_parameter = (
            isinstance(declared.initial, str) and type(block).initial is Block.initial
        )
        variable = _of_entry(item, plan, e)
        if block not in setting and not of_parameter:
            start = values[e.start : e.stop]
            variable = replace(variable, initial="exact", start=start)
        yield variable


def _indicators(item: Block, plan: Plan) -> Iterator[Variable]:
    for e in plan.sides:
        declared = plan.system.blocks[e.path].declared(Event)[e.name]
        if KINDS[declared.kind] != TIMED:
            variable = _of_entry(item, plan, e)
            yield replace(variable, name=f"{variable.name}.indicator")


def _derivative(state: Variable) -> Variable:
    return Variable(
        f"der({state.name})",
        state.shape,
        tuple(f"({unit})/s" if unit else None for unit in state.units),
        f"rate of {state.name}",
        state=state.reference,
    )
