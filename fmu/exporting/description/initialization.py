"""Initial states as expressions, so that an FMU can compute them without Python."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.layout import Entry
from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.block_check import tracing_errors
from trussflow.blocks.tracing.evaluation import Evaluation
from trussflow.blocks.tracing.plan import Plan, Quantity
from trussflow.blocks.tracing.tracing import from_expression, shape_of, to_expression


def initialization() -> Quantity:
    """Return the quantity (x, memory) at the start, from the same before initialization.

    States whose initial value is a plain number stay what they are, so that an importer can
    set them; the others follow from parameters and inputs, as in `Plan.initial`.
    """

    def collect(plan: Plan, evaluation: Evaluation) -> list[Array]:
        values = {(e.path, e.name): _start(plan, e, evaluation) for e in _states(plan)}
        leaves = evaluation.leaves
        t = leaves.t
        u = _flat([leaves.held[e.path][e.name] for e in plan.u])
        p = _flat([leaves.parameters[e.path][e.name] for e in plan.p])
        setting = setting_blocks(plan)
        active = frozenset(c for c in plan.system.clocks if c.offset == 0)
        for _ in setting:  # one may depend on the next: as many rounds as it takes
            for block in setting:
                x = _flat([values[e.path, e.name] for e in plan.x])
                memory = _flat([values[e.path, e.name] for e in plan.memory])
                d = ca.vertcat(memory, ca.SX.zeros(plan.held.size), u)
                now = plan._evaluation(t, x, d, p, from_expression, active)
                parameters = now.leaves.parameters[block.path]
                with tracing_errors(block):
                    found = block.initial_state(now.inputs(block), parameters)
                for name, value in found.items():
                    values[block.path, name] = _broadcast(value, block.state_shape(name))
        return [values[e.path, e.name] for e in _states(plan)]

    return Quantity("initialization", frozenset(), collect)


def setting_blocks(plan: Plan) -> list[Block]:
    """Return the blocks that set initial states from their inputs."""
    blocks = plan.system.blocks.values()
    return [b for b in blocks if type(b).initial_state is not Block.initial_state]


def _states(plan: Plan) -> Iterator[Entry]:
    yield from plan.x
    yield from plan.memory


def _start(plan: Plan, entry: Entry, evaluation: Evaluation) -> Array:
    """Return the initial value of a state: its leaf, or the parameter that holds it."""
    block = plan.system.blocks[entry.path]
    declared = block.states()[entry.name].initial
    if type(block).initial is not Block.initial or not isinstance(declared, str):
        return evaluation.leaves.states[entry.path][entry.name]
    return _broadcast(evaluation.leaves.parameters[entry.path][declared], entry.shape)


def _broadcast(value: Array, shape: tuple[int, ...]) -> Array:
    if shape_of(value) == shape:
        return value
    if shape_of(value) and np.prod(shape_of(value)) == 1:
        value = np.reshape(value, ())
    return value + np.zeros(shape)


def _flat(arrays: list[Array]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *map(to_expression, arrays))
