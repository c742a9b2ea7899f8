"""The plan: a diagram traced into the functions that a simulation needs.

All functions take ``(t, x, d, p)``: time, continuous states, discrete data, and parameters. The discrete
data d change only at instants. They are modes, discrete states, held outputs of sampled blocks and Python
blocks, signs of event indicators, triggered events, last solutions of iterated loops (the next initial
guesses), histories, and external inputs, in this order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from trussflow.blocks.errors import DiagramError, NameLookupError
from trussflow.blocks.framework.block import Block, check_kind
from trussflow.blocks.framework.declarations import KINDS, Event, History, Mode
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System, flatten
from trussflow.blocks.support.progress import status_line
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import by_name, finite_array
from trussflow.blocks.tracing.algebraic_loops import AlgebraicLoops
from trussflow.blocks.tracing.block_check import SharedResults, isolate
from trussflow.blocks.tracing.evaluation import Evaluation, Leaves
from trussflow.blocks.tracing.history import empty
from trussflow.blocks.tracing.initial_states import set_from_inputs
from trussflow.blocks.tracing.kernels import (
    column_of,
    from_expression,
    is_traced,
    tracing,
)
from trussflow.blocks.tracing.program import Program, lower
from trussflow.blocks.tracing.quantities import Quantity
from trussflow.blocks.tracing.sorted_order import Active, Stage, laid_out, order

VARIABLE_ROOM = 1000
"""Smallest room for stored points of a signal with variable steps [-]."""

MAX_ROOM = 1_000_000
"""Largest room for stored points of a signal; d holds the points, and each is a symbol while tracing [-]."""


class Plan:
    """A flat diagram with its data layout and sorted order, ready for tracing.

    Parameters
    ----------
    diagram : Diagram or System
        Diagram to simulate.
    step : float
        Length of the steps of runs [s], infinite if it is not fixed; zero if there are no runs, so that
        histories have no points.
    variable : bool
        Whether runs may also have steps of other lengths.

    Attributes
    ----------
    x, p : Layout
        Order of continuous states and of parameters.
    modes, memory, held, sides, fired, guesses, histories, u : Layout
        Parts of d: modes, discrete states, held outputs of sampled blocks and Python blocks, signs of event
        indicators, triggered events, last solutions of iterated loops (the next initial guesses), stored
        inputs, external inputs. ``events.h`` depends on the order from `sides` to `histories`.
    stored : tuple of Layout
        Layouts of data with initial values: x, modes and memory.
    sampled : slice
        Slice of d that sampled blocks compute: memory and held outputs.
    u_start, d_size : int
        Index in d of the first external input, and size of d [-].
    kinds : array of int8
        Directions of all events, in the order of `sides`.
    has_events : bool
        Whether any block has events.
    loops : AlgebraicLoops
        The algebraic loops that are solved; false if there are none.

    Raises
    ------
    DiagramError
        If there are no blocks, inputs are not connected, or there is an algebraic loop.
    TracingError
        If the equations of a block cannot be traced.
    """

    def __init__(
        self, diagram: Diagram | System, step: float = 0.0, variable: bool = False
    ) -> None:
        self.system = diagram if isinstance(diagram, System) else flatten(diagram)
        self.name = self.system.root.name
        blocks = self.system.blocks
        for block in blocks.values():
            check_kind(block)
        with status_line(f"checking the blocks of '{self.name}'"):
            shared = SharedResults()
            isolated = {path: isolate(b, shared) for path, b in blocks.items()}
        self.feedthrough = {path: one.feedthrough for path, one in isolated.items()}
        self.traced_blocks = {path: one.traced for path, one in isolated.items()}
        held = [
            port
            for block in blocks.values()
            if block.sample_time is not None
            or not (block.traced or isinstance(block, External))
            for port in block.outputs()
        ]

        def layout(names: Callable[[Block], Iterable[str]], start: int = 0) -> Layout:
            arrays = [
                (path, name, block.state_shape(name))
                for path, block in blocks.items()
                for name in names(block)
            ]
            return Layout(arrays, start)

        def events(block: Block) -> Iterable[str]:
            return block.declared(Event)

        self.x = layout(lambda b: b.states() if b.continuous else ())
        # Each part of d starts at the end of the part before.
        self.modes = layout(lambda b: b.declared(Mode))
        self.memory = layout(
            lambda b: () if b.continuous else b.states(), self.modes.span.stop
        )
        self.held = laid_out(held, self.memory.span.stop)
        # ``events.h`` depends on the order of the following parts.
        self.sides = layout(events, self.held.span.stop)
        self.fired = layout(events, self.sides.span.stop)
        self.kinds = np.array(
            [
                KINDS[blocks[e.path]._declared[e.name].kind]
                for e in self.sides
                for _ in range(e.start, e.stop)
            ],
            dtype=np.int8,
        )
        self.has_events = any(block.has_events for block in blocks.values())
        self.p = Layout(
            [
                (path, name, value.shape)
                for path, block in blocks.items()
                for name, value in block.parameters.items()
            ]
        )
        self.python_blocks = [
            b for b in blocks.values() if not b.traced and not isinstance(b, External)
        ]
        self._empty = _empty_histories(blocks, step, variable or math.isinf(step))
        self._orders: dict[tuple[Active, bool], list[Stage]] = {}
        self.stored = self.x, self.modes, self.memory
        self.sampled = slice(self.memory.span.start, self.held.span.stop)
        self.loops = AlgebraicLoops(self)
        # The trace that finds the iterated outputs needs guesses for all torn ones.
        self._lay_out_rest(self.loops.torn)
        if self.loops:
            self._lay_out_rest(self.loops.iterated())
        # Algebraic loops that are not solved are reported here, not in the first run.
        self.order(frozenset())

    def _lay_out_rest(self, iterated: Iterable[Port]) -> None:
        """Lay out the end of d: guesses of the iterated outputs, histories, and external inputs."""
        ports = sorted(iterated, key=lambda port: port.path)
        self.guesses = laid_out(ports, self.fired.span.stop)
        self.histories = Layout(
            [(*key, history.shape) for key, history in self._empty.items()],
            self.guesses.span.stop,
        )
        external = self.system.external.values()
        self.u_start = self.histories.span.stop
        self.u = Layout([(b.path, "y", b.extent) for b in external], self.u_start)
        self.d_size = self.u.span.stop

    @property
    def layouts(self) -> tuple[Layout, ...]:
        """Layouts of x, of the parts of d, and of p."""
        parts = self.modes, self.memory, self.held, self.sides, self.fired
        return self.x, *parts, self.guesses, self.histories, self.u, self.p

    def place(self, path: str, name: str) -> slice:
        """Return the slice of (x, d) with the array `name` of the block at `path`."""
        for layout in (*self.stored, self.held, self.u):
            if entry := layout.entries.get((path, name)):
                before = 0 if layout is self.x else self.x.size
                return slice(before + entry.start, before + entry.stop)
        raise NameLookupError(
            f"'{path}.{name}' is neither a state nor a held output nor an external input"
        )

    def order(self, active: Active, *, refuse: bool = True) -> list[Stage]:
        """Return the sorted order of the outputs while `active` clocks tick.

        If `refuse` is false, all loops count as solved.

        Raises
        ------
        AlgebraicLoopError
            If there is an algebraic loop that is not solved.
        """
        key = active, refuse
        if key not in self._orders:
            self._orders[key] = order(
                self.system, self.feedthrough, active, self.loops.torn, refuse=refuse
            )
        return self._orders[key]

    # -- values ---------------------------------------------------------------------------

    def parameters(
        self, overrides: Mapping[str, Any] | None, present: Vector | None = None
    ) -> Vector:
        """Return p: the present values, or else the defaults of the blocks, with overrides from the user.

        Parameters
        ----------
        overrides : mapping, optional
            Values from the user, by ``"block.parameter"`` [units as declared].
        present : Vector, optional
            Present values of all parameters [as declared].

        Raises
        ------
        NameLookupError
            If an override names no parameter.
        ParameterError
            If a value is not allowed, or the values of a block are not consistent.
        """
        blocks, changed = self.system.blocks, dict[str, Block]()
        if present is None:
            defaults = (v for b in blocks.values() for v in b.parameters.values())
            present = np.concatenate([np.zeros(0), *map(np.ravel, defaults)])
        flat = present.copy()
        for reference, value in by_name("parameters", overrides).items():
            e = self.p.find(reference, "parameter", hint=self.structural(reference))
            changed[e.path] = blocks[e.path]
            self.p.put(
                flat, e.path, e.name, blocks[e.path].parameter_value(e.name, value)
            )
        # After all overrides, as values of one block may be consistent only together.
        for path, block in changed.items():
            block.check_parameters(self.p.signals(path, flat))
        return flat

    def structural(self, reference: str) -> str:
        """Return a hint if the parameter that a user asked for is a structural attribute of a block."""
        path, _, name = reference.rpartition(".")
        block = self.system.blocks.get(path)
        if block is None or name not in vars(block):
            return ""
        return f" ('{name}' is a structural attribute of '{path}': build another block)"

    def initial(
        self,
        p: Vector,
        overrides: Mapping[str, Any] | None,
        inputs: Mapping[str, Any] | None = None,
        t: float = 0.0,
        opened: Mapping[str, Equations] | None = None,
    ) -> tuple[Vector, Vector]:
        """Return x and d at the initial time `t` [s], before the first instant, with `p` [as declared].

        `overrides` are initial states by ``"block.name"``, `inputs` external inputs by name, and `opened`
        the equation objects of blocks with internal state for this run, by block path.

        Raises
        ------
        NameLookupError
            If an override names no state, or there is no such external input.
        ParameterError
            If a value is not finite or has the wrong shape.
        SimulationError
            If initial states depend on each other, and their fixed-point iteration does not converge.
        """
        x, d = np.zeros(self.x.size), np.zeros(self.d_size)
        for layout in self.stored:
            flat = x if layout is self.x else d
            for e in layout:
                block = self.system.blocks[e.path]
                layout.put(
                    flat,
                    e.path,
                    e.name,
                    block.initial(e.name, self.p.signals(e.path, p)),
                )
        for port, value in self.loops.starts.items():
            if place := self.guesses.entries.get((port.block.path, port.name)):
                self.guesses.put(d, place.path, place.name, value)
        for key, history in self._empty.items():
            self.histories.put(d, *key, history)
        for source in self.system.external.values():
            self.u.put(d, source.path, "y", source.start_value())
        overrides = by_name("initial states", overrides)
        self.set_inputs(d, inputs)
        # Before the blocks that compute states from inputs, which may depend on these.
        self.override(x, d, overrides)
        set_from_inputs(self, t, x, d, p, overrides, opened or {})
        return x, d

    def set_inputs(self, d: Vector, values: Mapping[str, Any] | None) -> None:
        """Write the `values` of external inputs into `d` [as declared]: all of them, or none on an error.

        Raises
        ------
        NameLookupError
            If there is no such input; the message lists the valid names.
        ParameterError
            If a value is not finite or has the wrong shape.
        """
        # All values are checked before the first is written.
        arrays = {}
        for name, value in by_name("inputs", values).items():
            source = self.system.source(name)
            arrays[source.path] = finite_array(f"input '{name}'", value, source.extent)
        for path, array in arrays.items():
            self.u.put(d, path, "y", array)

    def override(self, x: Vector, d: Vector, values: Mapping[str, Any]) -> None:
        """Write the `values` of states, by ``"block.name"``, into `x` and `d` [as declared].

        Raises
        ------
        NameLookupError
            If there is no such state.
        ParameterError
            If a value has the wrong shape or is not finite; modes may be infinite.
        """
        what = "state or loop signal" if self.loops else "state"
        for reference, value in values.items():
            e = self.x.find(reference, what, self.modes, self.memory, self.guesses)
            is_mode = (e.path, e.name) in self.modes.entries
            flat = x if (e.path, e.name) in self.x.entries else d
            flat[e.start : e.stop] = finite_array(
                f"initial value of '{reference}'", value, e.shape, infinite=is_mode
            ).ravel()

    def sound(self, d: Vector) -> bool:
        """Return whether `d` [as declared] is finite; modes, such as times of events, may be infinite."""
        modes = self.modes.span
        return bool(np.isfinite(d[modes.stop :]).all() and not np.isnan(d[modes]).any())

    # -- evaluation -----------------------------------------------------------------------

    def leaves(self, point: Sequence[Any], make: Any) -> Leaves:
        """Return the arrays in a `point` (t, x, d, p); `make` converts a slice to an array of a shape."""
        t, x, d, p = point
        states, held = self.memory.unpack(d, make), self.held.unpack(d, make)
        self.x.unpack(x, make, states)
        self.modes.unpack(d, make, states)
        self.u.unpack(d, make, held)
        others = (self.fired, self.sides, self.guesses, self.histories)
        leaves = Leaves(
            make(t, ()),
            states,
            held,
            self.p.unpack(p, make),
            *(layout.unpack(d, make) for layout in others),
        )
        for path, histories in leaves.histories.items():
            for name, whole in histories.items():
                # Traced, the first number stands for the history.
                states[path][name] = whole[0] if is_traced(whole) else whole
        return leaves

    def symbols(self) -> list[ca.SX]:
        """Return new symbols for t, x, d and p."""
        sizes = (1, self.x.size, self.d_size, self.p.size)
        return [ca.SX.sym(n, size) for n, size in zip("txdp", sizes, strict=True)]

    def evaluate(
        self, t: float, x: Vector, d: Vector, p: Vector, active: Active = frozenset()
    ) -> Evaluation:
        """Return the signals as plain numbers while `active` clocks tick.

        The signals are those at time `t` [s] with `x`, `d` and `p` [as declared].
        """
        leaves = self.leaves((t, x, d, p), np.reshape)
        for signals in leaves.fired.values():
            # Events are numbers in d and booleans in NumPy equations.
            signals.update({name: value > 0 for name, value in signals.items()})
        solved = self.loops.values(t, x, d, p, active)
        evaluation = Evaluation(self, leaves, active, solved)
        evaluation.compute(self.order(active))
        return evaluation

    def trace(self, quantities: Sequence[Quantity]) -> list[Program]:
        """Trace one program of (t, x, d, p) for each quantity."""
        symbols, programs, evaluated = self.symbols(), [], dict[Active, Evaluation]()
        with status_line(f"tracing '{self.name}'"), tracing() as trace:
            leaves = self.leaves(symbols, from_expression)
            for quantity in quantities:
                if (active := quantity.active) not in evaluated:
                    now = Evaluation(self, leaves, active)
                    now.compute(self.order(active))
                    evaluated[active] = now
                column = column_of(quantity.collect(evaluated[active]))
                programs.append(lower(quantity.name, symbols, column, trace))
        return programs


def _empty_histories(
    blocks: Mapping[str, Block], step: float, variable: bool
) -> dict[tuple[str, str], Vector]:
    """Return the histories of `blocks` by path and name, without points; for `step` [s] and `variable` see `Plan`."""
    declared = {
        (path, name): (block, each)
        for path, block in blocks.items()
        for name, each in block.declared(History).items()
    }
    # Steps are as short as the shortest delay needs.
    steps = [getattr(block, each.step) for block, each in declared.values()]
    finest = min([step or math.inf, *steps])
    found = {}
    for (path, name), (block, each) in declared.items():
        longest = getattr(block, each.longest)
        # Signals may jump at each step, and events divide steps.
        room = 4 * math.ceil(longest / finest) + 20
        if variable:
            room = max(room, VARIABLE_ROOM)
        room = block.points or room
        if step and room > MAX_ROOM:
            raise DiagramError(
                f"'{path}' needs {room} stored points for its delay of {longest:g} s, of at most {MAX_ROOM}: "
                "take a larger step, fewer points, or sampled_delay"
            )
        found[path, name] = empty(
            room if step else 0, block.ports[each.of].size, longest
        )
    return found
