"""Python blocks: sampled units that the scheduler runs itself, between the compiled steps."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Collection, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import (
    AlgebraicLoopError,
    DivergenceError,
    SimulationError,
    TrussflowError,
)
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.executor import Executor
from trussflow.blocks.tracing.block_check import checked, running_errors
from trussflow.blocks.tracing.evaluation import Active, holds
from trussflow.blocks.tracing.plan import Plan, Quantity, block_inputs


class PythonUnits:
    """The Python blocks of a plan, in the order in which they must compute.

    Parameters
    ----------
    plan : Plan
        The plan.
    sets : sequence of frozenset of Clock
        The sets of clocks that tick together, as numbered by the schedule.

    Raises
    ------
    AlgebraicLoopError
        If Python blocks wait for each other.
    """

    def __init__(self, plan: Plan, sets: list[Active]) -> None:
        self._plan = plan
        self._order: dict[int, list[tuple[Block, Quantity]]] = {}
        for number, active in enumerate(sets):
            blocks = [b for b in plan.python_blocks if plan.system.clock(b) in active]
            self._order[number] = [
                (b, block_inputs(f"inputs_{number}_{i}", b, active))
                for i, b in enumerate(in_order(plan, blocks, active))
            ]
        jumps = any(b.sample_time is None and b.has_events for b in plan.python_blocks)
        self._computes = np.array(
            [bool(self._order[number]) or (jumps and number > 0) for number in range(len(sets))]
        )

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [q for pairs in self._order.values() for _, q in pairs]

    def sequence(self, number: int) -> list[tuple[Block, Quantity]]:
        """Return the blocks that compute when the set of that number ticks, and their inputs."""
        return self._order[number]

    def due(self, number: int) -> bool:
        """Tell whether Python is needed when the set of that number ticks.

        That is where a sampled Python block computes, and at every instant if continuous ones
        have events, which sampled inputs may cause.
        """
        return bool(self._computes[number])

    def next_due(self, due: NDArray[np.uint16]) -> int:
        """Return how many steps to take before Python is needed again."""
        if not self._plan.python_blocks:
            return len(due)
        hits = np.flatnonzero(self._computes[due[1:]])
        return 1 + int(hits[0]) if hits.size else len(due)

    def instant(self, number: int, executor: Executor, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return d after an instant: Python blocks first, then the traced ones.

        The arguments are those of `compute`; outputs that Python blocks hold change in `d`.
        """
        staged = self.compute(number, executor, t, x, d, p)
        updated = executor.call(f"sample_{number}", t, x, d, p)
        for (path, name), value in staged.items():
            self._plan.memory.put(updated, path, name, value)
        return updated

    @contextlib.contextmanager
    def running(self, p: Vector) -> Iterator[None]:
        """Start the blocks, and stop them at the end, whatever ended it."""
        self.start(p)
        try:
            yield
        except BaseException:
            with contextlib.suppress(TrussflowError):  # the first error is the one to see
                self.stop()
            raise
        self.stop()

    def start(self, p: Vector) -> None:
        """Let the blocks go back to the beginning; `stop` must follow.

        Raises
        ------
        SimulationError
            If a block that hides something runs elsewhere already, or its code raises.
        """
        parameters = self._plan.p.unpack(p, np.reshape)
        for block in self._plan.python_blocks:
            if not block.hides:
                continue
            user = block.__dict__.get("_running", lambda: None)()
            if user not in (None, self):
                raise SimulationError(
                    f"block '{block.path}' ({type(block).__name__}) runs elsewhere already, and "
                    "keeps what two runs cannot share; stop the other one, or build a second block"
                )
        for block in self._plan.python_blocks:
            block.__dict__["_running"] = weakref.ref(self)
            own = parameters.get(block.path, Signals(f"block '{block.path}'", {}))
            try:
                with running_errors(block, "on_start", 0.0):
                    block.on_start(own)
            except BaseException:
                with contextlib.suppress(TrussflowError):
                    self.stop()
                raise

    def stop(self) -> None:
        """Let the blocks that were started release everything.

        Raises
        ------
        SimulationError
            If the code of a block raises; the others are stopped all the same.
        """
        faults = []
        for block in self._plan.python_blocks:
            if block.__dict__.get("_running", lambda: None)() is self:
                del block.__dict__["_running"]
                try:
                    with running_errors(block, "on_stop", 0.0):
                        block.on_stop()
                except TrussflowError as error:
                    faults.append(error)
        if faults:
            raise faults[0]

    def save(self) -> dict[str, Any]:
        """Return what the blocks hide, by path.

        Raises
        ------
        SimulationError
            If a block cannot be restored.
        """
        saved = {}
        for block in self._plan.python_blocks:
            if not block.restorable:
                raise SimulationError(
                    f"cannot save: block '{block.path}' ({type(block).__name__}) keeps what it "
                    "cannot hand over; it would have to override on_save() and on_restore()"
                )
            if block.hides:
                with running_errors(block, "on_save", 0.0):
                    saved[block.path] = block.on_save()
        return saved

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Give the blocks back what `save` returned."""
        for block in self._plan.python_blocks:
            if block.path in saved:
                with running_errors(block, "on_restore", 0.0):
                    block.on_restore(saved[block.path])

    def compute(
        self, number: int, executor: Executor, t: float, x: Vector, d: Vector, p: Vector
    ) -> dict[tuple[str, str], Vector]:
        """Run the blocks of one instant; held outputs in `d` change, new memory is returned.

        All outputs are computed before any state is updated.

        Raises
        ------
        SimulationError
            If the code of a block raises; the message names block and time.
        DivergenceError
            If it returns something that is not finite.
        """
        plan = self._plan
        memory: dict[tuple[str, str], Vector] = {}
        held = d[plan.memory.size :]
        parameters = plan.p.unpack(p, np.reshape)
        states = plan.memory.unpack(d[: plan.memory.size].copy(), np.reshape)

        def run(kind: str, block: Block, u: Signals) -> Values:
            none = Signals(f"block '{block.path}'", {})
            own = states.get(block.path, none), u, parameters.get(block.path, none)
            with running_errors(block, kind, t):
                values = checked(block, kind, getattr(block, kind)(np.float64(t), *own))
            _check_finite(block, kind, values, t)
            return values

        for block, quantity in self._order[number]:
            u = split_inputs(block, executor.call(quantity.name, t, x, d, p))
            needed = needed_inputs(plan, block)
            for name in u.keys() - needed:
                u[name] = np.full_like(u[name], np.nan)
            for name, value in run("output", block, u).items():
                plan.held.put(held, block.path, name, value)
        for block, quantity in self._order[number]:
            if block.states() or type(block).update is not Block.update:
                u = split_inputs(block, executor.call(quantity.name, t, x, d, p))
                for name, value in run("update", block, u).items():
                    memory[block.path, name] = value
        return memory


def _check_finite(block: Block, kind: str, values: Values, t: float) -> None:
    """Stop the run at the block that a value comes from that is not finite."""
    for name, value in values.items():
        if not np.isfinite(value).all():
            raise DivergenceError(
                f"'{block.path}.{name}' stopped being finite at t = {t:g} s: {kind}() of that "
                "Python block returned it; the log up to there is kept"
            )


def needed_inputs(plan: Plan, block: Block) -> frozenset[str]:
    """Return the inputs that any output of a Python block depends on within an instant."""
    return frozenset().union(*plan.feedthrough[block.path].values())


def split_inputs(block: Block, flat: Vector) -> Signals:
    """Return a block's inputs from one vector."""
    values, start = {}, 0
    for port in block.inputs():
        shape = port.whole_shape or ()
        values[port.name] = np.reshape(flat[start : start + prod(shape)], shape)
        start += prod(shape)
    return Signals(f"block '{block.path}'", values)


def in_order(plan: Plan, blocks: list[Block], active: Active) -> list[Block]:
    """Order blocks so that each comes after those whose outputs reach it in the same instant.

    Raises
    ------
    AlgebraicLoopError
        If Python blocks wait for each other.
    """
    by_path = {b.path: b for b in blocks}
    graph = {path: list(_sources(plan, block, active, by_path.keys())) for path, block in by_path.items()}
    try:
        return [by_path[path] for path in TopologicalSorter(graph).static_order()]
    except CycleError as error:
        raise AlgebraicLoopError(
            f"algebraic loop through Python blocks: {' -> '.join(error.args[1])}; each needs the "
            "output of the one before at the same instant. Break it with a UnitDelay, or say in "
            "feedthrough() which outputs do not depend on which inputs"
        ) from None


def _sources(plan: Plan, block: Block, active: Active, among: Collection[str]) -> dict[str, None]:
    """Return which Python blocks `among` others a block needs within one instant, in fixed order.

    The way leads back through everything that computes at that instant.
    """
    found: dict[str, None] = {}
    visited: set[tuple[str, str]] = set()
    waiting = [(block.path, name) for name in sorted(needed_inputs(plan, block))]
    while waiting:
        for driver in plan.system.drivers[waiting.pop()]:
            if driver.source is None:
                continue
            source, output = driver.source.block, driver.source.name
            if (source.path, output) in visited:
                continue
            visited.add((source.path, output))
            if source.path in among:
                found[source.path] = None
            elif not holds(plan.system, source, active):
                waiting += [(source.path, i) for i in sorted(plan.feedthrough[source.path][output])]
    return found
