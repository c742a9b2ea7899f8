"""Live blocks: Python blocks with continuous states, under the same solver as the traced ones.

Their outputs have places in d, among the held ones. Before anything is evaluated, each live
block is asked for its outputs with the present time, states and inputs, in the order in which
they depend on each other; the traced programs then read them like held values. While sampled
blocks compute at an instant, live blocks still see what these held before.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import finite_array
from trussflow.blocks.simulation.events import EventWatch
from trussflow.blocks.simulation.executor import Executor, SteppingInPython, step
from trussflow.blocks.simulation.python_sampled import in_order, split_inputs
from trussflow.blocks.tracing.block_check import checked, running_errors
from trussflow.blocks.tracing.plan import Plan, Quantity, block_inputs


class LiveBlocks:
    """The live blocks of a plan.

    Parameters
    ----------
    plan : Plan
        The plan.

    Attributes
    ----------
    have_events : bool
        Whether any of them has a hook for events.

    Raises
    ------
    AlgebraicLoopError
        If live blocks wait for each other.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        blocks = [b for b in plan.python_blocks if b.sample_time is None]
        self._blocks = [
            (block, block_inputs(f"live_{i}", block, frozenset()))
            for i, block in enumerate(in_order(plan, blocks, frozenset()))
        ]
        self._entries = {b.path: (plan.x.of(b.path), plan.p.of(b.path)) for b in blocks}
        self.have_events = any(block.has_events for block in blocks)

    def __bool__(self) -> bool:
        return bool(self._blocks)

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [quantity for _, quantity in self._blocks]

    def ordered(self) -> list[tuple[Block, Quantity]]:
        """Return the blocks, each after those whose outputs it needs, and their inputs."""
        return list(self._blocks)

    def next_event(self) -> float:
        """Return the time of the next time event [s]."""
        return min((_next_event(block) for block, _ in self._blocks), default=math.inf)

    def refresh(self, executor: Executor, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Put the blocks' outputs into d."""
        held = d[self._plan.memory.size :]
        for block, quantity in self._blocks:
            values = self._ask("output", block, quantity, (executor, t, x, d, p))
            for name, value in checked(block, "output", values).items():
                self._plan.held.put(held, block.path, name, value)

    def rates(self, executor: Executor, t: float, x: Vector, d: Vector, p: Vector, into: Vector) -> None:
        """Put the derivatives of the blocks' states into their places among all others."""
        for block, quantity in self._blocks:
            values = self._ask("derivative", block, quantity, (executor, t, x, d, p))
            for name, value in checked(block, "derivative", values).items():
                self._plan.x.put(into, block.path, name, value)

    def indicators(self, executor: Executor, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return all event indicators, one after the other."""
        found = [np.zeros(0)]
        for block, quantity in self._blocks:
            values = self._ask("indicators", block, quantity, (executor, t, x, d, p))
            found.append(np.ravel(finite_array(f"indicators() of block '{block.path}'", values)))
        return np.concatenate(found)

    def accepted(self, executor: Executor, t: float, x: Vector, d: Vector, p: Vector) -> bool:
        """Tell all blocks that a step is accepted; return whether one asks for an event."""
        asked = [
            bool(self._ask("on_step", block, quantity, (executor, t, x, d, p)))
            for block, quantity in self._blocks
        ]
        return any(asked)

    def handle(self, executor: Executor, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Let all blocks handle an event; return the states after it."""
        after = x.copy()
        for block, quantity in self._blocks:
            values = self._ask("on_event", block, quantity, (executor, t, x, d, p))
            for name, value in checked(block, "on_event", values).items():
                self._plan.x.put(after, block.path, name, value)
        return after

    def _ask(
        self, kind: str, block: Block, quantity: Quantity, at: tuple[Executor, float, Vector, Vector, Vector]
    ) -> Any:
        """Call one of a block's functions with the numbers of an instant."""
        executor, t, x, d, p = at
        u = split_inputs(block, executor.call(quantity.name, t, x, d, p))
        states, parameters = (
            Signals(
                f"block '{block.path}'", {e.name: flat[e.start : e.stop].reshape(e.shape) for e in entries}
            )
            for entries, flat in zip(self._entries[block.path], (x, p), strict=True)
        )
        with running_errors(block, kind, t):
            return getattr(block, kind)(np.float64(t), states, u, parameters)


def _next_event(block: Block) -> float:
    """Return the time of the next time event of a block [s].

    Raises
    ------
    SimulationError
        If it is no time.
    """
    returned = block.next_event()
    try:
        time = float(returned)
    except (TypeError, ValueError):
        time = math.nan
    if math.isnan(time):
        raise SimulationError(
            f"next_event() of block '{block.path}' returned {returned!r}; it must be a time, or math.inf"
        )
    return time


class LiveExecutor(SteppingInPython):
    """An executor that asks live blocks before it evaluates, and steps from event to event.

    Parameters
    ----------
    inner : Executor
        Evaluates what is traced.
    live : LiveBlocks
        The live blocks.
    """

    def __init__(self, inner: Executor, live: LiveBlocks) -> None:
        self.name = inner.name
        self._inner, self._live = inner, live
        self._before: tuple[float, Vector, Vector, Vector] | None = None

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name; outputs of live blocks change in `d`."""
        self._live.refresh(self._inner, t, x, d, p)
        values = self._inner.call(name, t, x, d, p)
        if name == "derivative":
            self._live.rates(self._inner, t, x, d, p, values)
        return values

    def watch(self, d: Vector, p: Vector) -> EventWatch | None:
        """Return what finds and handles events while d and p stay the same, if there are any."""
        if not self._live.have_events:
            return None

        def fresh(function: Any) -> Any:
            def asked(t: float, x: Vector) -> Any:
                self._live.refresh(self._inner, t, x, d, p)
                return function(self._inner, t, x, d, p)

            return asked

        def before(t: float, x: Vector) -> Vector | None:
            return self._before[3] if self._noted(t, x, d) and self._before else None

        return EventWatch(
            indicators=fresh(self._live.indicators),
            accepted=fresh(self._live.accepted),
            handle=fresh(self._live.handle),
            next_time=self._live.next_event,
            before=before,
        )

    def before_jump(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Keep the indicators' signs: what changed them at one time is one jump."""
        if self._live.have_events and not self._noted(t, x, d):
            self._live.refresh(self._inner, t, x, d, p)
            signs = np.sign(self._live.indicators(self._inner, t, x, d, p))
            self._before = t, x.copy(), d, signs

    def _noted(self, t: float, x: Vector, d: Vector) -> bool:
        """Tell whether signs were kept here already; `d` itself tells runs from each other."""
        kept = self._before
        return kept is not None and kept[0] == t and kept[2] is d and np.array_equal(kept[1], x)

    def between(
        self, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
    ) -> Vector:
        """Return the state after a step of any length, taken in parts if there are events in it."""
        t, end, _ = times
        watch = self.watch(d, p)
        if watch is None:
            return step(self, method, times, x, d, p)
        x = watch.begin(t, x)
        while t < end:
            stop, start = min(end, watch.next_time()), x

            def state(time: float, t: float = t, start: Vector = start) -> Vector:
                return step(self, method, (t, time, time - t), start, d, p)

            x = state(stop)
            if not np.isfinite(x).all():
                return x
            event = watch.after_step(t, stop, x, state)
            t, x = (stop, x) if event is None else (event[0], watch.handle_event(*event))
            x = watch.due(t, x)
        return x
