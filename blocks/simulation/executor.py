"""Executors: the functions of a plan in compiled code, in CasADi's interpreter, or in NumPy.

All three give the same numbers to round-off, except that the interpreter ignores NaN in a minimum or
maximum. Compiled code is the fastest, the interpreter needs no compiler, and plain NumPy can be
stepped through with a debugger. An executor belongs to one run.
"""

from __future__ import annotations

import copy
import ctypes
import time
from collections.abc import Sequence, Set
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple, NoReturn, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import DivergenceError, RunEndedError, SimulationError
from trussflow.blocks.simulation.adaptive import (
    AdaptiveError,
    VariableSpan,
    VariableSteps,
)
from trussflow.blocks.simulation.block_instances import OpenBlocks
from trussflow.blocks.simulation.events import (
    EventWatch,
    ended,
    endless,
    full,
    not_a_number,
    refuse_not_finite,
)
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.codegen import c_sources, content
from trussflow.blocks.tracing.compiler import compile_library
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import Quantity
from trussflow.blocks.tracing.tableaus import METHODS, STIFF_METHOD
from trussflow.blocks.tracing.variable_step import SparseJacobian

CHUNK_SECONDS = 0.1
"""Wall time between two checks for Ctrl-C and the time limit, and updates of the progress bar [s]."""

Point = tuple[float, Vector, Vector, Vector]
"""Time t [s], states x, discrete values d, and parameters p [as declared]."""


class Progress(NamedTuple):
    """Result of `Executor.advance`.

    Attributes
    ----------
    steps : int
        Steps taken [-].
    fault : str
        Empty, or ``"x"`` or ``"d"``: which vector could not be computed, or stopped being finite. In
        `CompiledExecutor`, also ``"step"``: Python must take the next step, whose instant is done.
    bad : Vector or None
        The vector that is not finite [as declared].
    error : BaseException or None
        Exception raised instead.
    """

    steps: int
    fault: str = ""
    bad: Vector | None = None
    error: BaseException | None = None


class Span(NamedTuple):
    """Fixed steps that are taken in one call.

    Attributes
    ----------
    method : str
        ``"rk4"`` or ``"euler"``.
    tick : Fraction
        Length of a step [s]; the first tick is at time 0.
    first : int
        Tick at which the span starts [-].
    begin, end : int
        Places of its steps in the arrays, which may be longer [-].
    due : array of uint16
        For each step, 0 or the number of the sample function to call before it.
    logged : array of uint8
        For each step, whether to log before it.
    """

    method: str
    tick: Fraction
    first: int
    begin: int
    end: int
    due: NDArray[np.uint16]
    logged: NDArray[np.uint8]


class Executor:
    """Evaluation of a `plan` in a run. This base class steps in Python; ``driver.c`` does the same in C.

    Everywhere `name` is that of a quantity, `number` that of a set of clocks that tick together, `t` the time
    [s], and `x`, `d`, `p` are the continuous states, the discrete values and the parameters [as
    declared]; all four are a `point`. For `span`, `method` and `times` [s] see `Span` and `between`.
    """

    name = ""
    blocks = OpenBlocks()
    """The Python blocks of this run."""

    span_seconds = CHUNK_SECONDS
    """Wall time after which `advance` returns before the end of a span [s]."""

    jacobian: SparseJacobian | None = None
    """Sparse Jacobian of the derivative; None if no solver uses it, or the equations have none."""

    asking: Set[str] = frozenset()
    """Paths of the Python blocks that request an event after a step."""

    _watch: EventWatch | None = None
    _steps: VariableSteps | None = None

    def __init__(self, plan: Plan) -> None:
        self.plan = plan

    def call(self, name: str, *point: *Point) -> Vector:
        """Return the quantity of that name."""
        raise NotImplementedError

    def fresh(self) -> Self:
        """Return an executor for one more run, with its own work memory, since steps run without the GIL."""
        other = copy.copy(self)
        other._watch = other._steps = None
        return other

    def instant(self, number: int, *point: *Point, update: bool = True) -> Vector:
        """Return d after the sampled blocks of the set of that number have computed.

        It is d of the point itself if only Python blocks, whose results are checked, have changed it. Without
        `update`, the states of Python blocks do not change.
        """
        return self.call(f"sample_{number}", *point)

    def watch(self, d: Vector, p: Vector) -> EventWatch | None:
        """Return the event watch for these arrays d and p; None if there are no events."""
        if not self.plan.has_events:
            return None
        if self._watch is None or self._watch.d is not d or self._watch.p is not p:
            self._watch = EventWatch(self, d, p)
        return self._watch

    def keep_loops(self, *point: *Point) -> None:
        """Store the solutions of algebraic loops in d after a step, as the next initial guesses.

        Raises
        ------
        DivergenceError
            If a loop cannot be solved.
        """
        _, x, d, _ = point
        if not self.plan.guesses.size or not np.isfinite(x).all():
            return
        found = self.call("guesses", *point)
        if not np.isfinite(found).all():
            self.plan.loops.blame(*point)
        d[self.plan.guesses.span] = found

    def accepted(self, *point: *Point) -> None:
        """Notify Python blocks of an accepted step, after which they may request an event."""

    def close(self) -> None:
        """End the run: Python blocks release their resources."""
        self.blocks.close()

    def advance(
        self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector
    ) -> Progress:
        """Take steps of a span in place; rows of `log` [as declared] are filled in order.

        With slow Python code, it returns after part of the span.
        """
        row = k = 0
        fault = "d"
        until = time.perf_counter() + self.span_seconds
        try:
            for k in range(span.end - span.begin):
                if k and time.perf_counter() > until:
                    return Progress(k)
                fault = "d"
                number = span.first + k
                place = span.begin + k
                # A fraction until here, so that rounding errors
                # of the time do not add up.
                t = float(number * span.tick)
                following = float((number + 1) * span.tick)
                due = int(span.due[place])
                if due:
                    updated = self.instant(due, t, x, d, p)
                    if not self.plan.sound(updated):
                        return Progress(k, fault, updated)
                    # In place: the event watch holds views of d.
                    d[:] = updated
                if span.logged[place]:
                    log[row] = self.call("outputs", t, x, d, p)
                    row += 1
                fault = "x"
                if self._watch is not None:
                    self._watch.fresh = not k or bool(due)
                state = self.between(
                    span.method, (t, following, float(span.tick)), x, d, p
                )
                if not np.isfinite(state).all():
                    return Progress(k, fault, state)
                x[:] = state
        except BaseException as error:  # noqa: BLE001 - raised again once the rows so far are kept
            return Progress(k, fault, error=error)
        return Progress(span.end - span.begin)

    def vary(self, span: VariableSpan) -> None:
        """Advance by variable steps as a `span` says, in place; the twin in C is ``variable_span.h``.

        Raises
        ------
        AdaptiveError
            If no step is small enough.
        """
        if not span.x.size:
            self._vary_without_states(span)
            return
        if not span.control.begun or self._steps is None:
            self._steps = VariableSteps(self, span, self.jacobian)
        self._steps.advance(span.times, span.rows)

    def _vary_without_states(self, span: VariableSpan) -> None:
        """Go from row to row: without states, events are checked at the output times."""
        control, x, d, p, times, rows = span
        number = min(control.due_rows, control.room)
        ends = [*times[:number], *([control.end] if number == control.due_rows else [])]
        control.rows = 0
        for k, t in enumerate(ends):
            self.between("euler", (control.t, t, t - control.t), x, d, p)
            control.t = t
            if k < number:
                rows[k] = self.call("outputs", t, x, d, p)
                control.rows += 1

    def between(
        self,
        method: str,
        times: tuple[float, float, float],
        x: Vector,
        d: Vector,
        p: Vector,
    ) -> Vector:
        """Return the state after a step of any length, by ``"rk4"`` or ``"euler"``, with the events in it.

        Its twin in C is ``tf_between`` in ``tracing/events.h``: a change here needs one there. The
        `times` are begin, end and length of the step [s]. Events change d in place.
        """
        watch = self.watch(d, p)
        t, end, h = times
        if watch is None:
            x = self._step(method, times, x, d, p)
            self.keep_loops(end, x, d, p)
            return x
        if self.asking:  # after a step in C
            x = watch.handle(end, x, h)
            self.keep_loops(end, x, d, p)
            return x
        whole = h
        x = watch.begin(t, x)
        while t < end:
            stop = min(end, watch.next_time())
            start = x

            # The defaults bind the values of this pass: t and x
            # change before the next one.
            def state(time: float, t: float = t, start: Vector = start) -> Vector:
                return self._step(method, (t, time, time - t), start, d, p)

            # `h` is the exact length up to `end`; the
            # difference of rounded times is not.
            x = self._step(method, (t, stop, stop - t if stop < end else h), x, d, p)
            if not np.isfinite(x).all():
                return x
            event = watch.after_step(t, stop, x, state)
            t = stop
            if event is not None:
                t = event[0]
                x = watch.handle(*event, whole)
            # After an event at this time, so that the guesses fit
            # the states after its jump.
            self.keep_loops(t, x, d, p)
            h = end - t
        return x

    def _step(
        self,
        method: str,
        times: tuple[float, float, float],
        x: Vector,
        d: Vector,
        p: Vector,
    ) -> Vector:
        """Return the state after a step without events; its twin in C is ``tracing/fixed_step.h``."""
        t, following, h = times
        # A signal that jumps where the step ends has not jumped yet for its last stage.
        end = float(np.nextafter(following, t))

        def rate(time: float, state: Vector) -> Vector:
            return self.call("derivative", time, state, d, p)

        after: Vector = FIXED_STEP[method](rate, (t, t + h / 2, end), h, x)
        return after


class NumPyExecutor(Executor):
    """Plain NumPy: the equations of the blocks of a `plan`, called directly, for these `quantities`."""

    name = "numpy"

    def __init__(self, plan: Plan, quantities: Sequence[Quantity]) -> None:
        super().__init__(plan)
        self._quantities = {q.name: q for q in quantities}

    def call(self, name: str, *point: *Point) -> Vector:
        """Return the quantity of that name."""
        quantity = self._quantities[name]
        evaluation = self.plan.evaluate(*point, quantity.active)
        arrays = quantity.collect(evaluation)
        # np.concatenate() needs at least one array, but a quantity may be empty.
        return np.concatenate([np.zeros(0), *(np.ravel(a) for a in arrays)])


class InterpretedExecutor(Executor):
    """CasADi's interpreter of the `programs` of a `plan`: no compiler needed."""

    name = "interpreted"

    def __init__(self, programs: Sequence[Program], plan: Plan) -> None:
        super().__init__(plan)
        self._programs = programs
        self._functions = {p.name: InPlace(p.function) for p in programs}

    def fresh(self) -> Self:
        """Return an executor with its own argument and result buffers."""
        other = type(self)(self._programs, self.plan)
        other.jacobian = self.jacobian
        return other

    def call(self, name: str, *point: *Point) -> Vector:
        """Return the quantity of that name."""
        return self._functions[name](*point)


class InPlace:
    """A CasADi function with preallocated argument and result buffers.

    CasADi then converts no arguments in Python: a call is many times faster, and no Ctrl-C is lost in it.
    An object serves one run. Results hold all elements, column by column.

    Parameters
    ----------
    function : casadi.Function
        Function of dense arguments with one dense result.
    """

    def __init__(self, function: ca.Function) -> None:
        self._arguments = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self._result = np.zeros(function.nnz_out(0))
        self._buffer: Any  # CasADi does not keep it alive
        self._buffer, self._evaluate = function.buffer()
        for i, argument in enumerate(self._arguments):
            self._buffer.set_arg(i, argument.data)
        self._buffer.set_res(0, self._result.data)

    def __call__(self, *values: Vector | float) -> Vector:
        """Return the result for `values` of the arguments [as declared]."""
        for argument, value in zip(self._arguments, values, strict=True):
            argument[:] = value
        self._evaluate()
        return self._result.copy()


class CompiledExecutor(Executor):
    """C code of the `programs` of a `plan`, compiled once and cached; whole spans of steps are taken in C.

    With several `lanes` [-], all arrays have a last axis of lanes, each of which is one run. Steps may be of
    `variable` length.
    """

    name = "compiled"

    def __init__(
        self,
        programs: Sequence[Program],
        plan: Plan,
        lanes: int = 1,
        variable: bool = False,
    ) -> None:
        super().__init__(plan)
        self._lanes = lanes
        functions = ["tf_work_size", "tf_advance", "tf_evaluate"]
        if variable:
            functions.append("tf_vary")
        made = compile_library(
            content(programs, lanes, variable),
            partial(c_sources, programs, lanes, variable),
            functions,
        )
        library = ctypes.CDLL(str(made))
        pointer = ctypes.c_void_p
        whole = ctypes.c_longlong
        library.tf_work_size.restype = whole
        self._work_size: int = library.tf_work_size()
        self._advance = library.tf_advance
        self._advance.restype = whole
        self._advance.argtypes = [
            *(pointer, ctypes.c_int, ctypes.c_double, ctypes.c_double, whole, whole),
            *[pointer] * 6,
            *(whole, pointer, pointer, pointer, ctypes.c_int),
            *[pointer] * 3,
        ]
        if variable:
            self._vary = library.tf_vary
            self._vary.restype = None
            self._vary.argtypes = [
                *[pointer] * 7,
                *(whole, pointer, pointer, pointer, ctypes.c_int),
            ]
        self._evaluate = library.tf_evaluate
        self._evaluate.argtypes = [ctypes.c_int, ctypes.c_double, *[pointer] * 4]
        self.programs = {p.name: (i, p.size) for i, p in enumerate(programs)}
        # Room for x or d, or for the indicators, of which d has as many sides.
        self._bad_size = 1 + max(s.numel() for s in programs[0].inputs)
        self._take_memory()

    def _take_memory(self) -> None:
        raw = np.zeros(self._work_size + 64, dtype=np.uint8)
        # on a 64-byte boundary, for aligned vector moves
        self._work = raw[-raw.ctypes.data % 64 :]
        self._bad = np.zeros(self._bad_size * self._lanes)
        self._fault = ctypes.c_int(0)
        self._own = (
            self._work.ctypes.data,
            ctypes.addressof(self._fault),
            self._bad.ctypes.data,
        )
        # looking one up takes longer than a call
        self._addresses = [_Address() for _ in range(7)]
        self._results = {}
        for name, (number, size) in self.programs.items():
            result = np.empty(size if self._lanes == 1 else (size, self._lanes))
            self._results[name] = number, result, result.ctypes.data

    def fresh(self) -> Self:
        """Return an executor with its own work memory."""
        other = super().fresh()
        other._take_memory()
        return other

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        number, result, address = self._results[name]
        to_x, to_d, to_p = self._addresses[:3]
        self._evaluate(number, t, to_x(x), to_d(d), to_p(p), address)
        # The next call overwrites the buffer.
        return result.copy()

    def advance(
        self,
        span: Span,
        x: Vector,
        d: Vector,
        p: Vector,
        log: Vector,
        python: int | None = None,
        instant: Any = None,
        blocks: int | None = None,
    ) -> Progress:
        """Take the steps of a span in place; rows of `log` [as declared] are filled in order.

        For `python`, `instant` and `blocks`, a C function and addresses, see ``driver.c``.
        """
        to_x, to_d, to_p, to_due, to_logged, to_log, to_kinds = self._addresses
        work, fault, bad = self._own
        steps = self._advance(
            work,
            [*FIXED_STEP].index(span.method),
            span.tick.numerator,
            span.tick.denominator,
            span.first,
            span.end - span.begin,
            to_x(x),
            to_d(d),
            to_p(p),
            # One lookup serves all spans of a window: only the offset changes.
            to_due(span.due) + span.begin * span.due.itemsize,
            to_logged(span.logged) + span.begin * span.logged.itemsize,
            to_log(log),
            log.shape[1],
            fault,
            bad,
            to_kinds(self.plan.kinds),
            self.plan.sides.span.start,
            python,
            instant,
            blocks,
        )
        if not self._fault.value:
            return Progress(steps)
        # The faults are numbered by the first enum of events.h.
        if self._fault.value <= 2:
            which, size = ("x", x.size) if self._fault.value == 1 else ("d", d.size)
            return Progress(steps, which, self._bad[:size].copy())
        if self._fault.value == 9:
            return Progress(steps, "step")
        # An indicator is reported at the start of the step, the others at their own time.
        begin = (span.first + steps) * float(span.tick)
        t = begin if self._fault.value == 3 else float(self._bad[0])
        try:
            self._refuse(t, x, d, p)
        except (SimulationError, DivergenceError, RunEndedError) as error:
            return Progress(steps, "x", error=error)

    def _refuse(self, t: float, x: Vector, d: Vector, p: Vector) -> NoReturn:
        """Raise the error of an indicator, of an algebraic loop, or of events, at time `t` [s]."""
        match self._fault.value:
            case 3:
                not_a_number(self.plan, self._bad[: self.plan.kinds.size], t, x, d, p)
            case 5:
                self.plan.loops.blame(t, x, d, p)
            case 7:
                ended(self.plan, t, d)
            case 8:
                full(self.plan, t, d)
        endless(t)

    def vary(self, span: VariableSpan) -> None:
        """Advance by variable steps as a `span` says, in place."""
        control, x, d, p, times, rows = span
        stiff = METHODS[control.method] == STIFF_METHOD
        if not x.size or (stiff and self.jacobian is None):
            super().vary(span)
            return
        to_x, to_d, to_p, _, _, to_log, to_times = self._addresses
        work, fault, bad = self._own
        self._vary(
            work,
            ctypes.addressof(control),
            to_x(x),
            to_d(d),
            to_p(p),
            to_times(times),
            to_log(rows),
            rows.shape[1],
            fault,
            bad,
            self.plan.kinds.ctypes.data,
            self.plan.sides.span.start,
        )
        t = control.t
        # The faults are numbered by the first enum of events.h.
        match self._fault.value:
            case 1 | 2 as which:
                refuse_not_finite(
                    self.plan, t, self._bad[: x.size] if which == 1 else x, d
                )
            case 6:
                failed = self._bad[: x.size].copy()
                known = np.isfinite(control.failed)
                raise AdaptiveError(control.failed, failed if known else None)
            case 3 if np.isfinite(control.failed):
                self._refuse(control.failed, x, d, p)
            case 3 | 4 | 5 | 7 | 8:
                self._refuse(t, x, d, p)


class _Address:
    """The address of an array, looked up once while it is the same array."""

    def __init__(self) -> None:
        self._array: NDArray[Any] | None = None
        self._address = 0

    def __call__(self, array: NDArray[Any]) -> int:
        if array is not self._array:
            self._address = array.ctypes.data
            self._array = array  # last: Ctrl-C leaves no address of another array
        return self._address
