"""Continuous Python blocks, under the same solver as the traced ones.

Their outputs have places in d, among the held ones. Before anything is evaluated, each of them
is asked for its outputs with the present time, states and inputs, in the order in which they
depend on each other; the traced programs then read them like held values. While sampled blocks
compute at an instant, continuous Python blocks still see what these held before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import finite_array
from trussflow.blocks.simulation.block_call import BlockCall
from trussflow.blocks.simulation.python_sampled import Evaluates, in_order
from trussflow.blocks.tracing.plan import Plan, Quantity, block_inputs


class ContinuousPythonBlocks:
    """The continuous Python blocks of a plan.

    Parameters
    ----------
    plan : Plan
        The plan.

    Attributes
    ----------
    ordered : list of (BlockCall, Quantity)
        The blocks, each after those whose outputs it needs, and their inputs.
    have_events : bool
        Whether any of them has events.

    Raises
    ------
    AlgebraicLoopError
        If they wait for each other.
    """

    def __init__(self, plan: Plan) -> None:
        blocks = [b for b in plan.python_blocks if b.sample_time is None]
        self.ordered = [
            (BlockCall(plan, block), block_inputs(f"continuous_{i}", block, frozenset()))
            for i, block in enumerate(in_order(plan, blocks, frozenset()))
        ]
        self.have_events = any(block.has_events for block in blocks)

    def __bool__(self) -> bool:
        return bool(self.ordered)

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [quantity for _, quantity in self.ordered]


@dataclass(frozen=True, slots=True)
class ContinuousInRun:
    """The continuous `blocks` in one run, at time `t` [s] with `x`, `d` and `p` [as declared].

    The `equations` and `inner` are as for `SampledInRun`.
    """

    blocks: ContinuousPythonBlocks
    equations: Mapping[str, Equations]
    inner: Evaluates

    def refresh(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Put the blocks' outputs into d."""
        for call, values in self._each("output", t, x, d, p):
            d[call.outputs] = call.flat("output", values, x[call.states])

    def rates(self, t: float, x: Vector, d: Vector, p: Vector, into: Vector) -> None:
        """Put the derivatives of the blocks' states into their places `into` all others [as declared]."""
        for call, values in self._each("derivative", t, x, d, p):
            into[call.states] = call.flat("derivative", values, x[call.states])

    def indicators(self, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return all event indicators, one after the other."""
        asked = self._each("indicators", t, x, d, p)
        parts = [np.ravel(finite_array(f"indicators() of block '{c.path}'", v)) for c, v in asked]
        return np.concatenate([np.zeros(0), *parts])

    def accepted(self, t: float, x: Vector, d: Vector, p: Vector) -> bool:
        """Tell all blocks that a step is accepted; return whether one asks for an event."""
        asked = [bool(wanted) for _, wanted in self._each("on_step", t, x, d, p)]  # all are told
        return any(asked)

    def handle(self, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Let all blocks handle an event; return the states after it."""
        after = x.copy()
        for call, values in self._each("on_event", t, x, d, p):
            after[call.states] = call.flat("on_event", values, x[call.states])
        return after

    def next_event(self) -> float:
        """Return the time of the next time event [s].

        Raises
        ------
        SimulationError
            If a block says what is no time.
        """
        times = [math.inf]
        for call, _ in self.blocks.ordered:
            said = self.equations[call.path].next_event()
            try:
                times.append(float(said))
            except (TypeError, ValueError):
                times.append(math.nan)
            if math.isnan(times[-1]):
                raise SimulationError(
                    f"next_event() of block '{call.path}' returned {said!r}; it must be a time, or math.inf"
                )
        return min(times)

    def _each(self, kind: str, t: float, x: Vector, d: Vector, p: Vector) -> Iterator[tuple[BlockCall, Any]]:
        """Yield each block with what its equation returns; each sees what those before put into d."""
        for call, quantity in self.blocks.ordered:
            u = self.inner.call(quantity.name, t, x, d, p)
            own = self.equations[call.path]
            yield call, call.ask(own, kind, t, x[call.states].copy(), u, p[call.parameters])
