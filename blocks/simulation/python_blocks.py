"""The Python blocks of a diagram: their order, and the executor that evaluates them in a run.

Outputs of continuous Python blocks have places in d, among the held ones. Before anything is evaluated,
each block computes its outputs from the present time, states and inputs, in the order in which they depend
on each other. The traced programs then read them like held values. Outputs in algebraic loops that are to
be solved are found together, by Newton's method with differences. While sampled blocks compute at an
instant, continuous Python blocks still see the held outputs of before.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import AlgebraicLoopError, DivergenceError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.simulation.block_instances import (
    BlockCall,
    OpenBlocks,
    SampledStepping,
)
from trussflow.blocks.simulation.executor import Executor, Progress, Span
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.call_checks import running_errors
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import Quantity, block_inputs
from trussflow.blocks.tracing.sorted_order import (
    Active,
    components,
    in_order,
    is_solved,
    reached_from,
)

MAX_NEWTON_ROUNDS = 20
"""Rounds of Newton's method after which a loop is given up."""

DIFFERENCE_STEP = 1e-7
"""Step of differences, relative to signals above one [-]."""

LOOP_TOLERANCE = 1e-9
"""Residual of a loop that round-off may leave, relative to its signals [-]."""

Pair = tuple[BlockCall, Quantity]
"""A Python block, and the quantity that holds its inputs."""


def sorted_stages(
    plan: Plan, blocks: list[Block], active: Active
) -> list[tuple[list[Block], bool]]:
    """Return `blocks` of a `plan` in sorted order: each after those that reach it while `active` clocks tick.

    Blocks in a loop that is to be solved form one stage, all others stages of one block. With each stage
    comes whether it is a loop.

    Raises
    ------
    AlgebraicLoopError
        If Python blocks wait for each other in a loop that is not to be solved.
    """
    by_path = {b.path: b for b in blocks}
    graph: dict[str, list[str]] = {}
    for path in by_path:
        needed = frozenset().union(*plan.feedthrough[path].values())
        graph[path] = reached_from(
            plan.system, plan.feedthrough, path, needed, active, by_path
        )
    stages = []
    for paths in components(graph):
        is_loop = len(paths) > 1 or paths[0] in graph[paths[0]]
        if is_loop and (active or not is_solved(plan.system, paths)):
            _, cycle = in_order(
                {path: [p for p in graph[path] if p in paths] for path in paths}
            )
            raise AlgebraicLoopError(
                f"algebraic loop through Python blocks: {' -> '.join(cycle)}; each needs the "
                "output of the one before at the same instant. Break it with a UnitDelay, make a "
                "Function of what can be traced, say in feedthrough() which outputs do not depend on "
                "which inputs, or, if none of them is sampled, let it be solved: "
                'Diagram(..., loops="solve")'
            )
        stages.append(([by_path[path] for path in paths], is_loop))
    return stages


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
        calls = {
            b.path: BlockCall(plan, b)
            for b in plan.python_blocks
            if b.sample_time is not None
        }
        self.ordered: list[list[Pair]] = []
        for number, active in enumerate(sets):
            ticking = [b for b in plan.python_blocks if plan.system.clock(b) in active]
            blocks = [
                b for stage, _ in sorted_stages(plan, ticking, active) for b in stage
            ]
            self.ordered.append(
                [
                    (calls[b.path], block_inputs(f"inputs_{number}_{i}", b, active))
                    for i, b in enumerate(blocks)
                ]
            )
        traced = {plan.system.clock(b) for b in plan.system.blocks.values() if b.traced}
        self.with_traced = [bool(active & traced) for active in sets]
        self._computes = np.array([bool(pairs) for pairs in self.ordered])

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [quantity for pairs in self.ordered for _, quantity in pairs]

    def needed(self, due: NDArray[np.uint16]) -> list[int]:
        """Return the ticks, of those with these `due` sets, at which Python is needed.

        That is where a sampled Python block computes.
        """
        return (
            np.flatnonzero(self._computes[due]).tolist()
            if self.plan.python_blocks
            else []
        )


class ContinuousPythonBlocks:
    """The continuous Python blocks of a plan.

    Parameters
    ----------
    plan : Plan
        The plan.

    Attributes
    ----------
    stages : list of tuple
        In sorted order, lists of blocks with their inputs, and whether each list is a loop to be solved.
    ordered : list of (BlockCall, Quantity)
        All blocks with their inputs.

    Raises
    ------
    AlgebraicLoopError
        If they wait for each other in a loop that is not to be solved.
    """

    def __init__(self, plan: Plan) -> None:
        self.stages: list[tuple[list[Pair], bool]] = []
        self.ordered: list[Pair] = []
        blocks = [b for b in plan.python_blocks if b.sample_time is None]
        for stage, is_loop in sorted_stages(plan, blocks, frozenset()):
            first = len(self.ordered)
            pairs = [
                (
                    BlockCall(plan, block),
                    block_inputs(f"continuous_{i}", block, frozenset()),
                )
                for i, block in enumerate(stage, first)
            ]
            self.stages.append((pairs, is_loop))
            self.ordered += pairs

    def __bool__(self) -> bool:
        return bool(self.ordered)

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [quantity for _, quantity in self.ordered]


class PythonExecutor(Executor):
    """Evaluates what is traced and the Python blocks around it.

    Everywhere `number` is that of a set of clocks that tick together, `t` the time [s], and `x`, `d`, `p` are
    the continuous states, what changes at instants and the parameters [as declared].

    Parameters
    ----------
    inner : Executor
        Evaluates what is traced.
    sampled : SampledPythonBlocks
        The sampled Python blocks.
    continuous : ContinuousPythonBlocks
        The continuous ones.
    blocks : OpenBlocks
        Both, opened for this run.
    """

    def __init__(
        self,
        inner: Executor,
        sampled: SampledPythonBlocks,
        continuous: ContinuousPythonBlocks,
        blocks: OpenBlocks,
    ) -> None:
        self.name = inner.name
        self.blocks = blocks
        self.plan = inner.plan
        self._inner = inner
        self._sampled = sampled
        self._continuous = continuous
        self._equations = blocks.equations
        self._has_continuous = bool(continuous)
        self._asking: set[str] = set()  # blocks that want an event after a step

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name; outputs of continuous Python blocks change in d."""
        if not self._has_continuous:
            return self._inner.call(name, t, x, d, p)
        self.refresh(t, x, d, p)
        values = self._inner.call(name, t, x, d, p)
        if name in ("derivative", "indicators"):
            self.add(name, t, x, d, p, values)
        elif name == "on_event":
            self._handle(t, x, d, p, values)
        return values

    def advance(
        self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector
    ) -> Progress:
        """Take the steps of a span in place; rows of `log` [as declared] are filled in order."""
        if self._has_continuous:
            return super().advance(span, x, d, p, log)
        return self._inner.advance(span, x, d, p, log)

    def instant(
        self,
        number: int,
        t: float,
        x: Vector,
        d: Vector,
        p: Vector,
        *,
        update: bool = True,
    ) -> Vector:
        """Return d after an instant: Python blocks first, then the traced ones."""
        ticking = self._sampled.ordered[number]
        for call, quantity in ticking:
            d[call.outputs] = self._sampled_output(call, quantity, t, x, d, p)
        # All outputs are there by now: no state is updated before all have seen it.
        staged = (
            [self._updated(call, quantity, t, x, d, p) for call, quantity in ticking]
            if update
            else []
        )
        # Where Python blocks alone are sampled there is nothing to evaluate.
        traced = self._sampled.with_traced[number]
        after = self.call(f"sample_{number}", t, x, d, p) if traced else d.copy()
        for place, states in staged:
            after[place] = states
        return after

    # -- sampled blocks -----------------------------------------------------------------------

    def _sampled_output(
        self,
        call: BlockCall,
        quantity: Quantity,
        t: float,
        x: Vector,
        d: Vector,
        p: Vector,
    ) -> Vector:
        """Return the outputs of a sampled block at an instant."""
        own = self._equations[call.path]
        # without feedthrough, inputs may be unknown
        u = np.full(call.needed.size, np.nan)
        if call.direct:
            u = self.call(quantity.name, t, x, d, p)
        if isinstance(own, SampledStepping):
            with running_errors(call.block, "advance", t):
                outputs = own.reach(t, u)
        else:
            outputs = call(
                own,
                "output",
                t,
                d[call.states].copy(),
                call.seen(u),
                p[call.parameters],
            )
        return self._finite(call, "output", outputs, t)

    def _updated(
        self,
        call: BlockCall,
        quantity: Quantity,
        t: float,
        x: Vector,
        d: Vector,
        p: Vector,
    ) -> tuple[slice, Vector]:
        """Return the new states of a sampled block after an instant, and where in d they belong."""
        own = self._equations[call.path]
        if isinstance(own, SampledStepping):
            with running_errors(call.block, "set", t):
                own.hold(self.call(quantity.name, t, x, d, p))
        elif call.size or own.states_own("update"):
            u = self.call(quantity.name, t, x, d, p)
            states = call(
                own, "update", t, d[call.states].copy(), u, p[call.parameters]
            )
            return call.states, self._finite(call, "update", states, t)
        return slice(0), np.zeros(0)

    def _finite(self, call: BlockCall, kind: str, values: Vector, t: float) -> Vector:
        """Return finite `values`; stop the run at the block that returned others."""
        if np.isfinite(values).all():
            return values
        plan = self._sampled.plan
        layout = plan.held if kind == "output" else plan.memory
        entry = layout.at(
            layout.span_of(call.path).start + int(np.argmin(np.isfinite(values)))
        )
        raise DivergenceError(
            f"'{entry.path}.{entry.name}' stopped being finite at t = {t:g} s: {kind}() of that Python "
            "block returned it; the log up to there is kept"
        )

    # -- continuous blocks --------------------------------------------------------------------

    def refresh(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Put the outputs of continuous blocks into d.

        Raises
        ------
        DivergenceError
            If a loop cannot be solved.
        """
        for pairs, is_loop in self._continuous.stages:
            if is_loop:
                self._solve(pairs, t, x, d, p)
            else:
                self._show(pairs, t, x, d, p)

    def _show(
        self, pairs: list[Pair], t: float, x: Vector, d: Vector, p: Vector
    ) -> None:
        for call, quantity in pairs:  # each sees what those before put into d
            values = self._ask(call, quantity, "output", t, x, d, p)
            d[call.outputs] = call.flat("output", values, np.zeros(0))

    def _solve(
        self, pairs: list[Pair], t: float, x: Vector, d: Vector, p: Vector
    ) -> None:
        """Put outputs into d that reproduce themselves."""
        places = np.concatenate([np.r_[call.outputs] for call, _ in pairs])

        def residual(outputs: Vector) -> Vector:
            d[places] = outputs
            self._show(pairs, t, x, d, p)
            left: Vector = d[places] - outputs
            return left

        outputs = d[places]
        before = np.inf
        for _ in range(MAX_NEWTON_ROUNDS):
            left = residual(outputs)
            size = float(np.abs(left).max(initial=0.0))
            allowed = LOOP_TOLERANCE * max(1.0, np.abs(outputs).max())
            if before / 2 <= size <= allowed:  # as good as round-off allows
                return
            before = size
            steps = DIFFERENCE_STEP * np.maximum(1.0, np.abs(outputs))
            slopes = [
                (residual(outputs + step) - left) / step.max()
                for step in np.diag(steps)
            ]
            if not np.isfinite([*slopes, left]).all():
                break
            change, _, rank, _ = np.linalg.lstsq(np.transpose(slopes), left)
            if rank < outputs.size:  # no solution, or no single one
                break
            outputs = outputs - change
        names = ", ".join(f"'{call.path}'" for call, _ in pairs)
        raise DivergenceError(
            f"cannot solve the algebraic loop through Python blocks at t = {t:g} s, among {names}: Newton's "
            "method finds no single solution; break it with a state, a UnitDelay, or other wiring"
        )

    def add(
        self, kind: str, t: float, x: Vector, d: Vector, p: Vector, into: Vector
    ) -> None:
        """Put derivatives or indicators, by `kind`, of the blocks `into` those of all [as declared]."""
        for call, quantity in self._continuous.ordered:
            if kind != "derivative" or call.size:
                values = self._ask(call, quantity, kind, t, x, d, p)
                into[call.states if kind == "derivative" else call.events] = call.flat(
                    kind, values, np.zeros(0)
                )

    def accepted(self, t: float, x: Vector, d: Vector, p: Vector) -> bool:
        """Tell Python blocks that a step is accepted; return whether one asks for an event."""
        for call, quantity in self._continuous.ordered:
            if self._ask(call, quantity, "on_step", t, x, d, p):
                self._asking.add(call.path)
        return bool(self._asking)

    def _handle(self, t: float, x: Vector, d: Vector, p: Vector, into: Vector) -> None:
        """Put states and modes of blocks whose events happen `into` (x, modes) [as declared]."""
        for call, quantity in self._continuous.ordered:
            fired = d[call.fired] > 0.0
            if fired.any() or call.path in self._asking:
                values = self._ask(
                    call, quantity, "on_event", t, x, d, p, call.happened(fired)
                )
                into[call.places(x.size)] = call.flat(
                    "on_event", values, call.own(x, d)
                )
        self._asking.clear()

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
        """Return what an equation of a continuous block returns, unchecked."""
        own = self._equations[call.path]
        before = kind == "on_step" and not own.sees_jumps
        u = self._inner.call(
            quantity.name, np.nextafter(t, -np.inf) if before else t, x, d, p
        )
        return call.ask(own, kind, t, call.own(x, d), u, p[call.parameters], *more)
