"""Executors: the functions of a plan in compiled code, in CasADi's interpreter, or in NumPy.

All three give the same numbers to round-off (but for NaN in a minimum or maximum, which the
interpreter loses). The compiled one is the fast one, the interpreter needs no compiler, and
plain NumPy can be stepped through with a debugger.
"""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.events import EventWatch
from trussflow.blocks.tracing.codegen import c_sources, content
from trussflow.blocks.tracing.compiler import compile_library
from trussflow.blocks.tracing.plan import Plan, Quantity
from trussflow.blocks.tracing.program import Program


@dataclass(slots=True)
class Progress:
    """How far `Executor.advance` came.

    Attributes
    ----------
    steps : int
        Steps taken.
    fault : str
        Empty, or ``"x"`` or ``"d"``: which vector stopped being finite.
    bad : Vector or None
        The vector that is not finite.
    """

    steps: int
    fault: str = ""
    bad: Vector | None = None


@dataclass(frozen=True, slots=True)
class Span:
    """A run of fixed steps without interruption.

    Attributes
    ----------
    method : str
        ``"rk4"`` or ``"euler"``.
    tick : Fraction
        Length of a step [s]; the first tick is at time 0.
    first : int
        Tick at which the span starts.
    due : array of uint16
        For each step, 0 or the number of the sample function to call before it.
    logged : array of uint8
        For each step, whether to log before it.
    """

    method: str
    tick: Fraction
    first: int
    due: NDArray[np.uint16]
    logged: NDArray[np.uint8]


class Executor(Protocol):
    """What the scheduler needs of a plan."""

    name: str

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        ...

    def advance(self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector) -> Progress:
        """Take the steps of a span in place; rows of `log` are filled in order."""
        ...

    def between(
        self, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
    ) -> Vector:
        """Return the state after a step of any length; see `step` for the arguments."""
        ...

    def watch(self, d: Vector, p: Vector) -> EventWatch | None:
        """Return what finds and handles events while d and p stay the same, if there are any."""
        ...

    def before_jump(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Take note that d or p is about to change at a time: indicators of events may jump."""
        ...


class SteppingInPython:
    """Fixed steps in Python, the twin of ``driver.c``, for what is traced: without events."""

    name = ""

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        raise NotImplementedError

    def watch(self, d: Vector, p: Vector) -> EventWatch | None:
        """Return nothing: traced blocks have no events."""
        return None

    def before_jump(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Do nothing: traced blocks have no events."""

    def advance(self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector) -> Progress:
        """Take the steps of a span in place; rows of `log` are filled in order."""
        row = 0
        for k in range(len(span.due)):
            number = span.first + k
            t, following = float(number * span.tick), float((number + 1) * span.tick)
            if span.due[k]:
                updated = self.call(f"sample_{span.due[k]}", t, x, d, p)
                if not np.isfinite(updated).all():
                    return Progress(k, "d", updated)
                d[:] = updated
            if span.logged[k]:
                log[row] = self.call("outputs", t, x, d, p)
                row += 1
            state = self.between(span.method, (t, following, float(span.tick)), x, d, p)
            if not np.isfinite(state).all():
                return Progress(k, "x", state)
            x[:] = state
        return Progress(len(span.due))

    def between(
        self, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
    ) -> Vector:
        """Return the state after a step of any length; see `step` for the arguments."""
        return step(self, method, times, x, d, p)


def step(
    executor: Executor, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
) -> Vector:
    """Return the state after one step.

    Parameters
    ----------
    executor : Executor
        Evaluates the derivative.
    method : str
        ``"rk4"`` or ``"euler"``.
    times : tuple of float
        Begin, end and length of the step [s].
    x, d, p : Vector
        Continuous states, what changes at instants, parameters [as declared].
    """
    t, following, h = times
    # A signal that jumps where the step ends has not jumped yet for its last stage.
    end = float(np.nextafter(following, t))
    k1 = executor.call("derivative", t, x, d, p)
    if method == "euler":
        return x + h * k1
    k2 = executor.call("derivative", t + h / 2, x + h / 2 * k1, d, p)
    k3 = executor.call("derivative", t + h / 2, x + h / 2 * k2, d, p)
    k4 = executor.call("derivative", end, x + h * k3, d, p)
    return x + h / 6 * k1 + h / 3 * k2 + h / 3 * k3 + h / 6 * k4


class NumPyExecutor(SteppingInPython):
    """Plain NumPy: the equations as the blocks state them."""

    name = "numpy"

    def __init__(self, plan: Plan, quantities: Sequence[Quantity]) -> None:
        self._plan = plan
        self._quantities = {q.name: q for q in quantities}

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        quantity = self._quantities[name]
        arrays = quantity.collect(self._plan, self._plan.evaluate(t, x, d, p, quantity.active))
        return np.concatenate([np.zeros(0), *(np.ravel(a) for a in arrays)])


class InterpretedExecutor(SteppingInPython):
    """CasADi's interpreter: no compiler needed."""

    name = "interpreted"

    def __init__(self, programs: Sequence[Program]) -> None:
        self._functions = {p.name: p.function for p in programs}

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        return np.asarray(self._functions[name](t, x, d, p), dtype=float).ravel()


class CompiledExecutor(SteppingInPython):
    """C code, compiled once and cached on disk; whole spans of steps are taken in C."""

    name = "compiled"

    def __init__(self, programs: Sequence[Program]) -> None:
        self._sizes = {p.name: p.size for p in programs}
        self._library = ctypes.CDLL(str(compile_library(content(programs), partial(c_sources, programs))))
        self._library.tf_work_size.restype = ctypes.c_longlong
        self._work = self._work_space()
        self._bad = np.zeros(1 + max(s.numel() for s in programs[0].inputs))
        self._advance = self._library.tf_advance
        self._advance.restype = ctypes.c_longlong
        self._evaluate = self._library.tf_evaluate
        self._numbers = {p.name: i for i, p in enumerate(programs)}

    def _work_space(self) -> NDArray[np.uint8]:
        """Return memory on a 64-byte boundary, for aligned vector moves."""
        raw = np.zeros(self._library.tf_work_size() + 64, dtype=np.uint8)
        return raw[-raw.ctypes.data % 64 :]

    def twin(self) -> CompiledExecutor:
        """Return another one with work space of its own: steps run outside Python's lock."""
        other = copy.copy(self)
        other._work, other._bad = self._work_space(), self._bad.copy()
        return other

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name."""
        result = np.empty(self._sizes[name])
        self._evaluate(
            ctypes.c_int(self._numbers[name]),
            ctypes.c_double(t),
            _address(x),
            _address(d),
            _address(p),
            _address(result),
        )
        return result

    def advance(self, span: Span, x: Vector, d: Vector, p: Vector, log: Vector) -> Progress:
        """Take the steps of a span in place; rows of `log` are filled in order."""
        fault = ctypes.c_int(0)
        steps = self._advance(
            _address(self._work),
            ctypes.c_int(span.method == "rk4"),
            ctypes.c_double(span.tick.numerator),
            ctypes.c_double(span.tick.denominator),
            ctypes.c_longlong(span.first),
            ctypes.c_longlong(len(span.due)),
            _address(x),
            _address(d),
            _address(p),
            _address(span.due),
            _address(span.logged),
            _address(log),
            ctypes.c_longlong(log.shape[1]),
            ctypes.byref(fault),
            _address(self._bad),
        )
        if not fault.value:
            return Progress(steps)
        which = "x" if fault.value == 1 else "d"
        size = x.size if which == "x" else d.size
        return Progress(steps, which, self._bad[:size].copy())


def _address(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
