r"""Exact derivatives of what runs with events log: forward, one step and one event after the other.

Where an indicator g crosses zero, the time of the event moves with what varies, q: the step that leads there
is of a length h with

.. math:: \frac{dh}{dq} = - \left(\frac{\partial g}{\partial h}\right)^{-1} \frac{\partial g}{\partial q},

both along the step as the solver takes it. State and time go through `on_event` so, and the rest of the step
is shorter by as much (Hiskens, Pai 2000, *Trajectory sensitivity analysis of hybrid systems*, IEEE
Transactions on Circuits and Systems I 47 (2)). Nothing is taken from differences.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.declarations import TIMED
from trussflow.blocks.framework.errors import DivergenceError, SimulationError
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.simulation.executor import InPlace, InterpretedExecutor, Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import fixed_step

SAME = 1e-9
"""How far apart the derivatives of two times may be that are one [-], relative to the larger."""


class TangentExecutor(InterpretedExecutor):
    """Takes a run, and along with it the derivatives of its state, of what changes at instants, and of time.

    Parameters
    ----------
    prepared : Prepared
        What runs, with a fixed-step solver.
    count : int
        How many numbers vary, q [-].
    """

    def __init__(self, prepared: Prepared, count: int) -> None:
        super().__init__(prepared.programs, prepared.plan)
        self._prepared, self._q, self._rows = prepared, count, list[Array]()
        self._time, self._begin = np.zeros((1, count)), (0.0, np.zeros(0))
        functions = {program.name: program.expanded for program in prepared.programs}
        rate, h = functions.pop("derivative"), ca.MX.sym("h")
        t, x, d, p = (ca.MX.sym(name, rate.size1_in(k)) for k, name in enumerate("txdp"))
        after = fixed_step(
            prepared.solver.solver, lambda time, y: rate(time, y, d, p), (t, t + h / 2, t + h), h, x
        )
        functions["step"] = ca.Function("step", [h, t, x, d, p], [after])
        # One direction more than what varies: the length of the step.
        self._along = {name: _along(function, count + 1) for name, function in functions.items()}

    def run(
        self,
        logged: NDArray[np.int64],
        start: tuple[Vector, Vector, Vector],
        slopes: tuple[Array, Array, Array],
    ) -> tuple[Array, Array]:
        """Return what is logged at ticks, and its derivatives: of shapes (ticks, width), (ticks, width, q).

        Parameters
        ----------
        logged : array of int
            Ticks at which it is logged; the last is the end [-].
        start : tuple of Vector
            x and d at the start, and p [as declared].
        slopes : tuple of array
            Their derivatives by what varies, each of shape (size, q).

        Raises
        ------
        SimulationError
            If an event is where no derivative is.
        DivergenceError
            If a state stops being finite.
        """
        (x, d, p), (self._x, self._d, self._p) = (
            [part.copy() for part in parts] for parts in (start, slopes)
        )
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
        if due[-1]:
            d[:] = self.call(f"sample_{due[-1]}", t, x, d, p)
        rows[-1] = self.call("outputs", t, x, d, p)
        return rows, np.array(self._rows)

    def call(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the quantity of that name; what changes state or log does so for the derivatives too."""
        if name == "on_event":
            self._to_event(t, x, d, p)
        found = super().call(name, t, x, d, p)
        if name == "outputs":
            self._rows.append(self._slope(name, t, x, d, p))
        elif name == "on_event":
            slope = self._slope(name, t, x, d, p)
            self._x, self._d[self._prepared.plan.modes.span] = slope[: x.size], slope[x.size :]
            self._begin = t, found[: x.size]
        elif name.startswith("sample_"):
            self._d = self._slope(name, t, x, d, p)
        return found

    def between(
        self, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
    ) -> Vector:
        """Return the state after a step with the events in it; the derivatives are those at its end."""
        self._begin = times[0], x
        after = super().between(method, times, x, d, p)
        self._to_instant(times[1], d, p)
        return after

    def _step(
        self, method: str, times: tuple[float, float, float], x: Vector, d: Vector, p: Vector
    ) -> Vector:
        if times[0] != self._begin[0]:  # the time of an event that was none
            self._to_instant(times[0], d, p)
            self._begin = times[0], x
        return super()._step(method, times, x, d, p)

    def _to_instant(self, t: float, d: Vector, p: Vector) -> None:
        """Move the derivatives to a time `t` [s] that stays: what began later takes a shorter step."""
        state = self._stepped(t, d, p)
        self._x = state[:, :-1] - state[:, -1:] * self._time
        self._time = np.zeros_like(self._time)

    def _slope(self, name: str, t: float, x: Vector, d: Vector, p: Vector) -> Array:
        """Return the derivative of a quantity as state and time move."""
        seeds = _still(self._time, self._x, self._d, self._p)
        return self._derivative(name, (t, x, d, p), seeds)[:, :-1]

    def _derivative(self, name: str, values: tuple[Vector | float, ...], seeds: list[Array]) -> Array:
        flat = self._along[name](*values, *(seed.ravel(order="F") for seed in seeds))
        return flat.reshape((-1, self._q + 1), order="F")

    def _stepped(self, t: float, d: Vector, p: Vector) -> Array:
        """Return the derivatives of the state after a step to `t` [s] by q, the last by the step's length."""
        begin, x = self._begin
        length = np.append(np.zeros((1, self._q)), [[1.0]], axis=1)
        seeds = [length, *_still(self._time, self._x, self._d, self._p)]
        return self._derivative("step", (t - begin, begin, x, d, p), seeds)

    def _to_event(self, t: float, x: Vector, d: Vector, p: Vector) -> None:
        """Move the derivatives to an event at time `t` [s], which moves itself if a step led to it."""
        if t == self._begin[0]:
            return
        state, plan = self._stepped(t, d, p), self._prepared.plan
        time = np.append(self._time, [[1.0]], axis=1)
        g = self._derivative("indicators", (t, x, d, p), [time, state, *_still(self._d, self._p)])
        g[plan.kinds == TIMED] -= time  # a time event is where its indicator, a time, meets time
        fired = np.flatnonzero(d[plan.fired.span])
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = -g[fired, :-1] / g[fired, -1:]
        apart = np.abs(lengths - lengths[0]) > SAME * np.abs(lengths).max(axis=0)
        if apart.any() or not np.isfinite(lengths).all():
            places = plan.sides.span.start + fired
            names = [e.describe(k - e.start) for k in places.tolist() for e in [plan.sides.at(k)]]
            why = "happen at once" if apart.any() else "touches zero without crossing it"
            raise SimulationError(
                f"cannot differentiate the run of '{plan.name}': at t = {t:g} s {' and '.join(names)} "
                f"{why}, and the least change of what varies makes another course of it"
            )
        self._x = state[:, :-1] + state[:, -1:] * lengths[0]
        self._time = self._time + lengths[0]


def _still(*slopes: Array) -> list[Array]:
    """Return `slopes` with a column for the length of the step, which does not change them."""
    return [np.pad(slope, ((0, 0), (0, 1))) for slope in slopes]


def _along(function: ca.Function, count: int) -> InPlace:
    """Return the derivative of a `function` of columns along so many directions, of values and directions."""
    values = [ca.MX.sym("value", function.size1_in(k)) for k in range(function.n_in())]
    seeds = [ca.MX.sym("seed", function.size1_in(k), count) for k in range(function.n_in())]
    found = function.forward(count)(*values, function(*values), *seeds)
    return InPlace(ca.Function("along", [*values, *seeds], [ca.densify(found)]))
