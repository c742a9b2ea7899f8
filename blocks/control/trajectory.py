"""Trajectory generators: position, velocity and acceleration over time."""

from __future__ import annotations

from math import factorial
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import Output
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.piecewise import piece, polynomial, row_for_each
from trussflow.blocks.library.signals import (
    ACCELERATION_UNIT,
    VELOCITY_UNIT,
    finite,
    set_motion_units,
    structural,
)
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, yes_or_no

PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)
"""Peak acceleration of `Quintic` for unit displacement and duration, at the times (1 ± 1/√3)/2."""


class Trajectory(Block):
    """Base of trajectory generators: the ports that they share.

    Parameters
    ----------
    shape : tuple of int
        Shape of the position [-].
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.
    **parameters : array_like
        Parameters of the generator.
    """

    position = Output("shape", unit=Attribute("unit"), meaning="where to be")
    velocity = Output("shape", unit=VELOCITY_UNIT, meaning="rate of the position")
    acceleration = Output(
        "shape", unit=ACCELERATION_UNIT, meaning="rate of the velocity"
    )

    def __init__(
        self, shape: tuple[int, ...], unit: Unit, **parameters: object
    ) -> None:
        self.shape = shape
        set_motion_units(self, unit)
        super().__init__(**parameters)


def from_rest_to_rest(tau: Array) -> tuple[Array, Array, Array]:
    """Return the polynomial of fifth degree that rises from 0 to 1, and its two derivatives.

    Parameters
    ----------
    tau : array
        From 0 to 1 [1].
    """
    s = tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
    # Factored, so that both are exactly zero where the motion ends.
    return (
        s,
        30.0 * tau**2 * (1.0 - tau) ** 2,
        60.0 * tau * (1.0 - tau) * (1.0 - 2.0 * tau),
    )


class Quintic(Trajectory):
    r"""Move from rest to rest along a polynomial of fifth degree, and stay there.

    .. math::

        x(t) = x_0 + \Delta\,(10 \tau^3 - 15 \tau^4 + 6 \tau^5),
        \qquad \tau = \frac{t - t_0}{T} \text{ from 0 to 1}

    Velocity and acceleration are zero at both ends; the acceleration is continuous.

    Parameters
    ----------
    displacement : array_like
        Δ [unit]; its shape is that of the trajectory.
    duration : float
        T > 0 [s].
    start : array_like
        x_0 [unit].
    start_time : float
        t_0 [s].
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.

    Raises
    ------
    ParameterError
        If the duration is not above 0, or the start has another shape.

    References
    ----------
    Li, Wei, Chen (2026), *Anti-Disturbance Trajectory Tracking Control of Large Space
    Flexible Truss by Four Space Robots*, section 4.
    """

    displacement = Parameter(shape="shape", meaning="Δ: distance to move")
    duration = Parameter(above=0.0, unit="s", meaning="T: time the motion takes")
    start = Parameter(shape="shape", meaning="x_0: where the motion starts")
    start_time = Parameter(unit="s", meaning="t_0: when the motion starts")

    def __init__(
        self,
        displacement: npt.ArrayLike,
        duration: float,
        *,
        start: npt.ArrayLike = 0.0,
        start_time: float = 0.0,
        unit: Unit = None,
    ) -> None:
        super().__init__(
            finite_array("parameter 'displacement' of Quintic", displacement).shape,
            unit,
            displacement=displacement,
            duration=duration,
            start=start,
            start_time=start_time,
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
        s, ds, dds = from_rest_to_rest(
            np.clip((t - p.start_time) / p.duration, 0.0, 1.0)
        )
        return {
            "position": self.moved(p.start, p.displacement * s),
            "velocity": p.displacement * (ds / p.duration),
            "acceleration": p.displacement * (dds / p.duration**2),
        }

    def moved(self, start: Array, way: Array) -> Array:
        """Return the position after a displacement: the sum, unless a subclass has other coordinates.

        Parameters
        ----------
        start : array
            Initial position [unit].
        way : array
            Displacement from the initial position [unit].
        """
        return start + way

    def breakpoints(self) -> tuple[float, ...]:
        """Return start and end, where the jerk jumps."""
        start = float(self.parameters["start_time"])
        return start, start + float(self.parameters["duration"])


class Trapezoid(Trajectory):
    r"""Move with constant acceleration, constant velocity, constant deceleration.

    All elements move along one straight line and start and stop together; the slowest
    element, at its own limits, sets the pace. Short motions never reach the velocity limit:
    their velocity profile is a triangle. The acceleration jumps.

    Parameters
    ----------
    displacement : array_like
        Distance to move [unit]; its shape is that of the trajectory.
    max_velocity, max_acceleration : array_like
        Limits above 0 [unit/s, unit/s^2]; one number, or one per element.
    start : array_like
        Initial position [unit].
    start_time : float
        Start time of the motion [s].
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.

    Attributes
    ----------
    duration : float
        Time that the motion takes [s].
    ramp_time : float
        Time that speeding up takes, and slowing down [s].

    Raises
    ------
    ParameterError
        If a limit is not above 0, or shapes disagree.
    BlockError
        If the start time is not finite.
    """

    start = Parameter(shape="shape", meaning="where the motion starts")

    def __init__(
        self,
        displacement: npt.ArrayLike,
        max_velocity: npt.ArrayLike,
        max_acceleration: npt.ArrayLike,
        *,
        start: npt.ArrayLike = 0.0,
        start_time: float = 0.0,
        unit: Unit = None,
    ) -> None:
        delta = finite_array("parameter 'displacement' of Trapezoid", displacement)
        owner, shape = type(self).__name__, delta.shape
        velocity = structural(owner, "max_velocity", max_velocity, shape, above=0.0)
        acceleration = structural(
            owner, "max_acceleration", max_acceleration, shape, above=0.0
        )
        # One distance s is planned: that of the element with the longest way.
        way = float(np.max(np.abs(delta), initial=0.0))
        self._direction = delta / way if way else delta
        self._start_time = finite("Trapezoid", "start_time", start_time)
        self._rate = self.ramp_time = self.duration = 0.0
        if way:
            # An element that does not move sets no limit, as its limits / eps are huge.
            share = np.maximum(np.abs(self._direction), np.finfo(float).eps)
            top = float(np.min(velocity / share))
            self._rate = float(np.min(acceleration / share))
            # Without cruise, half of the way is ramp: rate ramp^2 / 2 = way / 2. With
            # and without, the area under the velocity is rate ramp (duration - ramp).
            self.ramp_time = min(top / self._rate, float(np.sqrt(way / self._rate)))
            self.duration = self.ramp_time + way / (self._rate * self.ramp_time)
        super().__init__(shape, unit, start=start)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
        rate, ramp, end = self._rate, self.ramp_time, self.duration
        time = np.clip(t - self._start_time, 0.0, end)
        up, down = np.minimum(time, ramp), np.maximum(time - (end - ramp), 0.0)
        cruise = np.maximum(time - ramp, 0.0)
        s = rate * (up**2 / 2 + ramp * cruise - down**2 / 2)
        ds = rate * (up - down)
        elapsed = t - self._start_time
        slowing = np.where(
            elapsed < end, np.where(elapsed < end - ramp, 0.0, -rate), 0.0
        )
        dds = np.where(elapsed < 0.0, 0.0, np.where(elapsed < ramp, rate, slowing))
        return {
            "position": p.start + self._direction * s,
            "velocity": self._direction * ds,
            "acceleration": self._direction * dds,
        }

    def breakpoints(self) -> tuple[float, ...]:
        """Return where the acceleration jumps."""
        t0, ramp, end = self._start_time, self.ramp_time, self.duration
        return t0, t0 + ramp, t0 + end - ramp, t0 + end


class Waypoints(Trajectory):
    r"""Pass given positions at given times, along polynomials of fifth degree.

    With `stop`, the motion rests at each waypoint, with zero velocity and acceleration.
    Otherwise it follows the quintic spline, which has the least integral of squared jerk
    of all curves through the waypoints from rest to rest. The spline may overshoot
    between waypoints; the stopping motion does not. Before the first and after the last
    time the position is held.

    Parameters
    ----------
    times : array_like, shape (k,)
        Increasing [s], at least two.
    positions : array_like, shape (k,) or (k, n)
        One row for each time [unit].
    stop : bool
        Whether to stop at each waypoint.
    unit : str, tuple of str or None
        Unit of the position, or one per element; None leaves units unchecked.

    Raises
    ------
    BlockError
        If the times do not increase, or the positions do not match them.
    """

    def __init__(
        self,
        times: npt.ArrayLike,
        positions: npt.ArrayLike,
        *,
        stop: bool = True,
        unit: Unit = None,
    ) -> None:
        self._times, points = row_for_each(
            "Waypoints", times=times, positions=positions
        )
        yes_or_no("Waypoints", "stop", stop)
        self._coefficients = (_stopping if stop else _flowing)(self._times, points)
        super().__init__(points.shape[1:], unit)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
        time = np.clip(t, self._times[0], self._times[-1])
        start, *c = piece(
            time, self._times[:-1], [self._times[:-1], *self._coefficients]
        )
        local = time - start
        # The clipped time would hold the rates of the ends. They are zero up to
        # round-off only, and a position that is held must have rates of exactly zero.
        moving = np.where(
            t < self._times[0], 0.0, np.where(t > self._times[-1], 0.0, 1.0)
        )
        ds = polynomial(local, [k * c[k] for k in range(1, 6)])
        dds = polynomial(local, [k * (k - 1) * c[k] for k in range(2, 6)])
        return {
            "position": polynomial(local, c),
            "velocity": moving * ds,
            "acceleration": moving * dds,
        }

    def breakpoints(self) -> tuple[float, ...]:
        """Return the times of the waypoints, where the jerk may jump."""
        return tuple(float(t) for t in self._times)


def _stopping(times: Vector, points: Vector) -> list[Vector]:
    """Return coefficients, by power, of the quintics that rest at each waypoint."""
    step = np.diff(points, axis=0)
    # One span per row, with axes of length 1 for the elements of a position.
    span = np.diff(times).reshape(-1, *(1,) * (points.ndim - 1))
    zero = np.zeros_like(step)
    cubic, quartic, quintic = (
        10 * step / span**3,
        -15 * step / span**4,
        6 * step / span**5,
    )
    return [points[:-1], zero, zero, cubic, quartic, quintic]


def _flowing(times: Vector, points: Vector) -> list[Vector]:
    """Return coefficients, by power, of the quintic spline through the waypoints."""
    from scipy.interpolate import make_interp_spline

    zero = np.zeros(points.shape[1:])
    # First and second derivative are zero at both ends. With the values at the k
    # waypoints these are the k + 4 conditions of a quintic spline.
    rest = [(1, zero), (2, zero)]
    both: Any = (rest, rest)  # SciPy's type stubs do not know this form
    spline = make_interp_spline(times, points, k=5, bc_type=both)
    return [spline(times[:-1], nu=power) / factorial(power) for power in range(6)]
