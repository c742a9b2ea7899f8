"""The plan: a diagram traced into the few functions that a simulation needs.

All functions take ``(t, x, d, p)``: time, continuous states, what only changes at instants
(discrete states, then held outputs of sampled blocks, then inputs from outside), and parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import NameLookupError
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.settling import settle
from trussflow.blocks.framework.system import System, flatten
from trussflow.blocks.framework.telling import told
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.validation import by_name, finite_array
from trussflow.blocks.tracing.block_check import check_kind, isolate
from trussflow.blocks.tracing.calling import running_errors
from trussflow.blocks.tracing.evaluation import Active, Evaluation, Leaves, order
from trussflow.blocks.tracing.program import Program, lower
from trussflow.blocks.tracing.tracing import from_expression, is_traced, to_expression, tracing


class Plan:
    """A diagram, flat and ready to be traced.

    Parameters
    ----------
    diagram : Diagram or System
        What to simulate.

    Attributes
    ----------
    x, p : Layout
        Order of continuous states and of parameters.
    memory, held, u : Layout
        The parts of d: discrete states, held outputs, inputs from outside.

    Raises
    ------
    DiagramError
        If there are no blocks, inputs are open, or there is an algebraic loop.
    TracingError
        If the equations of a block cannot be traced.
    """

    def __init__(self, diagram: Diagram | System) -> None:
        self.system = diagram if isinstance(diagram, System) else flatten(diagram)
        self.name = self.system.root.name
        blocks = self.system.blocks
        for block in blocks.values():
            check_kind(block)
        with told(f"checking the blocks of '{self.name}'"):
            self._isolated = {path: isolate(block) for path, block in blocks.items()}
        self.feedthrough = {path: one.feedthrough for path, one in self._isolated.items()}
        states = [
            (path, name, block.state_shape(name), block.continuous)
            for path, block in blocks.items()
            for name in block.states()
        ]
        held = [
            (path, port.name, port.whole_shape or ())
            for path, block in blocks.items()
            if block.sample_time is not None or (block.continuous and not block.traced)
            for port in block.outputs()
        ]
        self.x = Layout((path, name, shape) for path, name, shape, c in states if c)
        # The three parts of d, one after the other.
        self.memory = Layout((path, name, shape) for path, name, shape, c in states if not c)
        self.held = Layout(held, self.memory.span.stop)
        external = self.system.external.values()
        self.u = Layout(((b.path, "y", b.extent) for b in external), self.held.span.stop)
        self.d_size = self.u.span.stop
        self.p = Layout(
            (path, name, value.shape)
            for path, block in blocks.items()
            for name, value in block.parameters.items()
        )
        self.python_blocks = [b for b in blocks.values() if not b.traced and not isinstance(b, External)]
        self._orders: dict[Active, list[Port]] = {}
        self.order(frozenset())

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """All layouts: those of x, of the parts of d, and of p."""
        return self.x, self.memory, self.held, self.u, self.p

    @property
    def u_start(self) -> int:
        """Where the inputs from outside begin in d."""
        return self.u.span.start

    def place(self, path: str, name: str) -> slice:
        """Return where the array `name` of the block at `path`, of x or d, is in (x, d)."""
        for layout in (self.x, self.memory, self.held, self.u):
            if (path, name) in layout.entries:
                entry, start = layout.entries[path, name], 0 if layout is self.x else self.x.size
                return slice(start + entry.start, start + entry.stop)
        raise NameLookupError(f"'{path}.{name}' is neither a state nor held nor from outside")

    def order(self, active: Active) -> list[Port]:
        """Return the outputs in the order in which they are computed while clocks tick.

        Raises
        ------
        AlgebraicLoopError
            If there is none.
        """
        if active not in self._orders:
            self._orders[active] = order(self.system, self.feedthrough, active)
        return self._orders[active]

    # -- values ---------------------------------------------------------------------------

    def parameters(self, overrides: Mapping[str, Any] | None, present: Vector | None = None) -> Vector:
        """Return p: the present values, or else the blocks' own, but for those that the user gave.

        Parameters
        ----------
        overrides : mapping, optional
            What the user gave, by ``"block.parameter"`` [units as declared].
        present : Vector, optional
            The present values [as declared].

        Raises
        ------
        NameLookupError
            If an override names no parameter.
        ParameterError
            If a value is not allowed, or those of a block do not go together.
        """
        blocks, changed = self.system.blocks, dict[str, Block]()
        flat = np.zeros(self.p.size) if present is None else present.copy()
        for e in self.p if present is None else ():
            self.p.put(flat, e.path, e.name, blocks[e.path].parameters[e.name])
        for reference, value in by_name("parameters", overrides).items():
            e = self.p.find(reference, "parameter", hint=self._structural(reference))
            changed[e.path] = blocks[e.path]
            self.p.put(flat, e.path, e.name, blocks[e.path].parameter_value(e.name, value))
        for path, block in changed.items():
            block.check_parameters(self.p.signals(path, flat))
        return flat

    def _structural(self, reference: str) -> str:
        """Say so if a block has what a user took for a parameter as part of its structure."""
        path, _, name = reference.rpartition(".")
        there = vars(self.system.blocks[path]) if path in self.system.blocks else {}
        return f" ('{name}' is structure of '{path}': build another block)" if name in there else ""

    def initial(
        self,
        p: Vector,
        overrides: Mapping[str, Any] | None,
        inputs: Mapping[str, Any] | None = None,
        t: float = 0.0,
        opened: Mapping[str, Equations] | None = None,
    ) -> tuple[Vector, Vector]:
        """Return x and d at the start time `t` [s], before the first instant, with `p` [as declared].

        `overrides` are initial states by ``"block.name"``, `inputs` values from outside by name, and
        `opened` the equations of blocks that keep something in the run that begins, by path.

        Raises
        ------
        NameLookupError
            If an override names no state, or there is no such input from outside.
        ParameterError
            If a value is not finite or has the wrong shape.
        SimulationError
            If initial states depend on themselves, so that they do not settle.
        """
        x, d = np.zeros(self.x.size), np.zeros(self.d_size)
        for layout, flat in ((self.x, x), (self.memory, d)):
            for e in layout:
                block = self.system.blocks[e.path]
                layout.put(flat, e.path, e.name, block.initial(e.name, self.p.signals(e.path, p)))
        for source in self.system.external.values():
            self.u.put(d, source.path, "y", source.start_value())
        overrides = by_name("initial states", overrides)
        self.set_inputs(d, inputs)
        self._override(x, d, overrides)
        self._initial_from_inputs(t, x, d, p, overrides, opened or {})
        return x, d

    def set_inputs(self, d: Vector, values: Mapping[str, Any] | None) -> None:
        """Write `values` from outside into `d` [as declared]: all of them, or, on an error, none.

        Raises
        ------
        NameLookupError
            If there is no such input; the message lists those there are.
        ParameterError
            If a value is not finite or has the wrong shape.
        """
        arrays = {}
        for name, value in by_name("inputs", values).items():
            source = self.system.source(name)
            arrays[source.path] = finite_array(f"input '{name}'", value, source.extent)
        for path, array in arrays.items():
            self.u.put(d, path, "y", array)

    def _override(self, x: Vector, d: Vector, overrides: Mapping[str, Any]) -> None:
        """Put the initial values that the user gave into their places."""
        for reference, value in overrides.items():
            e = self.x.find(reference, "state", self.memory)
            array = finite_array(f"initial value of '{reference}'", value, e.shape)
            self._set_state(e.path, e.name, array, x, d)

    def _set_state(self, path: str, name: str, value: Any, x: Vector, d: Vector) -> None:
        layout, flat = (self.x, x) if (path, name) in self.x.entries else (self.memory, d)
        layout.put(flat, path, name, value)

    def _initial_from_inputs(
        self,
        t: float,
        x: Vector,
        d: Vector,
        p: Vector,
        overrides: Mapping[str, Any],
        opened: Mapping[str, Equations],
    ) -> None:
        """Let blocks set initial states from their inputs at the start; overrides win."""
        found = {path: opened.get(path, block) for path, block in self.system.blocks.items()}
        stating = {
            path: equations
            for path, equations in found.items()
            if equations.states_own("initial_state")
            and any(f"{path}.{name}" not in overrides for name in self.system.blocks[path].states())
        }
        if not stating:
            return
        active = frozenset(c for c in self.system.clocks if c.offset == 0)

        def sweep() -> Vector:
            for path, equations in stating.items():
                block, evaluation = self.system.blocks[path], self.evaluate(t, x, d, p, active)
                with running_errors(block, "initial_state", t):
                    values = equations.initial_state(evaluation.inputs(block), self.p.signals(path, p))
                for name, value in values.items():
                    if name not in block.states():
                        raise NameLookupError(
                            f"initial_state() of block '{path}' returned '{name}'; its states are: "
                            f"{', '.join(block.states()) or 'none'}"
                        )
                    what = f"initial value of '{path}.{name}'"
                    array = finite_array(what, value, block.state_shape(name))
                    self._set_state(path, name, array, x, d)
                self._override(x, d, overrides)
            return np.concatenate([x, d])

        names = " and ".join(f"'{path}'" for path in stating)
        settle(
            sweep,
            len(stating),
            f"the initial states of '{self.name}' do not settle: those that initial_state() of {names} "
            "returns depend on each other in a circle; give some of them, by initial= or without "
            "initial_state()",
        )

    # -- evaluation -----------------------------------------------------------------------

    def evaluation(self, t: Array, x: Array, d: Array, p: Array, make: Any, active: Active) -> Evaluation:
        """Return all signals while the `active` clocks tick; `make` makes arrays of slices.

        With symbols for `t`, `x`, `d` and `p` the signals are expressions, with numbers numbers.
        """
        states = self.x.unpack(x, make) | self.memory.unpack(d, make)
        held = self.held.unpack(d, make) | self.u.unpack(d, make)
        parameters = self.p.unpack(p, make)
        for path in self.system.blocks:
            for found in (states, held, parameters):
                found.setdefault(path, Signals(f"block '{path}'", {}))
        leaves = Leaves(t, states, held, parameters)
        templates = {k: i.template for k, i in self._isolated.items() if i.template is not None}
        evaluation = Evaluation(
            self.system, self.feedthrough, leaves, active, templates if is_traced(t) else {}
        )
        for port in self.order(active):
            evaluation.output(port)
        return evaluation

    def evaluate(self, t: float, x: Vector, d: Vector, p: Vector, active: Active = frozenset()) -> Evaluation:
        """Return the signals while `active` clocks tick as plain numbers, for looking and debugging.

        They are those at time `t` [s] with `x`, `d` and `p` [as declared].
        """
        return self.evaluation(np.asarray(t), x, d, p, np.reshape, active)

    def trace(self, quantities: Sequence[Quantity]) -> list[Program]:
        """Trace one program of (t, x, d, p) for each quantity."""
        sizes = (1, self.x.size, self.d_size, self.p.size)
        leaves = [ca.SX.sym(n, size) for n, size in zip("txdp", sizes, strict=True)]
        t, (x, d, p) = from_expression(leaves[0], ()), leaves[1:]
        programs, evaluations = [], {}
        with told(f"tracing '{self.name}'"), tracing() as trace:
            for quantity in quantities:
                active = quantity.active
                if active not in evaluations:
                    evaluations[active] = self.evaluation(t, x, d, p, from_expression, active)
                arrays = quantity.collect(self, evaluations[active])
                column = ca.vertcat(*map(to_expression, arrays)) if arrays else ca.SX(0, 1)
                programs.append(lower(quantity.name, leaves, column, trace))
        return programs


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
    collect: Callable[[Plan, Evaluation], list[Array]]


def derivative() -> Quantity:
    """Return the quantity dx/dt; zero in the places of Python blocks, which are asked later."""

    def collect(plan: Plan, evaluation: Evaluation) -> list[Array]:
        paths = dict.fromkeys(e.path for e in plan.x)
        blocks = {path: plan.system.blocks[path] for path in paths}
        rates = {path: evaluation.rates(b) for path, b in blocks.items() if b.traced}
        return [rates[e.path][e.name] if e.path in rates else np.zeros(e.shape) for e in plan.x]

    return Quantity("derivative", frozenset(), collect)


def outputs(ports: Sequence[Port], name: str = "outputs") -> Quantity:
    """Return the quantity `name` that holds the values of `ports`, one after the other."""

    def collect(_plan: Plan, evaluation: Evaluation) -> list[Array]:
        return [evaluation.value(port) for port in ports]

    return Quantity(name, frozenset(), collect)


def sample(number: int, active: Active) -> Quantity:
    """Return the quantity d after the traced blocks of the set `number` of `active` clocks computed."""

    def collect(plan: Plan, evaluation: Evaluation) -> list[Array]:
        def computes(path: str) -> bool:
            block = plan.system.blocks[path]
            return block.traced and plan.system.clock(block) in active

        memory = evaluation.leaves.states
        paths = dict.fromkeys(e.path for e in plan.memory if computes(e.path))
        updates = {path: evaluation.updates(plan.system.blocks[path]) for path in paths}
        return (
            [updates[e.path][e.name] if e.path in updates else memory[e.path][e.name] for e in plan.memory]
            + [
                evaluation.output(plan.system.blocks[e.path].port(e.name))
                if computes(e.path)
                else evaluation.leaves.held[e.path][e.name]
                for e in plan.held
            ]
            + [evaluation.leaves.held[e.path][e.name] for e in plan.u]
        )

    return Quantity(f"sample_{number}", active, collect)


def block_inputs(name: str, block: Block, active: Active) -> Quantity:
    """Return the quantity `name`: all inputs of a Python `block` while `active` clocks tick."""

    def collect(_plan: Plan, evaluation: Evaluation) -> list[Array]:
        return list(evaluation.inputs(block).values())

    return Quantity(name, active, collect)
