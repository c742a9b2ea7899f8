"""Evaluation of a flat system: every signal as an expression or a number, from the leaves.

The same code serves tracing (leaves are symbols) and plain NumPy (leaves are numbers).
Outputs are evaluated port by port, with only the inputs that have feedthrough to the port. So a loop
through a block is legal if only another output of that block has direct feedthrough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from trussflow.blocks.errors import AlgebraicLoopError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.layout import BlockSignals
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Driver
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.call_checks import (
    checked,
    equation,
    running_errors,
    tracing_errors,
)
from trussflow.blocks.tracing.kernels import (
    active_trace,
    column_of,
    from_expression,
    is_traced,
    symbol,
    written_out,
)
from trussflow.blocks.tracing.newton import MAX_ITERATED_UNKNOWNS, solve
from trussflow.blocks.tracing.sorted_order import Active, Stage, by_port, laid_out

if TYPE_CHECKING:
    from trussflow.blocks.tracing.plan import Plan


@dataclass(frozen=True, slots=True)
class Leaves:
    """Independent variables of an evaluation; symbols or numbers.

    Attributes
    ----------
    t : array, shape ()
        Time [s].
    states, held, parameters : BlockSignals
        States and modes, held outputs of sampled blocks, and parameters, by block path.
    fired, sides : BlockSignals
        Triggered events, and signs of the event indicators, by block path.
    guesses, histories : BlockSignals
        Initial guesses of the signals of algebraic loops, and stored inputs, by block path.
    """

    t: Array
    states: BlockSignals
    held: BlockSignals
    parameters: BlockSignals
    fired: BlockSignals
    sides: BlockSignals
    guesses: BlockSignals
    histories: BlockSignals


@dataclass(eq=False)
class Evaluation:
    """All signals of a system at one instant.

    Attributes
    ----------
    plan : Plan
        The flat diagram with its traced blocks.
    leaves : Leaves
        Time, states, held outputs and parameters.
    active : set of Clock
        The clocks that tick at this instant: their blocks compute, the others hold.
    solved : dict
        Known signals of algebraic loops; more are added as the loops are solved.
    iterated : list of Port
        Torn signals of the loops that need an iteration, in an evaluation with symbols.
    """

    plan: Plan
    leaves: Leaves
    active: Active
    solved: dict[Port, Array] = field(default_factory=dict)
    iterated: list[Port] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._filled: dict[tuple[str, frozenset[str]], BlockSignals] = {}
        self._outputs: dict[tuple[str, frozenset[str]], Values] = {}
        self._inputs: dict[tuple[str, str], Array] = {}
        self._running: set[tuple[str, frozenset[str]]] = set()

    @cached_property
    def _holding(self) -> set[str]:
        """Paths of the blocks whose outputs are held."""
        return self.plan.system.holding(self.active)

    def output(self, port: Port) -> Array:
        """Return the value of an output of a leaf block (the whole port)."""
        if port in self.solved:
            return self.solved[port]
        path = port.block.path
        if path in self._holding:
            return self.leaves.held[path][port.name]
        return self._computed(port, path)

    def compute(self, stages: Sequence[Stage]) -> None:
        """Compute all outputs in sorted order; recursion along a long chain would overflow the stack."""
        for stage in stages:
            if not self.solved.keys() >= set(stage.torn):
                self._solve(stage)
            for port in stage.ports:
                self.output(port)

    def _solve(self, stage: Stage) -> None:
        """Solve for the torn signals of an algebraic loop."""
        # A separate evaluation, so that no expression in the unknowns is cached in this one.
        apart = Evaluation(self.plan, self.leaves, self.active)
        apart._outputs, apart._inputs = self._outputs.copy(), self._inputs.copy()
        apart._holding = self._holding
        places = laid_out(stage.torn)
        z = ca.SX.sym("z", places.size)
        apart.solved = self.solved | by_port(stage.torn, z, from_expression)
        with written_out():
            for port in stage.ports:
                apart.output(port)
            results = [apart._computed(port, port.block.path) for port in stage.torn]
        guesses = [
            self.leaves.guesses[e.path].get(e.name, np.zeros(e.shape)) for e in places
        ]
        found, iterated = solve(column_of(results) - z, z, column_of(guesses))
        if iterated and z.numel() > MAX_ITERATED_UNKNOWNS:
            raise AlgebraicLoopError(
                f"an algebraic loop of {z.numel()} unknowns exceeds the limit of {MAX_ITERATED_UNKNOWNS} for "
                f"iterations\n{stage.cycle}\nbreak it with states or a UnitDelay, or connect fewer elements"
            )
        self.iterated += stage.torn if iterated else ()
        self.solved |= by_port(stage.torn, found, from_expression)

    def _computed(self, port: Port, path: str) -> Array:
        """Return the value of an output that its block, at `path`, computes.

        The block gets the inputs that the output needs, others that need no computation, and placeholders.
        """
        block = port.block
        needed = self.plan.feedthrough[path][port.name]
        key = (path, needed)
        if key not in self._outputs:
            self._running.add(key)
            u = Signals(f"block '{path}'", {})
            for p in block.inputs():
                if p.name in needed or self._is_free(path, p.name):
                    u[p.name] = self._input(p, path)
                # A placeholder: the output does not depend on it. `Program` replaces it
                # by zero where it remains in the inputs of kernels.
                elif is_traced(self.leaves.t):
                    u[p.name] = symbol("unknown", p.whole_shape or ())
                else:
                    u[p.name] = np.zeros(p.whole_shape or ())
            self._outputs[key] = self._evaluate(block, path, "output", u)
            self._running.discard(key)
        return self._outputs[key][port.name]

    def _input(self, port: Port, path: str) -> Array:
        """Return the value of an input of the leaf block at `path`."""
        key = (path, port.name)
        if key not in self._inputs:
            drivers = self.plan.system.drivers[key]
            self._inputs[key] = self._assembled(port, drivers)
        return self._inputs[key]

    def value(self, port: Port) -> Array:
        """Return the value of an input, an output or a state of a leaf block (the whole port)."""
        if port.name not in port.block.ports:
            return self.leaves.states[port.block.path][port.name]
        if port.is_input:
            return self._input(port.block.ports[port.name], port.block.path)
        return self.output(port)

    def inputs(self, block: Block) -> Signals:
        """Return all inputs of a leaf block."""
        path = block.path
        values = {p.name: self._input(p, path) for p in block.inputs()}
        return Signals(f"block '{path}'", values)

    def results(self, block: Block, kind: str) -> Values:
        """Return the results of an equation for all inputs.

        Parameters
        ----------
        block : Block
            The block.
        kind : str
            Name of the equation, such as ``"derivative"``.
        """
        return self._evaluate(block, block.path, kind, self.inputs(block))

    def _evaluate(self, block: Block, path: str, kind: str, u: Signals) -> Values:
        leaves = self.leaves
        x, p, fired = leaves.states[path], leaves.parameters[path], leaves.fired[path]
        traced = is_traced(leaves.t)
        # Inside algebraic loops no kernel calls are recorded, so equations are traced again.
        recorded = traced and active_trace() is not None
        reusable = self.plan.traced_blocks.get(path) if recorded else None
        if reusable is not None and reusable.fits(u):
            # One substitution gives the results of all equations. It is reused if the
            # same inputs are known, the others being placeholders.
            known = frozenset(n for n in u if self._inputs.get((path, n)) is u[n])
            if (path, known) not in self._filled:
                arguments = [
                    leaves.t,
                    *x.values(),
                    *u.values(),
                    *p.values(),
                    *fired.values(),
                ]
                self._filled[path, known] = reusable(arguments)
            return self._filled[path, known][kind]
        with (
            tracing_errors(block)
            if traced
            else running_errors(block, kind, float(leaves.t))
        ):
            values = equation(block, kind, fired)(leaves.t, x, u, p)
        return checked(block, kind, values)

    def _is_free(self, path: str, name: str) -> bool:
        """Return whether an input without feedthrough, of the block at `path`, depends on states only.

        Such inputs are passed nevertheless: the evaluations for several outputs of a block then have
        equal expressions, and share kernels.
        """
        for driver in self.plan.system.drivers[path, name]:
            if driver.source is None:
                continue
            source = driver.source.block.path
            needed = self.plan.feedthrough[source][driver.source.name]
            key = (source, needed)
            if key in self._outputs or source in self._holding:
                continue
            # An output under evaluation cannot be passed: a block connected to itself would recurse
            # without end. Only one level is followed, as chains of blocks whose outputs depend on states
            # only may be longer than Python's stack.
            if needed or len(self._running) > 1 or key in self._running:
                return False
        return True

    def _assembled(self, port: Port, drivers: list[Driver]) -> Array:
        """Return an input: a whole output, or slices of outputs and zeros, or its default."""
        shape = port.whole_shape or ()
        size = prod(shape)
        everything = np.arange(size)
        default = port.declaration.default
        if not drivers and default is not None:
            return np.full(shape, default, dtype=float)
        elements: list[Array] = [np.zeros(())] * size
        for driver in drivers:
            if driver.source is None:
                continue
            output = self.output(driver.source)
            # A whole output is passed as the same object: its expressions stay shared.
            if driver.source.whole_shape == shape and np.array_equal(
                [driver.taken, driver.given], [everything, everything]
            ):
                return output
            flat = np.reshape(output, (-1,))
            for taken, given in zip(driver.taken, driver.given, strict=True):
                elements[given] = flat[int(taken)]
        if size == 0:
            return np.zeros(shape)
        return np.reshape(np.stack(elements), shape) if shape else elements[0]
