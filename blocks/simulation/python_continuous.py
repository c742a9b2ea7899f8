"""Continuous Python blocks, under the same solver as the traced ones.

Their outputs have places in d, among the held ones. Before anything is evaluated, each of them
is asked for its outputs with the present time, states and inputs, in the order in which they
depend on each other; the traced programs then read them like held values. Outputs in algebraic loops
that are to be solved are found together, by Newton's method with differences. While sampled blocks
compute at an instant, continuous Python blocks still see what these held before.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import DivergenceError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.block_call import BlockCall
from trussflow.blocks.simulation.python_sampled import Evaluates, in_order
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import Quantity, block_inputs

MAX_ROUNDS = 20
"""Rounds of Newton's method after which a loop is given up."""

DIFFERENCE_STEP = 1e-7
"""Step of differences, relative to signals above one [-]."""

LOOP_TOLERANCE = 1e-9
"""Residual of a loop that round-off may leave, relative to its signals [-]."""


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
    circular : bool
        Whether they wait for each other in loops that are to be solved; they are in any order then.

    Raises
    ------
    AlgebraicLoopError
        If they wait for each other in a loop that is not to be solved.
    """

    def __init__(self, plan: Plan) -> None:
        blocks = [b for b in plan.python_blocks if b.sample_time is None]
        blocks, self.circular = in_order(plan, blocks, frozenset())
        self.ordered = [
            (BlockCall(plan, block), block_inputs(f"continuous_{i}", block, frozenset()))
            for i, block in enumerate(blocks)
        ]

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
    _asking: set[str] = field(default_factory=set)  # blocks that want an event after a step

    def refresh(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Put the blocks' outputs into d.

        Raises
        ------
        DivergenceError
            If a loop cannot be solved.
        """
        if self.blocks.circular:
            self._solve(t, x, d, p)
        else:
            self._show(t, x, d, p)

    def _show(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        for call, values in self._each("output", t, x, d, p):
            d[call.outputs] = call.flat("output", values, np.zeros(0))

    def _solve(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Put outputs into d that reproduce themselves."""
        places = np.concatenate([np.r_[call.outputs] for call, _ in self.blocks.ordered])

        def residual(outputs: Vector) -> Vector:
            d[places] = outputs
            self._show(t, x, d, p)
            left: Vector = d[places] - outputs
            return left

        outputs, before = d[places], np.inf
        for _ in range(MAX_ROUNDS):
            left = residual(outputs)
            size = float(np.abs(left).max(initial=0.0))
            allowed = LOOP_TOLERANCE * max(1.0, np.abs(outputs).max())
            if before / 2 <= size <= allowed:  # as good as round-off allows
                return
            before, steps = size, DIFFERENCE_STEP * np.maximum(1.0, np.abs(outputs))
            slopes = [(residual(outputs + step) - left) / step.max() for step in np.diag(steps)]
            if not np.isfinite([*slopes, left]).all():
                break
            change, _, rank, _ = np.linalg.lstsq(np.transpose(slopes), left)
            if rank < outputs.size:  # no solution, or no single one
                break
            outputs = outputs - change
        names = ", ".join(f"'{call.path}'" for call, _ in self.blocks.ordered)
        raise DivergenceError(
            f"cannot solve the algebraic loop through Python blocks at t = {t:g} s, among {names}: Newton's "
            "method finds no single solution; break it with a state, a UnitDelay, or other wiring"
        )

    def rates(self, t: float, x: Vector, d: Vector, p: Vector, into: Vector) -> None:
        """Put the derivatives of the blocks' states into their places `into` all others [as declared]."""
        for call, values in self._each("derivative", t, x, d, p):
            into[call.states] = call.flat("derivative", values, np.zeros(0))

    def indicators(self, t: float, x: Vector, d: Vector, p: Vector, into: Vector) -> None:
        """Put the blocks' indicators into their places `into` all others [as declared]."""
        for call, values in self._each("indicators", t, x, d, p):
            into[call.events] = call.flat("indicators", values, np.zeros(0))

    def accepted(self, t: float, x: Vector, d: Vector, p: Vector) -> bool:
        """Tell all blocks that a step is accepted; return whether one asks for an event."""
        asked = self._each("on_step", t, x, d, p)
        self._asking.update(call.path for call, wanted in asked if wanted)
        return bool(self._asking)

    def handle(self, t: float, x: Vector, d: Vector, p: Vector, into: Vector) -> None:
        """Put states and modes of blocks whose events happen `into` (x, modes) [as declared]."""
        for call, quantity in self.blocks.ordered:
            fired = d[call.fired] > 0.0
            if fired.any() or call.path in self._asking:
                values = self._ask(call, quantity, "on_event", t, x, d, p, call.happened(fired))
                into[call.places(x.size)] = call.flat("on_event", values, call.own(x, d))
        self._asking.clear()

    def _each(self, kind: str, t: float, x: Vector, d: Vector, p: Vector) -> Iterator[tuple[BlockCall, Any]]:
        """Yield each block with what its equation returns; each sees what those before put into d."""
        for call, quantity in self.blocks.ordered:
            if kind != "derivative" or call.size:
                yield call, self._ask(call, quantity, kind, t, x, d, p)

    def _ask(
        self,
        call: BlockCall,
        quantity: Quantity,
        kind: str,
        t: float,
        x: Vector,
        d: Vector,
        p: Vector,
        *more: Signals,
    ) -> Any:
        own = self.equations[call.path]
        before = kind == "on_step" and not own.sees_jumps
        u = self.inner.call(quantity.name, np.nextafter(t, -np.inf) if before else t, x, d, p)
        return call.ask(own, kind, t, call.own(x, d), u, p[call.parameters], *more)
