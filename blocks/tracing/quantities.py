"""Quantities that a run needs from a plan: vectors computed from (t, x, d, p)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.evaluation import Evaluation
from trussflow.blocks.tracing.sorted_order import Active

if TYPE_CHECKING:
    from trussflow.blocks.tracing.plan import Plan


@dataclass(frozen=True, slots=True)
class Quantity:
    """One vector to compute from (t, x, d, p).

    Attributes
    ----------
    name : str
        Name of the traced function.
    active : frozenset of Clock
        The clocks that tick.
    collect : callable
        Returns the arrays of which the vector consists.
    """

    name: str
    active: Active
    collect: Callable[[Evaluation], list[Array]]


def derivative() -> Quantity:
    """Return the quantity dx/dt; it is zero for Python blocks, whose derivatives are added later."""
    return _results("derivative", lambda plan: plan.x)


def indicators() -> Quantity:
    """Return the quantity of all event indicators; they are zero for Python blocks."""
    return _results("indicators", lambda plan: plan.sides)


def _results(kind: str, layout: Callable[[Plan], Layout]) -> Quantity:
    """Return the quantity of the results of an equation, in the order of a layout of the plan."""

    def collect(evaluation: Evaluation) -> list[Array]:
        plan = evaluation.plan
        values: dict[str, Values] = {}
        for path in dict.fromkeys(e.path for e in layout(plan)):
            block = plan.system.blocks[path]
            if block.traced:
                values[path] = evaluation.results(block, kind)
        return [
            values[e.path][e.name] if e.path in values else np.zeros(e.shape)
            for e in layout(plan)
        ]

    return Quantity(kind, frozenset(), collect)


def outputs(
    ports: Sequence[Port], name: str = "outputs", active: Active = frozenset()
) -> Quantity:
    """Return the quantity `name`: the concatenated values of `ports` while `active` clocks tick."""

    def collect(evaluation: Evaluation) -> list[Array]:
        return [evaluation.value(port) for port in ports]

    return Quantity(name, active, collect)


def sample(number: int, active: Active) -> Quantity:
    """Return the quantity d after an instant at which the set `number` of `active` clocks ticks."""

    def collect(evaluation: Evaluation) -> list[Array]:
        plan, leaves = evaluation.plan, evaluation.leaves
        blocks = plan.system.blocks
        after: dict[str, Values] = {**leaves.states}
        for path in dict.fromkeys(e.path for e in plan.memory):
            # Others keep their states; those of Python blocks are updated outside.
            if blocks[path].traced and plan.system.clock_of[path] in active:
                after[path] = evaluation.results(blocks[path], "update")
        return [
            *(leaves.states[e.path][e.name] for e in plan.modes),
            *(after[e.path][e.name] for e in plan.memory),
            *(evaluation.output(blocks[e.path].port(e.name)) for e in plan.held),
            *(leaves.sides[e.path][e.name] for e in plan.sides),
            *(np.zeros(e.shape) for e in plan.fired),
            *guesses().collect(evaluation),
            *(leaves.histories[e.path][e.name] for e in plan.histories),
            *(leaves.held[e.path][e.name] for e in plan.u),
        ]

    return Quantity(f"sample_{number}", active, collect)


def guesses() -> Quantity:
    """Return the quantity of the last solutions of iterated loops, the next initial guesses."""

    def collect(evaluation: Evaluation) -> list[Array]:
        plan = evaluation.plan
        return [
            evaluation.solved.get(
                plan.system.blocks[e.path].port(e.name),
                evaluation.leaves.guesses[e.path][e.name],
            )
            for e in plan.guesses
        ]

    return Quantity("guesses", frozenset(), collect)


def stored() -> Quantity:
    """Return the quantity of the signals with a history."""

    def collect(evaluation: Evaluation) -> list[Array]:
        blocks = evaluation.plan.system.blocks
        return [
            evaluation.value(blocks[e.path].port(blocks[e.path]._declared[e.name].of))
            for e in evaluation.plan.histories
        ]

    return Quantity("stored", frozenset(), collect)


def after_events() -> Quantity:
    """Return the quantity (x, modes) after the events triggered in d; Python blocks keep their values."""

    def collect(evaluation: Evaluation) -> list[Array]:
        plan = evaluation.plan
        after: dict[str, Values] = {**evaluation.leaves.states}
        for path in dict.fromkeys(e.path for e in plan.sides):
            block = plan.system.blocks[path]
            if block.traced:
                before = evaluation.leaves.states[path]
                fired = evaluation.leaves.fired[path].values()
                # The program runs for any event. Blocks without one keep their states,
                # as `on_event` may assume that an event of the block happened.
                happened = sum(np.sum(np.reshape(f, (-1,))) for f in fired) > 0
                results = evaluation.results(block, "on_event")
                after[path] = before | {
                    name: np.where(happened, value, before[name])
                    for name, value in results.items()
                }
        return [
            after[e.path][e.name] for layout in (plan.x, plan.modes) for e in layout
        ]

    return Quantity("on_event", frozenset(), collect)
