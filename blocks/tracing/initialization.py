"""Symbolic initial states, which an FMU or a page computes without Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from trussflow.blocks.errors import TracingError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.layout import BlockSignals
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.call_checks import tracing_errors
from trussflow.blocks.tracing.evaluation import Evaluation, Leaves
from trussflow.blocks.tracing.kernels import (
    column_of,
    from_expression,
    shape_of,
    to_expression,
    tracing,
)
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import lower
from trussflow.blocks.tracing.quantities import Quantity
from trussflow.blocks.tracing.sparsity import product, sparsity

States = dict[tuple[str, str], Array]
"""Values of states by path of the block and name."""


class InitialCycleError(TracingError):
    """Initial states depend on themselves in a cycle."""


def initialization() -> Quantity:
    """Return the quantity that maps (x, modes, memory) before initialization to initial values.

    States whose initial value is a number are not changed, so that an importer can set them. Other
    states follow from parameters and inputs, as in `Plan.initial`.
    """

    def collect(evaluation: Evaluation) -> list[Array]:
        plan = evaluation.plan
        values = {
            (path, name): _start(plan, path, name, evaluation.leaves)
            for layout in plan.stored
            for path, name in layout.entries
        }
        for _ in range(_rounds(plan, evaluation)):
            values |= _set_by_blocks(plan, evaluation, values)
        return list(values.values())

    return Quantity("initialization", frozenset(), collect)


def setting_blocks(plan: Plan) -> list[Block]:
    """Return the blocks that set initial states from their inputs."""
    blocks = plan.system.blocks.values()
    return [b for b in blocks if b.states_own("initial_state")]


def _rounds(plan: Plan, evaluation: Evaluation) -> int:
    """Return the number of rounds after which all blocks have set their final initial states.

    Raises
    ------
    InitialCycleError
        If initial states depend on each other in a cycle.
    """
    if not setting_blocks(plan):
        return 0
    leaves = evaluation.leaves
    before = {
        (path, n): value
        for path, signals in leaves.states.items()
        for n, value in signals.items()
    }
    with tracing() as trace:  # separate: these expressions only give the dependencies
        after = _set_by_blocks(plan, evaluation, before)
    others = [value for key, value in before.items() if key not in after]
    others += [
        v
        for group in (leaves.held, leaves.parameters)
        for s in group.values()
        for v in s.values()
    ]
    arguments = [
        column_of(before[key] for key in after),
        column_of([leaves.t, *others]),
    ]
    depends = sparsity(
        lower("initial_states", arguments, column_of(after.values()), trace)
    )[0]
    # By element: two blocks may use each other's signals if no element depends on itself.
    chains = depends  # chains of `rounds` dependencies
    in_cycle = np.zeros(len(depends), dtype=bool)
    # Without a cycle, no chain is longer than the number of elements.
    for rounds in range(1, 2 + len(depends)):
        if not chains.any():
            return rounds
        in_cycle |= chains.diagonal()
        chains = product(chains, depends)
    owners = [
        path
        for (path, name), value in after.items()
        for _ in range(column_of([value]).numel())
    ]
    circle = dict.fromkeys(owners[i] for i in np.flatnonzero(in_cycle))
    names = ", ".join(
        f"'{path}' ({type(plan.system.blocks[path]).__name__})" for path in circle
    )
    raise InitialCycleError(
        f"the initial states of {names} depend on themselves in a cycle; "
        "let one of them start at a value or parameter of its own"
    )


def _set_by_blocks(
    plan: Plan, evaluation: Evaluation, values: Mapping[tuple[str, str], Array]
) -> States:
    """Return the initial states that blocks set, given the states `values` so far."""
    leaves = evaluation.leaves
    system = plan.system
    outside = {block.path for block in system.external.values()}
    states, held = BlockSignals(), BlockSignals(leaves.held)
    for path, s in leaves.states.items():
        states[path] = Signals(s.owner, {n: values.get((path, n), s[n]) for n in s})
    for path, s in leaves.held.items():
        if path not in outside:
            # Before their first sample, outputs of sampled blocks are zero.
            held[path] = Signals(s.owner, {n: _zeros(v) for n, v in s.items()})
    # These clocks tick at the start; others keep their held outputs.
    active = frozenset(clock for clock in system.clocks if clock.offset == 0)
    first = replace(leaves, states=states, held=held)
    now = Evaluation(plan, first, active)
    now.compute(plan.order(active))
    after: States = {}
    for block in setting_blocks(plan):
        with tracing_errors(block):
            started = block.initial_state(
                now.inputs(block), leaves.parameters[block.path]
            )
        after |= {
            (block.path, name): _broadcast(v, block.state_shape(name))
            for name, v in started.items()
        }
    return after


def _start(plan: Plan, path: str, name: str, leaves: Leaves) -> Array:
    """Return the initial value of a state: its leaf, or the parameter that declares it."""
    block = plan.system.blocks[path]
    declared = block._declared[name].initial
    if type(block).initial is not Block.initial or not isinstance(declared, str):
        return leaves.states[path][name]
    return _broadcast(leaves.parameters[path][declared], block.state_shape(name))


def _zeros(value: Array) -> Array:
    return from_expression(ca.SX.zeros(to_expression(value).numel()), shape_of(value))


def _broadcast(value: Array, shape: tuple[int, ...]) -> Array:
    if shape_of(value) == shape:
        return value
    if shape_of(value) and np.prod(shape_of(value)) == 1:
        # Else a size-1 array would widen the shape: (1, 1) + (3,) gives (1, 3).
        value = np.reshape(value, ())
    return value + np.zeros(shape)
