"""Variable steps in Python; compiled code takes the same steps in C (``tracing/variable_step.h``)."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trussflow.blocks.support.interrupts import uninterrupted
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing import tableaus
from trussflow.blocks.tracing.tableaus import STIFF_METHOD, tableau

if TYPE_CHECKING:
    from trussflow.blocks.simulation.executor import Executor
    from trussflow.blocks.tracing.variable_step import SparseJacobian

METHODS = (*tableaus.METHODS, "auto")
"""Solvers with variable steps. Explicit: RK45, DOP853. Stiff: Rodas5P. Automatic choice: auto."""

IMPLICIT = (STIFF_METHOD, "auto")
"""Solvers that use the Jacobian."""

AUTOMATIC_START = "DOP853"
"""Method with which the automatic choice starts."""

SAFETY, MIN_FACTOR, MAX_FACTOR = 0.9, 0.2, 10.0
"""Factor of the predicted step, and bounds of its change [-]."""

STIFF_STEPS, RESET_STEPS = 15, 6
"""Number of steps limited by stability after which equations are stiff, and of others that reset it [-]."""

DIFFERENCE = float(np.sqrt(np.finfo(float).eps))
"""Relative step of difference quotients [-]."""


class AdaptiveError(ArithmeticError):
    """The solver gave up; the arguments are the time and state of a derivative that is not finite, or None."""


class Control(ctypes.Structure):
    """Settings and state of a run with variable steps, as ``tf_control`` in ``variable_step.h``.

    Attributes
    ----------
    t, end : float
        Time reached, and end of the span [s].
    h : float
        Length of the next step; 0 if it is to be chosen [s].
    rtol, atol : float
        Tolerances [-, unit of the state].
    short_step : float
        Length below which steps count as short [s].
    failed : float
        Time at which the derivative was not finite, or an indicator not a number; NaN if there is none [s].
    switched : float
        Time at which the automatic choice changed to the stiff method, NaN if it did not [s].
    max_steps : int
        Largest number of steps of one call [-].
    due_rows, room, rows : int
        Number of times to log, of rows there is memory for, and of those written by a call [-].
    steps, rejected, evaluations, factorizations, short_steps : int
        Numbers of accepted and of rejected steps, of evaluations of the derivative, of factorizations,
        and of the last short steps [-].
    method : int
        Index of the method.
    automatic : int
        Whether the choice of the method is automatic.
    begun, stepped : int
        Whether the span has begun, and whether rows of the last step are to be logged.
    limited_steps, other_steps : int
        Numbers of steps limited by stability, and of others since [-].
    """

    _fields_ = tuple(
        (name, kind)
        for kind, names in (
            (ctypes.c_double, "t end h rtol atol short_step failed switched"),
            (
                ctypes.c_longlong,
                "max_steps due_rows room rows steps rejected evaluations",
            ),
            (ctypes.c_longlong, "factorizations short_steps"),
            (ctypes.c_int, "method automatic begun stepped limited_steps other_steps"),
        )
        for name in names.split()
    )

    @classmethod
    def of(cls, solver: str, rtol: float, atol: float, short_step: float) -> Control:
        """Return the control of a run by a `solver` of `METHODS`; others as the attributes [-, unit, s]."""
        automatic = solver == "auto"
        method = AUTOMATIC_START if automatic else solver
        return cls(
            rtol=rtol,
            atol=atol,
            short_step=short_step,
            switched=np.nan,
            method=tableaus.METHODS.index(method),
            automatic=automatic,
        )

    def begin(self, t: float, end: float) -> None:
        """Begin a span from `t` to `end` [s]."""
        self.t, self.end, self.begun = t, end, 0


class VariableSpan(NamedTuple):
    """Variable steps that are taken in one call.

    Attributes
    ----------
    control : Control
        Settings and state.
    x, d, p : Vector
        States and discrete values, which change in place, and parameters [as declared].
    times : Vector
        Times to log inside the span that are left [s].
    rows : Vector
        Memory for the outputs at the first of them [as declared].
    """

    control: Control
    x: Vector
    d: Vector
    p: Vector
    times: Vector
    rows: Vector


class VariableSteps:
    """Variable steps of one span, in Python.

    Parameters
    ----------
    executor : Executor
        Executor of the equations.
    span : VariableSpan
        The span, before its first step.
    jacobian : SparseJacobian or None
        Structure of the Jacobian; None for difference quotients.
    """

    def __init__(
        self, executor: Executor, span: VariableSpan, jacobian: SparseJacobian | None
    ) -> None:
        self._executor = executor
        self._control, self._x, self._d, self._p = control, x, d, p = span[:4]
        self._structure = jacobian
        self._watch = executor.watch(d, p)
        # A signal that jumps where the span ends has not jumped yet for a stage at the end.
        self._last = float(np.nextafter(control.end, control.t))
        self._failed: Vector | None = None
        self._slope: Vector | None = None
        self._slopes: tuple[Vector, Vector] | None = None  # by the states and by time
        self._next = self._stage = self._arrived = x
        self._used = tableau(self._method)
        self._now = self._h = 0.0
        self._k = np.zeros((0, 0))
        self._dense: Vector | None = None
        self._event = False

    def advance(self, times: Vector, rows: Vector) -> None:
        """Advance as the control says; fill `rows` with the outputs at the `times` [s] in turn.

        Raises
        ------
        AdaptiveError
            If no step is small enough.
        """
        c = self._control
        x = self._x
        watch = self._watch
        c.rows = 0
        if not c.begun:
            if watch is not None:
                x[:] = watch.begin(c.t, x)
            c.begun, c.stepped, c.h, self._slope = 1, 0, 0.0, None
        left = c.max_steps
        while True:
            if not c.stepped:
                if c.t >= c.end or left <= 0:
                    return
                left -= 1
                # A time event ends the step, so that no step has to be cut at it.
                stop = c.end if watch is None else min(c.end, watch.next_time())
                self._step(stop)
                if c.automatic and not tableau(self._method).gamma and self._is_stiff():
                    c.method, c.switched = tableaus.METHODS.index(STIFF_METHOD), c.t
                    self._slope = None
                c.stepped, self._arrived, self._event = 1, self._next, False
                if watch is not None:
                    found = watch.after_step(c.t, self._now, self._next, self._state)
                    if found is not None:
                        (self._now, self._arrived), self._event = found, True
            while c.rows < c.due_rows and times[c.rows] < self._now:
                if c.rows == c.room:
                    return
                t = float(times[c.rows])
                rows[c.rows] = self._executor.call(
                    "outputs", t, self._state(t), self._d, self._p
                )
                c.rows += 1
            self._arrive()

    def _arrive(self) -> None:
        """Go to the end of the step that was taken last, or to the first event in it."""
        c = self._control
        x = self._x
        x[:] = self._arrived
        c.t, c.stepped = self._now, 0
        # The last stage of an explicit method is the slope at its end; after a change of the method
        # there is none.
        if self._slope is not None:
            used = self._used
            self._slope = None if used.gamma else self._k[used.stages].copy()
        if self._event and self._watch is not None:
            x[:] = self._watch.handle(c.t, x, self._h)
            # A jump makes the step size and the slope invalid: the solver starts anew.
            c.h, self._slope = 0.0, None
        self._executor.keep_loops(min(c.t, self._last), x, self._d, self._p)

    @property
    def _method(self) -> str:
        return tableaus.METHODS[self._control.method]

    def _rate(self, t: float, x: Vector) -> Vector | None:
        """Return the derivative, or None if it is not finite."""
        t = min(t, self._last)
        self._control.evaluations += 1
        rate = self._executor.call("derivative", t, x, self._d, self._p)
        if np.isfinite(rate).all():
            return rate
        self._control.failed, self._failed = t, x.copy()
        return None

    def _scale(self, x: Vector) -> Vector:
        c = self._control
        scale: Vector = c.atol + c.rtol * np.maximum(np.abs(self._x), np.abs(x))
        return scale

    def _first_step(self, longest: float) -> float:
        """Return the first step after a start [s], at most the `longest`.

        It depends on the curvature (Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*,
        section II.4).
        """
        assert self._slope is not None

        def norm(values: Vector) -> float:
            return float(np.sqrt(np.mean((values / self._scale(self._x)) ** 2)))

        t = self._control.t
        state, rate = norm(self._x), norm(self._slope)
        h = min(0.01 * state / rate if min(state, rate) >= 1e-5 else 1e-6, longest)
        after = self._rate(t + h, self._x + h * self._slope)
        if after is None:
            return h
        most = max(rate, norm(after - self._slope) / h)
        order = tableau(self._method).order
        found = max(1e-6, h * 1e-3) if most <= 1e-15 else (0.01 / most) ** (1 / order)
        return min(found, 100 * h, longest)

    def _step(self, stop: float) -> None:
        """Take one step, at most up to `stop` [s].

        Raises
        ------
        AdaptiveError
            If no step is small enough.
        """
        c = self._control
        self._used = used = tableau(self._method)
        c.failed, self._failed, self._dense = np.nan, None, None
        if stop <= c.t:  # a time event that is due already
            self._now, self._h, self._next = c.t, 0.0, self._x
            return
        if self._slope is None:
            self._slopes = None
            self._slope = self._rate(c.t, self._x)
            if self._slope is None:
                raise AdaptiveError(c.failed, self._failed)
        if c.h == 0.0:
            c.h = self._first_step(stop - c.t)
        smallest = max(10 * np.finfo(float).eps * abs(c.t), 1e-300)
        rejected = False
        while True:
            if c.h < smallest and rejected:
                raise AdaptiveError(c.failed, self._failed)
            h = max(c.h, smallest)
            self._now = c.t + h
            if self._now >= stop:
                self._now, h = stop, stop - c.t
            c.failed, self._failed = np.nan, None
            formula = self._rosenbrock if used.gamma else self._explicit
            with np.errstate(all="ignore"):
                error = self._error(h) if formula(h) else np.nan
                factor = (
                    SAFETY * error ** (-1 / used.order) if error != 0.0 else MAX_FACTOR
                )
            if error < 1.0 and np.isfinite(self._next).all():
                factor = min(factor, MAX_FACTOR)
                c.h = h * (min(factor, 1.0) if rejected else factor)
                self._h = h
                c.steps += 1
                c.short_steps = c.short_steps + 1 if h < c.short_step else 0
                return
            c.rejected += 1
            rejected = True
            c.h = h * (factor if MIN_FACTOR < factor < 1.0 else MIN_FACTOR)

    def _explicit(self, h: float) -> bool:
        """Compute the increments and the next state; return whether all derivatives are finite."""
        used = self._used
        self._k = k = np.zeros((len(used.a), self._x.size))
        k[0] = self._slope
        for i in range(1, used.stages + 1):
            point = self._x + h * (used.a[i, :i] @ k[:i])
            rate = self._rate(self._control.t + used.c[i] * h, point)
            if rate is None:
                return False
            k[i] = rate
            self._stage, self._next = self._next, point
        return True

    def _rosenbrock(self, h: float) -> bool:
        """Compute the increments and the next state of a Rosenbrock method; return whether all are finite."""
        with uninterrupted():
            from scipy.linalg import LinAlgError, lu_factor, lu_solve

        used = self._used
        c = self._control
        x = self._x
        if self._slopes is None:
            self._slopes = self._linearized()
        matrix, by_time = self._slopes
        try:
            factors = lu_factor(np.eye(x.size) / (h * used.gamma) - matrix)
        except (ValueError, LinAlgError):  # of matrices that are not finite
            return False
        c.factorizations += 1
        self._k = k = np.zeros((len(used.a), x.size))
        for i in range(used.stages):
            rate = self._slope
            if i:
                rate = self._rate(c.t + used.c[i] * h, x + used.a[i, :i] @ k[:i])
            if rate is None:
                return False
            earlier = used.coupling[i, :i] @ k[:i] / h
            k[i] = lu_solve(
                factors,
                rate + earlier + used.slope[i] * h * by_time,
                check_finite=False,
            )
        self._next = x + used.a[used.stages, : used.stages] @ k[: used.stages]
        return True

    def _linearized(self) -> tuple[Vector, Vector]:
        """Return the derivatives of dx/dt by the states and by time."""
        t, x = min(self._control.t, self._last), self._x
        slopes = np.zeros((x.size, x.size + 1))
        if self._structure is None:
            assert self._slope is not None
            at = np.append(x, t)
            steps = DIFFERENCE * np.maximum(1.0, np.abs(at))
            steps[-1] = min(steps[-1], self._last - t)
            for j in np.flatnonzero(steps):
                there = at.copy()
                there[j] += steps[j]
                after = self._executor.call(
                    "derivative", there[-1], there[:-1], self._d, self._p
                )
                slopes[:, j] = (after - self._slope) / steps[j]
            return slopes[:, :-1], slopes[:, -1]
        for group in self._structure.groups:
            direction = np.zeros(x.size + 1)
            direction[group.columns] = 1.0
            found = self._executor.call(
                "tangent", t, np.concatenate([x, direction]), self._d, self._p
            )
            slopes[group.rows, group.places] = found[group.rows]
        return slopes[:, :-1], slopes[:, -1]

    def _error(self, h: float) -> float:
        """Return the error of the step of length `h` [s], relative to the tolerance."""
        used = self._used
        scale = self._scale(self._next)
        k = self._k[: used.stages + 1]
        first, second = (np.sum((row @ k / scale) ** 2) for row in used.error)
        both = float(first + 0.01 * second)
        if both == 0.0:
            return 0.0
        factor = 1.0 if used.gamma else h
        return float(factor * first / np.sqrt(both * scale.size))

    def _is_stiff(self) -> bool:
        """Return whether stability limits the steps of an explicit method.

        The measure is the change of the derivative between two points at the end of the step (Hairer and
        Wanner, *Solving Ordinary Differential Equations II*, section IV.2).
        """
        used = self._used
        c = self._control
        rate = self._k[used.stages] - self._k[used.stages - 1]
        above, below = np.sum(rate**2), np.sum((self._next - self._stage) ** 2)
        if below > 0.0 and self._h * np.sqrt(above / below) > used.limit:
            c.other_steps, c.limited_steps = 0, c.limited_steps + 1
        elif c.limited_steps:
            c.other_steps += 1
            if c.other_steps == RESET_STEPS:
                c.limited_steps = 0
        return bool(c.limited_steps == STIFF_STEPS)

    def _state(self, t: float) -> Vector:
        """Return the states at a time within the last step."""
        if self._dense is None:
            self._dense = self._made_dense()
        part = (t - self._control.t) / self._h
        total = np.zeros_like(self._x)
        for j in reversed(range(len(self._dense))):
            total = (total + self._dense[j]) * (1.0 - part if j % 2 else part)
        return self._x + total

    def _made_dense(self) -> Vector:
        """Return the rows of the dense output of the last step."""
        used, k, h = self._used, self._k, self._h
        for i in range(used.stages + 1, len(used.a)):
            t = min(self._control.t + used.c[i] * h, self._last)
            point = self._x + h * (used.a[i, :i] @ k[:i])
            k[i] = self._executor.call("derivative", t, point, self._d, self._p)
            self._control.evaluations += 1
        moved = self._next - self._x
        if used.gamma:
            return np.array([moved, *(used.dense @ k)])
        bent = h * k[0] - moved
        last = moved - h * k[used.stages] - bent
        return np.array([moved, bent, last, *(h * used.dense @ k)])
