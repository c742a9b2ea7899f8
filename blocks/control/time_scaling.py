"""Trajectory that slows down during the motion when less acceleration is available."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.control.trajectory import (
    PEAK_ACCELERATION,
    Quintic,
    from_rest_to_rest,
)
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.support.types import Array

PEAK_BRAKING = 15.0 / 8.0
"""Peak deceleration of a stop along `from_rest_to_rest`, from unit speed in unit time."""

MIN_SHARE = 1e-6
"""Share of the acceleration below which the path coasts [-]."""

DISTANCE_TOLERANCE = 1e-9
"""Fraction of the displacement that counts as zero distance [-]."""


class RetimedQuintic(Quintic):
    r"""Quintic trajectory that slows down when less acceleration is available.

    The path is straight, :math:`x = x_0 + \Delta s`. If only the share f < 1 of the peak acceleration
    remains, :math:`a = 10 f / (\sqrt3\, T^2)`, the block makes a plan from the position and speed
    :math:`s_0, v_0` of that instant: a stop, superimposed on a motion over the remaining distance D,

    .. math::
        \dot s = v_0\,(1 - p(\tau)) + \frac{D}{T'}\,p'(\tau), \qquad \tau = \frac{t - t_0}{T'}, \qquad
        p = 10 \tau^3 - 15 \tau^4 + 6 \tau^5, \qquad D = 1 - s_0 - \tfrac12 v_0 T'

    in the time T' in which the peaks of both accelerations add up to a. A plan starts and ends with zero
    acceleration; the acceleration of the previous plan ends with a jump. If the goal is too near to stop
    there, D is zero: the path stops as soon as possible beyond the goal and then returns. The block makes a
    new plan if the share falls below that of the current plan, never if it grows or is NaN. Below a share of
    1e-6 the path coasts.

    Parameters
    ----------
    displacement : array_like
        Δ [unit]; its shape is that of the trajectory.
    duration : float
        T > 0 [s].
    sample_time : float
        Sample time of the path and of the input `share` [s].
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
    BlockError
        If the sample time is not above 0.

    Notes
    -----
    The share scales demands in a fixed direction. If the path rotates a body, demands also grow with the
    square of the speed, so that a share computed for the original motion is approximate.
    """

    share = Input(default=1.0, meaning="f: available share of the peak acceleration")
    arrival = Output(unit="s", meaning="time at which the path rests at the goal")
    overshoot = Output(
        meaning="overshoot of the plan beyond the goal, as a share of the displacement"
    )

    began = State(initial="start_time", unit="s", meaning="t_0 of the plan")
    lasts = State(initial="duration", unit="s", meaning="T' of the plan")
    passed = State(meaning="s_0 of the plan")
    speed = State(unit="1/s", meaning="v_0 of the plan")
    way = State(initial=1.0, meaning="D of the plan")
    allowed = State(initial=1.0, meaning="f of the plan")

    def __init__(
        self,
        displacement: npt.ArrayLike,
        duration: float,
        sample_time: float,
        *,
        start: npt.ArrayLike = 0.0,
        start_time: float = 0.0,
        unit: Unit = None,
    ) -> None:
        super().__init__(
            displacement, duration, start=start, start_time=start_time, unit=unit
        )
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration, arrival time and overshoot."""
        s, ds, dds = _planned(t, x)
        # The plan ends at s_0 + v_0 T'/2 + D. Round-off beyond the goal is no
        # overshoot: it would cause a return of its own.
        beyond = x.passed + x.speed * x.lasts / 2.0 + x.way - 1.0
        beyond = np.where(np.abs(beyond) > DISTANCE_TOLERANCE, beyond, 0.0)
        # A return over the distance b from rest peaks at PEAK_ACCELERATION b / T_b^2,
        # which is the allowed share of PEAK_ACCELERATION / T^2.
        back = p.duration * np.sqrt(
            np.maximum(np.abs(beyond), DISTANCE_TOLERANCE) / x.allowed
        )
        return {
            "position": self.moved(p.start, p.displacement * s),
            "velocity": p.displacement * ds,
            "acceleration": p.displacement * dds,
            "arrival": x.began + x.lasts + np.where(beyond == 0.0, 0.0, back),
            "overshoot": beyond,
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Make a new plan if the share has fallen, or if the plan has stopped away from the goal."""
        s, ds, _ = _planned(t, x)
        # A share of NaN stays NaN, and comparisons with it are false: it makes no plan.
        share = np.where(u.share < MIN_SHARE, MIN_SHARE, u.share)
        worse, ended = share < x.allowed, t >= x.began + x.lasts
        allowed = np.where(worse, share, x.allowed)
        a, left, speed = (
            allowed * PEAK_ACCELERATION / p.duration**2,
            1.0 - s,
            np.abs(ds),
        )
        # The shortest stop, with D = 0, uses all of the acceleration.
        stop = PEAK_BRAKING * speed / a
        # T' solves PEAK_BRAKING v_0 / T' + PEAK_ACCELERATION D / T'^2 = a with D = left
        # - v_0 T' / 2, which is a T'^2 + gain T' - PEAK_ACCELERATION left = 0.
        gain = (PEAK_ACCELERATION / 2.0 - PEAK_BRAKING) * speed
        # The square root has no derivative at a distance of zero.
        go = (
            np.sqrt(
                gain**2
                + 4.0
                * a
                * PEAK_ACCELERATION
                * np.maximum(np.abs(left), DISTANCE_TOLERANCE)
            )
            - gain
        ) / (2.0 * a)
        # The shortest stop ends before the goal, or the path is at rest.
        reaches = (left - ds * stop / 2.0) * ds >= 0.0
        lasts = np.where(reaches, go, stop)
        plan = {
            # A share that falls before the start time does not start the motion early.
            "began": np.maximum(t, x.began),
            "lasts": lasts,
            "passed": s,
            "speed": ds,
            "way": np.where(reaches, left - ds * lasts / 2.0, 0.0),
            "allowed": allowed,
        }
        arrived = np.logical_and(ended, np.abs(left) <= DISTANCE_TOLERANCE)
        new = np.logical_and(np.logical_or(worse, ended), np.logical_not(arrived))
        return {name: np.where(new, value, x[name]) for name, value in plan.items()}


def _planned(t: Array, x: Signals) -> tuple[Array, Array, Array]:
    """Return s and its derivatives [1, 1/s, 1/s^2] at a time, by the plan in the states."""
    tau = np.clip((t - x.began) / x.lasts, 0.0, 1.0)
    p, dp, ddp = from_rest_to_rest(tau)
    stopping = tau - tau**4 * (2.5 - 3.0 * tau + tau**2)  # the integral of 1 - p
    s = x.passed + x.speed * x.lasts * stopping + x.way * p
    ds = x.speed * (1.0 - p) + x.way * (dp / x.lasts)
    return s, ds, x.way * (ddp / x.lasts**2) - x.speed * (dp / x.lasts)
