"""The plan: a diagram traced into the few functions that a simulation needs.

All functions take ``(t, x, d, p)``: time, continuous states, what only changes at instants
(modes, then discrete states, held outputs of sampled blocks, where indicators of events stand, which
events happen, what algebraic loops were solved by, and inputs from outside), and parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import KINDS, Event, Mode, Signals
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import NameLookupError
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System, flatten
from trussflow.blocks.framework.telling import told
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.validation import by_name, finite_array
from trussflow.blocks.tracing.block_check import check_kind, isolate_all
from trussflow.blocks.tracing.evaluation import Evaluation, Leaves
from trussflow.blocks.tracing.initial_states import set_from_inputs
from trussflow.blocks.tracing.loop_solutions import LoopSolutions
from trussflow.blocks.tracing.loops import Active, Stage, order, share_program
from trussflow.blocks.tracing.program import Program, lower
from trussflow.blocks.tracing.quantities import Quantity
from trussflow.blocks.tracing.tracing import from_expression, is_traced, to_expression, tracing
from trussflow.blocks.tracing.waits import Waits


class Plan:
    """A diagram, flat and ready to be traced.

    Parameters
    ----------
    diagram : Diagram or System
        What to simulate.
    own_programs : bool
        Whether each set of clocks that tick together gets a program of its own, however many there are.

    Attributes
    ----------
    x, p : Layout
        Order of continuous states and of parameters.
    modes, memory, held, waits, sides, fired, guesses, u : Layout
        The parts of d: modes, discrete states, held outputs; how many ticks are left for each clock, if
        many share one program; on which side of zero the indicators of events are, and which events
        happen, and the last solutions of algebraic loops that are found by iteration, as ``events.h`` has
        them; inputs from outside.
    kinds : array of int8
        The kinds of all events, in the order of `sides`.
    has_events : bool
        Whether any block has events.
    loops : LoopSolutions
        The algebraic loops that are solved; false if there are none.

    Raises
    ------
    DiagramError
        If there are no blocks, inputs are open, or there is an algebraic loop.
    TracingError
        If the equations of a block cannot be traced.
    """

    def __init__(self, diagram: Diagram | System, *, own_programs: bool = False) -> None:
        self.system = diagram if isinstance(diagram, System) else flatten(diagram)
        self.name = self.system.root.name
        blocks = self.system.blocks
        for block in blocks.values():
            check_kind(block)
        with told(f"checking the blocks of '{self.name}'"):
            self._isolated = isolate_all(blocks)
        self.feedthrough = {path: one.feedthrough for path, one in self._isolated.items()}
        states = [
            (path, name, block.state_shape(name), block.continuous)
            for path, block in blocks.items()
            for name in block.states()
        ]
        held = [
            (path, port.name, port.whole_shape or ())
            for path, block in blocks.items()
            if block.sample_time is not None or not (block.traced or isinstance(block, External))
            for port in block.outputs()
        ]
        self.x = Layout((path, name, shape) for path, name, shape, c in states if c)
        modes, events = (
            [
                (path, name, block.state_shape(name))
                for path, block in blocks.items()
                for name in block.declared(kind)
            ]
            for kind in (Mode, Event)
        )
        # The parts of d, one after the other.
        self.modes = Layout(modes)
        self.memory = Layout(
            ((path, name, shape) for path, name, shape, c in states if not c), self.modes.span.stop
        )
        self.held = Layout(held, self.memory.span.stop)
        shared = not own_programs and share_program(self.system, self.feedthrough)
        self.waits = Waits(self.system.clocks if shared else [], self.held.span.stop)
        # From here on as ``events.h`` has them.
        self.sides = Layout(events, self.waits.span.stop)
        self.fired = Layout(events, self.sides.span.stop)
        kinds = [
            KINDS[blocks[e.path].declared(Event)[e.name].kind]
            for e in self.sides
            for _ in range(e.start, e.stop)
        ]
        self.kinds = np.array(kinds, dtype=np.int8)
        self.has_events = any(block.has_events for block in blocks.values())
        self.p = Layout(
            (path, name, value.shape)
            for path, block in blocks.items()
            for name, value in block.parameters.items()
        )
        self.python_blocks = [b for b in blocks.values() if not b.traced and not isinstance(b, External)]
        self._orders: dict[Active, list[Stage]] = {}
        self._lay_out_rest([])
        self.loops = LoopSolutions(self)
        if self.loops:
            self._lay_out_rest(self.loops.torn)
            self._lay_out_rest(self.loops.iterated())
        self.order(frozenset())

    def _lay_out_rest(self, iterated: Iterable[Port]) -> None:
        """Lay out the end of d, with places for the outputs found by iteration."""
        ports = sorted(iterated, key=lambda port: port.path)
        guesses = [(port.block.path, port.name, port.whole_shape or ()) for port in ports]
        self.guesses = Layout(guesses, self.fired.span.stop)
        external = self.system.external.values()
        self.u = Layout(((b.path, "y", b.extent) for b in external), self.guesses.span.stop)
        self.d_size = self.u.span.stop

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """All layouts: those of x, of the parts of d, and of p."""
        return (
            *(self.x, self.modes, self.memory, self.held, self.waits, self.sides, self.fired),
            *(self.guesses, self.u, self.p),
        )

    @property
    def stored(self) -> tuple[Layout, ...]:
        """Those of what has an initial value: x, modes and memory."""
        return self.x, self.modes, self.memory

    @property
    def sampled(self) -> slice:
        """The part of d that sampled blocks compute: memory and held outputs."""
        return slice(self.memory.span.start, self.held.span.stop)

    @property
    def u_start(self) -> int:
        """Where the inputs from outside begin in d."""
        return self.u.span.start

    def place(self, path: str, name: str) -> slice:
        """Return where the array `name` of the block at `path`, of x or d, is in (x, d)."""
        for layout in (*self.stored, self.held, self.u):
            if (path, name) in layout.entries:
                entry, start = layout.entries[path, name], 0 if layout is self.x else self.x.size
                return slice(start + entry.start, start + entry.stop)
        raise NameLookupError(f"'{path}.{name}' is neither a state nor held nor from outside")

    def order(self, active: Active) -> list[Stage]:
        """Return the outputs in the order in which they are computed while clocks tick.

        Raises
        ------
        AlgebraicLoopError
            If there is none.
        """
        if active not in self._orders:
            self._orders[active] = order(self.system, self.feedthrough, active, self.loops.torn)
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
            e = self.p.find(reference, "parameter", hint=self.structural(reference))
            changed[e.path] = blocks[e.path]
            self.p.put(flat, e.path, e.name, blocks[e.path].parameter_value(e.name, value))
        for path, block in changed.items():
            block.check_parameters(self.p.signals(path, flat))
        return flat

    def structural(self, reference: str) -> str:
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
        for layout in self.stored:
            flat = x if layout is self.x else d
            for e in layout:
                block = self.system.blocks[e.path]
                layout.put(flat, e.path, e.name, block.initial(e.name, self.p.signals(e.path, p)))
        for port, value in self.loops.starts.items():
            if place := self.guesses.entries.get((port.block.path, port.name)):
                self.guesses.put(d, place.path, place.name, value)
        for source in self.system.external.values():
            self.u.put(d, source.path, "y", source.start_value())
        d[self.waits.span] = self.waits.first
        overrides = by_name("initial states", overrides)
        self.set_inputs(d, inputs)
        self.override(x, d, overrides)
        set_from_inputs(self, t, x, d, p, overrides, opened or {})
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

    def override(self, x: Vector, d: Vector, overrides: Mapping[str, Any]) -> None:
        """Put the `overrides` that the user gave, by ``"block.name"``, into `x` and `d` [as declared]."""
        for reference, value in overrides.items():
            what = "state or loop signal" if self.loops else "state"
            e = self.x.find(reference, what, self.modes, self.memory, self.guesses)
            self.set_state(e.path, e.name, value, x, d)

    def sound(self, d: Vector) -> bool:
        """Return whether `d` [as declared] is finite; modes, such as times of events, may be infinite."""
        modes = self.modes.span
        return bool(np.isfinite(d[modes.stop :]).all() and not np.isnan(d[modes]).any())

    def set_state(self, path: str, name: str, value: Any, x: Vector, d: Vector) -> None:
        """Put the `value` of the state `name` of the block at `path` into `x` or `d` [as declared].

        Raises
        ------
        ParameterError
            If it is not finite, but for modes, which may be infinite, or has the wrong shape.
        """
        places = *self.stored, self.guesses
        layout = next(layout for layout in places if (path, name) in layout.entries)
        what, shape = f"initial value of '{path}.{name}'", layout.entries[path, name].shape
        array = finite_array(what, value, shape, infinite=layout is self.modes)
        layout.put(x if layout is self.x else d, path, name, array)

    # -- evaluation -----------------------------------------------------------------------

    def evaluation(self, t: Array, x: Array, d: Array, p: Array, make: Any, active: Active) -> Evaluation:
        """Return what computes the signals while the `active` clocks tick; `make` makes arrays of slices.

        With symbols for `t`, `x`, `d` and `p` the signals are expressions, with numbers numbers.
        """
        states, fired = self.memory.unpack(d, make), self.fired.unpack(d, make)
        for layout, flat in ((self.x, x), (self.modes, d)):
            for path, own in layout.unpack(flat, make).items():
                states[path] = Signals(own.owner, {**states.get(path, {}), **own})
        held = self.held.unpack(d, make) | self.u.unpack(d, make)
        parameters, guesses = self.p.unpack(p, make), self.guesses.unpack(d, make)
        for path in self.system.blocks:
            for found in (states, held, parameters, fired, guesses):
                found.setdefault(path, Signals(f"block '{path}'", {}))
            if not is_traced(t):
                fired[path] = Signals(fired[path].owner, {n: f > 0 for n, f in fired[path].items()})
        sides, waits = self.sides.unpack(d, make), self.waits.by_clock(d, make)
        leaves = Leaves(t, states, held, parameters, fired, sides, guesses, waits)
        templates = {k: i.template for k, i in self._isolated.items() if i.template is not None}
        if is_traced(t):
            return Evaluation(self.system, self.feedthrough, leaves, active, templates)
        solved = self.loops.values(float(t), x, d, p, active)
        return Evaluation(self.system, self.feedthrough, leaves, active, solved=solved)

    def symbolic(self, active: Active, symbols: Sequence[ca.SX] = ()) -> Evaluation:
        """Return what computes the signals while `active` clocks tick, of new `symbols` or these."""
        t, x, d, p = symbols or self.symbols()
        return self.evaluation(from_expression(t, ()), x, d, p, from_expression, active)

    def symbols(self) -> list[ca.SX]:
        """Return new symbols for t, x, d and p."""
        sizes = (1, self.x.size, self.d_size, self.p.size)
        return [ca.SX.sym(n, size) for n, size in zip("txdp", sizes, strict=True)]

    def evaluate(self, t: float, x: Vector, d: Vector, p: Vector, active: Active = frozenset()) -> Evaluation:
        """Return the signals while `active` clocks tick as plain numbers, for looking and debugging.

        They are those at time `t` [s] with `x`, `d` and `p` [as declared].
        """
        evaluation = self.evaluation(np.asarray(t), x, d, p, np.reshape, active)
        evaluation.compute(self.order(active))
        return evaluation

    def trace(self, quantities: Sequence[Quantity]) -> list[Program]:
        """Trace one program of (t, x, d, p) for each quantity."""
        leaves, programs, evaluated = self.symbols(), [], dict[Active, Evaluation]()
        with told(f"tracing '{self.name}'"), tracing() as trace:
            new = self.symbolic(frozenset(), leaves)
            for quantity in quantities:
                if (active := quantity.active) not in evaluated:
                    now = Evaluation(new.system, new.feedthrough, new.leaves, active, new.templates)
                    now.compute(self.order(active))
                    evaluated[active] = now
                arrays = quantity.collect(self, evaluated[active])
                column = ca.vertcat(*map(to_expression, arrays)) if arrays else ca.SX(0, 1)
                programs.append(lower(quantity.name, leaves, column, trace))
        return programs
