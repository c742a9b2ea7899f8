r"""Exact forward sensitivities of the logged signals of runs with events.

If an indicator g crosses zero, the event time depends on the varied values q. The length h of the step to
the event has the derivative

.. math:: \frac{dh}{dq} = - \left(\frac{\partial g}{\partial h}\right)^{-1} \frac{\partial g}{\partial q},

with both derivatives along the step of the solver. State and time sensitivities are passed through
`on_event`, and the rest of the step has the opposite change of length (Hiskens, Pai 2000, *Trajectory
sensitivity analysis of hybrid systems*, IEEE Transactions on Circuits and Systems I 47 (2)). No finite
differences are used.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import DivergenceError, SimulationError
from trussflow.blocks.framework.declarations import TIMED
from trussflow.blocks.simulation.executor import InPlace, InterpretedExecutor, Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.support.types import Array, Vector

SIMULTANEITY_TOLERANCE = 1e-9
"""Largest relative difference of the derivatives of two event times that count as one event [-]."""


class TangentExecutor(InterpretedExecutor):
    """Executor of a run with the forward sensitivities of states, discrete data, and time.

    Parameters
    ----------
    prepared : Prepared
        Prepared diagram with a fixed-step solver.
    count : int
        Number of varied numbers, the size of q [-].
    """

    span_seconds = math.inf  # a run is one span

    def __init__(self, prepared: Prepared, count: int) -> None:
        super().__init__(prepared.programs, prepared.plan)
        self._prepared, self._rows = prepared, list[Array]()
        # Slopes have one direction more than q: the length of the step, on which only a step depends.
        self._length = np.eye(1, count + 1, count)
        # Derivative of the present time, which depends on q after an event; and time
        # and state at which the present step began.
        self._time, self._begin = np.zeros((1, count + 1)), (0.0, np.zeros(0))
        functions = {program.name: program.expanded for program in prepared.programs}
        rate, h = functions.pop("derivative"), ca.MX.sym("h")
        t, x, d, p = (
            ca.MX.sym(name, rate.size1_in(k)) for k, name in enumerate("txdp")
        )
        after = FIXED_STEP[prepared.solver.solver](
            lambda time, y: rate(time, y, d, p), (t, t + h / 2, t + h), h, x
        )
        functions["step"] = ca.Function("step", [h, t, x, d, p], [after])
        self._along = {
            name: _along(function, count + 1) for name, function in functions.items()
        }

    def run(
        self,
        logged: NDArray[np.int64],
        start: tuple[Vector, Vector, Vector],
        slopes: tuple[Array, Array, Array],
    ) -> tuple[Array, Array]:
        """Return the logged values and their derivatives: shapes (ticks, width) and (ticks, width, q).

        Parameters
        ----------
        logged : array of int
            Ticks at which values are logged; the last is the end [-].
        start : tuple of Vector
            Initial x and d, and p [as declared].
        slopes : tuple of array
            Their derivatives by q, each of shape (size, q).

        Raises
        ------
        SimulationError
            If the derivative does not exist at an event.
        DivergenceError
            If a state stops being finite.
        """
        x, d, p = (part.copy() for part in start)
        # The initial values do not depend on the length of a step: a zero column.
        self._x, self._d, self._p = (np.pad(s, ((0, 0), (0, 1))) for s in slopes)
        self._rows, prepared, end = [], self._prepared, int(logged[-1])
        due, flags = prepared.schedule.due(0, end + 1), np.zeros(end, dtype=np.uint8)
        flags[logged[:-1]] = 1
        rows = np.empty((len(logged), prepared.channels[-1].columns.stop))
        span = Span(prepared.solver.solver, prepared.tick, 0, 0, end, due[:-1], flags)
        progress = self.advance(span, x, d, p, rows)
        t = float(progress.steps * prepared.tick)
        if progress.error is not None:
            raise progress.error
        if progress.fault:
            raise DivergenceError(f"the run stops being finite at t = {t:g} s")
        # The instant of the end: `advance` stops just before it.
        if due[-1]:
            d[:] = self.call(f"sample_{due[-1]}", t, x, d, p)
        rows[-1] = self.call("outputs", t, x, d, p)
        return rows, np.array(self._rows)[..., :-1]

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name, and update the derivatives with it."""
        # Before the states jump, their derivatives must be those at
        # the time of the event.
        if name == "on_event":
            self._to_event(t, x, d, p)
        found = super().call(name, t, x, d, p)
        if name == "outputs":
            self._rows.append(self._slope(name, t, x, d, p))
        elif name == "on_event":
            slope = self._slope(name, t, x, d, p)
            self._x, self._d[self._prepared.plan.modes.span] = (
                slope[: x.size],
                slope[x.size :],
            )
            self._begin = t, found[: x.size]
        elif name.startswith("sample_"):
            self._d = self._slope(name, t, x, d, p)
        return found

    def between(
        self,
        method: str,
        times: tuple[float, float, float],
        x: Vector,
        d: Vector,
        p: Vector,
    ) -> Vector:
        """Return the state after a step with its events, and move the derivatives to the end of the step."""
        self._begin = times[0], x
        after = super().between(method, times, x, d, p)
        self._to_instant(times[1], d, p)
        return after

    def _step(
        self,
        method: str,
        times: tuple[float, float, float],
        x: Vector,
        d: Vector,
        p: Vector,
    ) -> Vector:
        if times[0] != self._begin[0]:
            # the step ends at an event candidate that did not trigger
            self._to_instant(times[0], d, p)
            self._begin = times[0], x
        return super()._step(method, times, x, d, p)

    def _to_instant(self, t: float, d: Vector, p: Vector) -> None:
        """Move the derivatives to a fixed time `t` [s]; a later event time makes the step shorter."""
        state = self._stepped(t, d, p)
        # A fixed end makes dh/dq = -dt/dq, with the time t of the begin. The unit in
        # `_length` also removes the last column.
        self._x = state - state[:, -1:] * (self._time + self._length)
        self._time = np.zeros_like(self._time)

    def _slope(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Array:
        """Return the total derivative of a quantity by q, through state and time."""
        values = t, x, d, p
        return self._derivative(name, values, self._time, self._x, self._d, self._p)

    def _derivative(
        self, name: str, values: tuple[Vector | float, ...], *seeds: Array
    ) -> Array:
        flat = self._along[name](*values, *(seed.ravel(order="F") for seed in seeds))
        return flat.reshape((-1, self._length.size), order="F")

    def _stepped(self, t: float, d: Vector, p: Vector) -> Array:
        """Return the derivatives of the state after a step to `t` [s] by q, the last by the step's length."""
        begin, x = self._begin
        seeds = self._length, self._time, self._x, self._d, self._p
        return self._derivative("step", (t - begin, begin, x, d, p), *seeds)

    def _to_event(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Move the derivatives to an event at time `t` [s], whose time depends on q if a step leads to it."""
        # An event that follows a jump at this very time: no step leads to it.
        if t == self._begin[0]:
            return
        state, plan = self._stepped(t, d, p), self._prepared.plan
        time = self._time + self._length
        seeds = time, state, self._d, self._p
        g = self._derivative("indicators", (t, x, d, p), *seeds)
        g[plan.kinds == TIMED] -= (
            time  # the residual of a time event is its indicator minus the time
        )
        fired = np.flatnonzero(d[plan.fired.span])
        with np.errstate(divide="ignore", invalid="ignore"):
            # dh/dq by the formula of this module; the last column is dg/dh.
            lengths = -g[fired] / g[fired, -1:]
        apart = np.abs(lengths - lengths[0]) > SIMULTANEITY_TOLERANCE * np.abs(
            lengths
        ).max(axis=0)
        if apart.any() or not np.isfinite(lengths).all():
            places = plan.sides.span.start + fired
            names = [plan.sides.describe(k) for k in places.tolist()]
            why = (
                "happen at the same time"
                if apart.any()
                else "touches zero without crossing it"
            )
            raise SimulationError(
                f"cannot differentiate the run of '{plan.name}': at t = {t:g} s {' and '.join(names)} "
                f"{why}, so the run does not depend smoothly on the varied values"
            )
        # All events have the same dh/dq. Its last element is -1, so that the column of
        # the length becomes zero.
        self._x = state + state[:, -1:] * lengths[0]
        self._time = time + lengths[0]


def _along(function: ca.Function, count: int) -> InPlace:
    """Return the function of the derivatives of a `function` of columns along `count` directions."""
    values = [ca.MX.sym("value", function.size1_in(k)) for k in range(function.n_in())]
    seeds = [
        ca.MX.sym("seed", function.size1_in(k), count) for k in range(function.n_in())
    ]
    found = function.forward(count)(*values, function(*values), *seeds)
    return InPlace(ca.Function("along", [*values, *seeds], [ca.densify(found)]))
