"""Sampled Python blocks: in which order they compute at an instant, and how."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import AlgebraicLoopError, DivergenceError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.block_call import BlockCall
from trussflow.blocks.simulation.open_blocks import SampledStepping
from trussflow.blocks.tracing.calling import running_errors
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import Quantity, block_inputs
from trussflow.blocks.tracing.sorted_order import Active, is_solved, reached_from


class Evaluates(Protocol):
    """Executor of the quantities of a plan."""

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that `name` at time `t` [s] with `x`, `d` and `p` [as declared]."""
        ...


class SampledPythonBlocks:
    """The sampled Python blocks of a plan, in the order in which they must compute.

    Parameters
    ----------
    plan : Plan
        The plan.
    sets : sequence of frozenset of Clock
        The sets of clocks that tick together, as numbered by the schedule.

    Attributes
    ----------
    ordered : list of list of (BlockCall, Quantity)
        For each set, the blocks that compute when it ticks, in order, and their inputs.
    with_traced : list of bool
        For each set, whether traced blocks are sampled too.

    Raises
    ------
    AlgebraicLoopError
        If Python blocks wait for each other.
    """

    def __init__(self, plan: Plan, sets: list[Active]) -> None:
        self.plan = plan
        calls = {b.path: BlockCall(plan, b) for b in plan.python_blocks if b.sample_time is not None}
        self.ordered: list[list[tuple[BlockCall, Quantity]]] = []
        for number, active in enumerate(sets):
            blocks = [b for b in plan.python_blocks if plan.system.clock(b) in active]
            self.ordered.append(
                [
                    (calls[b.path], block_inputs(f"inputs_{number}_{i}", b, active))
                    for i, b in enumerate(in_order(plan, blocks, active)[0])
                ]
            )
        traced = {plan.system.clock(b) for b in plan.system.blocks.values() if b.traced}
        if plan.counters.size:  # the shared program also counts ticks of clocks without traced blocks
            traced |= {*plan.system.clocks}
        self.with_traced = [bool(active & traced) for active in sets]
        self._computes = np.array([bool(pairs) for pairs in self.ordered])

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [quantity for pairs in self.ordered for _, quantity in pairs]

    def needed(self, due: NDArray[np.uint16]) -> list[int]:
        """Return the ticks, of those with these `due` sets, at which Python is needed.

        That is where a sampled Python block computes.
        """
        return np.flatnonzero(self._computes[due]).tolist() if self.plan.python_blocks else []


@dataclass(frozen=True, slots=True)
class SampledInRun:
    """The sampled Python blocks in one run, at an instant.

    There `number` is that of the set of clocks that tick, `t` the time [s], and `x`, `d` and `p` are
    as the plan lays them out [as declared].

    Attributes
    ----------
    blocks : SampledPythonBlocks
        The blocks.
    equations : mapping of str to Equations
        Equation objects of these blocks in this run, keyed by block path.
    inner : Evaluates
        Evaluates their inputs.
    """

    blocks: SampledPythonBlocks
    equations: Mapping[str, Equations]
    inner: Evaluates

    def show(self, number: int, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Put the outputs of the blocks of one instant into d, one block after the other.

        Raises
        ------
        SimulationError
            If the code of a block raises; the message names block and time.
        DivergenceError
            If it returns something that is not finite.
        """
        for call, quantity in self._ticking(number, d):
            own = self.equations[call.path]
            u = np.full(call.needed.size, np.nan)  # what shows nothing of them at once need not know them
            if call.direct:
                u = self.inner.call(quantity.name, t, x, d, p)
            if isinstance(own, SampledStepping):
                with running_errors(call.block, "advance", t):
                    outputs = own.reach(t, u)
            else:
                outputs = call(own, "output", t, d[call.states].copy(), call.seen(u), p[call.parameters])
            d[call.outputs] = self._finite(call, "output", outputs, t)

    def update(self, number: int, t: float, x: Vector, d: Vector, p: Vector) -> list[tuple[slice, Vector]]:
        """Return the new states of the blocks of one instant, and where in d they belong.

        All outputs are there by now: no state is updated before all have seen it.

        Raises
        ------
        SimulationError
            If the code of a block raises; the message names block and time.
        DivergenceError
            If it returns something that is not finite.
        """
        updated = []
        for call, quantity in self._ticking(number, d):
            own = self.equations[call.path]
            if isinstance(own, SampledStepping):
                with running_errors(call.block, "set", t):
                    own.hold(self.inner.call(quantity.name, t, x, d, p))
            elif call.size or own.states_own("update"):
                u = self.inner.call(quantity.name, t, x, d, p)
                states = call(own, "update", t, d[call.states].copy(), u, p[call.parameters])
                updated.append((call.states, self._finite(call, "update", states, t)))
        return updated

    def _ticking(self, number: int, d: Vector) -> list[tuple[BlockCall, Quantity]]:
        """Return the blocks of a set, in order, but for those whose clocks do not tick."""
        plan, pairs = self.blocks.plan, self.blocks.ordered[number]
        waiting = plan.counters.waiting(d)
        return [pair for pair in pairs if plan.system.clock(pair[0].block) not in waiting]

    def _finite(self, call: BlockCall, kind: str, values: Vector, t: float) -> Vector:
        """Stop the run at the block that a value comes from that is not finite."""
        if np.isfinite(values).all():
            return values
        plan = self.blocks.plan
        layout = plan.held if kind == "output" else plan.memory
        entry = layout.at(layout.span_of(call.path).start + int(np.argmin(np.isfinite(values))))
        raise DivergenceError(
            f"'{entry.path}.{entry.name}' stopped being finite at t = {t:g} s: {kind}() of that Python "
            "block returned it; the log up to there is kept"
        )


def in_order(plan: Plan, blocks: list[Block], active: Active) -> tuple[list[Block], bool]:
    """Order `blocks` of a `plan`: each after those that reach it while `active` clocks tick.

    Return as well whether they reach themselves, in a loop that is to be solved; they are not ordered then.

    Raises
    ------
    AlgebraicLoopError
        If Python blocks wait for each other.
    """
    by_path = {b.path: b for b in blocks}
    graph = {}
    for path in by_path:
        needed = frozenset().union(*plan.feedthrough[path].values())
        graph[path] = reached_from(plan.system, plan.feedthrough, path, needed, active, by_path)
    try:
        return [by_path[path] for path in TopologicalSorter(graph).static_order()], False
    except CycleError as error:
        if not active and is_solved(plan.system, error.args[1]):
            return blocks, True
        raise AlgebraicLoopError(
            f"algebraic loop through Python blocks: {' -> '.join(error.args[1])}; each needs the "
            "output of the one before at the same instant. Break it with a UnitDelay, make a Function of "
            "what can be traced, say in feedthrough() which outputs do not depend on which inputs, or, if "
            'none of them is sampled, let it be solved: Diagram(..., loops="solve")'
        ) from None
