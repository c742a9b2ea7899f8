"""The Python blocks of a diagram: their order, and the executor that evaluates them in a run.

Outputs of continuous Python blocks have places in d, among the held ones. Before anything is evaluated,
each block computes its outputs from the present time, states and inputs, in the order in which they depend
on each other. The traced programs then read them like held values. Outputs in algebraic loops that are to
be solved are found together, by Newton's method with differences. While sampled blocks compute at an
instant, continuous Python blocks still see the held outputs of before.

With fixed steps, ``driver.c`` calls continuous blocks that have C functions, and leaves steps with events to Python.
"""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Generator
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import AlgebraicLoopError, DivergenceError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.simulation.adaptive import VariableSpan
from trussflow.blocks.simulation.block_instances import (
    BlockCall,
    OpenBlocks,
    SampledStepping,
)
from trussflow.blocks.simulation.executor import (
    CompiledExecutor,
    Executor,
    Point,
    Progress,
    Span,
)
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.call_checks import running_errors
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import Quantity, outputs
from trussflow.blocks.tracing.sorted_order import (
    Active,
    components,
    in_order,
    is_solved,
    reached_from,
)

MAX_NEWTON_ROUNDS = 20
"""Maximum number of iterations of Newton's method [-]."""

DIFFERENCE_STEP = 1e-7
"""Step of differences, relative to signals above one [-]."""

LOOP_TOLERANCE = 1e-9
"""Residual of a loop that round-off may leave, relative to its signals [-]."""

INSTANT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_longlong)
"""Type of a C function that computes an instant, for ``driver.c``."""

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
        If Python blocks form an algebraic loop that is not to be solved.
    """
    by_path = {b.path: b for b in blocks}
    graph: dict[str, list[str]] = {}
    holding = plan.system.holding(active)
    for path in by_path:
        needed = frozenset().union(*plan.feedthrough[path].values())
        graph[path] = reached_from(
            plan.system, plan.feedthrough, path, needed, holding, by_path
        )
    stages = []
    for paths in components(graph):
        # A component of one block is a loop if the block depends on itself.
        is_loop = len(paths) > 1 or paths[0] in graph[paths[0]]
        if is_loop and (active or not is_solved(plan.system, paths)):
            _, cycle = in_order(
                {path: [p for p in graph[path] if p in paths] for path in paths}
            )
            raise AlgebraicLoopError(
                f"algebraic loop through Python blocks: {' -> '.join(cycle)}; each needs the "
                "output of the one before at the same instant. Break it with a UnitDelay, make a "
                "Function of what can be traced, declare in feedthrough() which outputs do not depend on "
                "which inputs, or, if none of them is sampled, let it be solved: "
                'Diagram(..., loops="solve")'
            )
        stages.append(([by_path[path] for path in paths], is_loop))
    return stages


class PythonBlocks:
    """The Python blocks of a plan, in the order in which they must compute.

    Parameters
    ----------
    plan : Plan
        The plan.
    sets : sequence of frozenset of Clock
        The sets of clocks that tick together, as numbered by the schedule; the first is empty.

    Attributes
    ----------
    stages : list of list of tuple
        For each set, the blocks that compute when it ticks, in sorted order, with their inputs: lists of
        blocks, and whether each list is a loop to be solved. Those of the first set are continuous.
    ordered : list of list of (BlockCall, Quantity)
        For each set, all its blocks with their inputs.
    computes : array of bool
        For each set, whether there are any.
    with_traced : list of bool
        For each set, whether traced blocks are sampled too.

    Raises
    ------
    AlgebraicLoopError
        If Python blocks form an algebraic loop that is not to be solved.
    """

    def __init__(self, plan: Plan, sets: list[Active]) -> None:
        clock_of = plan.system.clock_of
        calls = {b.path: BlockCall(plan, b) for b in plan.python_blocks}
        self.stages: list[list[tuple[list[Pair], bool]]] = []
        for number, active in enumerate(sets):
            name = f"inputs_{number}" if number else "continuous"
            # The first set is empty: its blocks are the continuous
            # ones, which have no clock.
            ticking = active or {None}
            blocks = [b for b in plan.python_blocks if clock_of[b.path] in ticking]
            inputs = {
                block.path: outputs(block.inputs(), f"{name}_{place}", active)
                for place, block in enumerate(blocks)
            }
            self.stages.append(
                [
                    ([(calls[b.path], inputs[b.path]) for b in stage], is_loop)
                    for stage, is_loop in sorted_stages(plan, blocks, active)
                ]
            )
        self.ordered = [
            [pair for pairs, _ in stages for pair in pairs] for stages in self.stages
        ]
        traced = {clock_of[path] for path, b in plan.system.blocks.items() if b.traced}
        self.with_traced = [bool(active & traced) for active in sets]
        self.computes = np.array([bool(pairs) for pairs in self.ordered])

    @property
    def continuous(self) -> list[Pair]:
        """The continuous blocks with their inputs."""
        return self.ordered[0]

    def quantities(self) -> list[Quantity]:
        """Return the quantities that hold the blocks' inputs."""
        return [quantity for _, quantity in chain(*self.ordered)]


class PythonExecutor(Executor):
    """Executor of the traced blocks together with the Python blocks.

    Everywhere `number` is that of a set of clocks that tick together, `t` the time [s], and `x`, `d`, `p` are
    the continuous states, the discrete values and the parameters [as declared]; all are a `point`.

    Parameters
    ----------
    inner : Executor
        Executor of the traced blocks.
    python : PythonBlocks
        The Python blocks.
    blocks : OpenBlocks
        Their equation objects in this run.
    """

    def __init__(
        self, inner: Executor, python: PythonBlocks, blocks: OpenBlocks
    ) -> None:
        super().__init__(inner.plan)
        self.name = inner.name
        self.blocks = blocks
        self._inner = inner
        self._python = python
        self.asking: set[str] = set()
        self._updating = {
            call.path
            for call, _ in chain(*python.ordered)
            if call.size
            or isinstance(own := blocks.equations[call.path], SampledStepping)
            or own.states_own("update")
        }
        self._span: tuple[float, Span, Vector, Vector, Vector]
        self._instant: Any = None
        self._failed: Progress | None = None

    def call(self, name: str, *point: *Point) -> Vector:
        """Return the quantity of that name; outputs of continuous Python blocks change in d."""
        # The traced programs read the outputs of continuous Python blocks from d.
        self.refresh(*point)
        values = self._inner.call(name, *point)
        if name in ("derivative", "indicators"):
            self._add(name, point, values)
        elif name == "on_event":
            self._handle(point, values)
        return values

    def advance(
        self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector
    ) -> Progress:
        """Take steps of a span in place, as in `Executor.advance`."""
        inner = self._inner
        if (
            not isinstance(inner, CompiledExecutor)
            or (blocks := self._compiled(inner)) is None
        ):
            return super().advance(span, x, d, p, log)
        if self._instant is None:
            # C calls the generator inside its `try`. Ctrl-C is noticed at the begin of a function, where it
            # would get lost.
            instants = self._instants()
            next(instants)
            self._instant = INSTANT(instants.send)
        self._span = time.perf_counter() + self.span_seconds, span, x, d, p
        computes = self._python.computes.ctypes.data
        progress = inner.advance(
            span, x, d, p, log, computes, self._instant, blocks.ctypes.data
        )
        if self._failed is not None:
            failed, self._failed, self._instant = self._failed, None, None
            return failed._replace(steps=progress.steps)
        try:
            requests = self.blocks.call_each("resume")
        except Exception as error:  # noqa: BLE001 - raised again by the run
            return progress._replace(bad=None, error=error)
        if progress.fault != "step":
            return progress
        # An event in the next step, or one that a block requests after it.
        self.asking = {path for path, requested in requests.items() if requested}
        first = span.first + progress.steps
        due, logged = span.due[:1] * 0, span.logged[:1] * 0
        step = Span(span.method, span.tick, first, 0, 1, due, logged)
        after = super().advance(step, x, d, p, log)
        return after._replace(steps=progress.steps + after.steps)

    def _compiled(self, inner: CompiledExecutor) -> NDArray[np.uintp] | None:
        """Return the continuous blocks for C, or None if Python must evaluate any of them."""
        found = []
        words = self.blocks.call_each("compiled")
        for ((call, quantity), *_), is_loop in self._python.stages[0]:
            block = words.get(call.path)
            if block is None or is_loop or self.plan.histories.size:
                return None
            places = (s.start for s in (call.states, call.outputs, call.events))
            found.append([inner.programs[quantity.name][0], *places, *block])
        return np.array(found, dtype=np.uintp)

    def _instants(self) -> Generator[int, int, None]:
        """Compute the instant of each step of a span that is sent; yield whether the span goes on."""
        good = 1
        try:
            while True:
                k = yield good
                until, span, x, d, p = self._span
                good = int(not k or time.perf_counter() < until)
                if not good:
                    continue
                t = (span.first + k) * span.tick.numerator / span.tick.denominator
                updated = self.instant(int(span.due[span.begin + k]), t, x, d, p)
                if updated is d:
                    continue
                if self.plan.sound(updated):
                    d[:] = updated
                else:
                    good, self._failed = 0, Progress(0, "d", updated)
        except GeneratorExit:
            raise
        except BaseException as error:  # noqa: BLE001 - raised again by the run
            self._failed = Progress(0, "d", error=error)
        yield 0

    def vary(self, span: VariableSpan) -> None:
        """Advance by variable steps as a `span` says, in place."""
        if self._python.continuous:
            super().vary(span)
        else:
            self._inner.vary(span)

    def instant(self, number: int, *point: *Point, update: bool = True) -> Vector:
        """Return d after an instant: Python blocks first, then the traced ones."""
        d = point[2]
        ticking = self._python.ordered[number]
        for call, quantity in ticking:
            d[call.outputs] = self._sampled_output(call, quantity, point)
        # All outputs are known by now. New states are put into d only after all updates have
        # read the old ones.
        staged = []
        for call, quantity in ticking if update else ():
            if call.path in self._updating:
                staged += self._updated(call, quantity, point)
        # If only Python blocks are sampled, there is no traced program to call.
        if self._python.with_traced[number]:
            d = self.call(f"sample_{number}", *point)
        for place, states in staged:
            d[place] = states
        return d

    # -- sampled blocks -----------------------------------------------------------------------

    def _sampled_output(
        self, call: BlockCall, quantity: Quantity, point: Point
    ) -> Vector:
        """Return the outputs of a sampled block at an instant."""
        t, _, d, p = point
        own = self.blocks.equations[call.path]
        u = call.unknown.copy()
        if call.direct:
            u = self.call(quantity.name, *point)
            # Without feedthrough, an input may depend on these outputs and is not known yet.
            u[~call.needed] = np.nan
        if isinstance(own, SampledStepping):
            try:
                outputs = own.reach(t, u)
            except Exception:
                with running_errors(call.block, "advance", t):
                    raise
        else:
            states = d[call.states].copy()
            outputs = call(own, "output", t, states, u, p[call.parameters])
        return self._finite(call, "output", outputs, t)

    def _updated(
        self, call: BlockCall, quantity: Quantity, point: Point
    ) -> list[tuple[slice, Vector]]:
        """Return the new states of a sampled block after an instant, if it has any, and where in d they belong."""
        t, _, d, p = point
        own = self.blocks.equations[call.path]
        u = self.call(quantity.name, *point)
        if isinstance(own, SampledStepping):
            try:
                own.hold(u)
            except Exception:
                with running_errors(call.block, "set", t):
                    raise
            return []
        before = d[call.states].copy()
        states = call(own, "update", t, before, u, p[call.parameters])
        return [(call.states, self._finite(call, "update", states, t))]

    def _finite(self, call: BlockCall, kind: str, values: Vector, t: float) -> Vector:
        """Return finite `values`; stop the run at the block that returned others."""
        # The square is finite only if all numbers are, and is faster; it may overflow.
        if math.isfinite(values @ values) or np.isfinite(values).all():
            return values
        layout = self.plan.held if kind == "output" else self.plan.memory
        place = layout.span_of(call.path).start + int(np.argmin(np.isfinite(values)))
        raise DivergenceError(
            f"{layout.describe(place)} stopped being finite at t = {t:g} s: {kind}() of that Python "
            "block returned it; the log up to there is kept"
        )

    # -- continuous blocks --------------------------------------------------------------------

    def refresh(self, *point: *Point) -> None:
        """Put the outputs of continuous blocks into d of a `point` (t, x, d, p) [as declared].

        Raises
        ------
        DivergenceError
            If a loop cannot be solved.
        """
        for pairs, is_loop in self._python.stages[0]:
            if is_loop:
                self._solve(pairs, point)
            else:
                self._put_outputs(pairs, point)

    def _put_outputs(self, pairs: list[Pair], point: Point) -> None:
        for call, quantity in pairs:  # each sees what those before put into d
            point[2][call.outputs] = self._ask(call, quantity, "output", point)

    def _solve(self, pairs: list[Pair], point: Point) -> None:
        """Solve a loop: put outputs into d that are equal to their evaluation."""
        d = point[2]
        places = np.concatenate([np.r_[call.outputs] for call, _ in pairs])

        def residual(outputs: Vector) -> Vector:
            d[places] = outputs
            self._put_outputs(pairs, point)
            left: Vector = d[places] - outputs
            return left

        outputs = d[places]
        before = np.inf
        for _ in range(MAX_NEWTON_ROUNDS):
            left = residual(outputs)
            size = float(np.abs(left).max(initial=0.0))
            allowed = LOOP_TOLERANCE * max(1.0, np.abs(outputs).max())
            # Within the tolerance, rounds go on while each at least halves the residual.
            if before / 2 <= size <= allowed:
                return
            before = size
            # Each row of np.diag() changes one output; its
            # maximum is the length of the step.
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
            f"cannot solve the algebraic loop through Python blocks at t = {point[0]:g} s, among {names}: Newton's "
            "method finds no single solution; break it with a state, a UnitDelay, or other wiring"
        )

    def _add(self, kind: str, point: Point, into: Vector) -> None:
        """Put derivatives or indicators, by `kind`, of the blocks `into` those of all [as declared]."""
        for call, quantity in self._python.continuous:
            if kind != "derivative" or call.size:
                place = call.states if kind == "derivative" else call.events
                into[place] = self._ask(call, quantity, kind, point)

    def accepted(self, *point: *Point) -> None:
        """Notify Python blocks of an accepted step, after which they may request an event."""
        for call, quantity in self._python.continuous:
            if self._ask(call, quantity, "on_step", point):
                self.asking.add(call.path)

    def _handle(self, point: Point, into: Vector) -> None:
        """Put states and modes of blocks whose events happen `into` (x, modes) [as declared]."""
        _, x, d, _ = point
        for call, quantity in self._python.continuous:
            fired = d[call.fired] > 0.0
            if fired.any() or call.path in self.asking:
                happened = call.happened(fired)
                into[call.places(x.size)] = self._ask(
                    call, quantity, "on_event", point, happened
                )
        self.asking.clear()

    def _ask(
        self,
        call: BlockCall,
        quantity: Quantity,
        kind: str,
        point: Point,
        *more: Signals,
    ) -> Any:
        """Return the result of an equation of a continuous block, in one vector unless it is `on_step`."""
        t, x, d, p = point
        own = self.blocks.equations[call.path]
        u = self._inner.call(quantity.name, t, x, d, p)
        evaluate = call.ask if kind == "on_step" else call
        return evaluate(own, kind, t, call.own(x, d), u, p[call.parameters], *more)
