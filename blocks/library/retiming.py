"""A path that becomes slower, under way, when less acceleration is left."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.trajectory import PEAK_ACCELERATION, Quintic, from_rest_to_rest

PEAK_BRAKING = 15.0 / 8.0
"""Greatest deceleration of a stop along `from_rest_to_rest`, from a speed of 1 in a time of 1."""

LEAST_SHARE = 1e-6
"""Of the acceleration: with less, the path coasts."""

ARRIVED = 1e-9
"""Share of the displacement that is no distance."""


class RetimedQuintic(Quintic):
    r"""Move as `Quintic` does, and when less acceleration is left, more slowly from there on.

    The path is straight, :math:`x = x_0 + \Delta s`. When only the share f < 1 is left of the peak
    acceleration of the motion as given, :math:`a = 10 f / (\sqrt3\, T^2)`, a plan is made from
    :math:`s_0, v_0`, position and speed of that instant: to stop, and meanwhile to go the rest D of the way,

    .. math::
        \dot s = v_0\,(1 - p(\tau)) + \frac{D}{T'}\,p'(\tau), \qquad \tau = \frac{t - t_0}{T'}, \qquad
        p = 10 \tau^3 - 15 \tau^4 + 6 \tau^5, \qquad D = 1 - s_0 - \tfrac12 v_0 T'

    in the time T' in which the peaks of both accelerations add up to a. The plan starts and ends without
    acceleration; only what was left of the plan before breaks off. If the goal is too near to stop there, D
    is zero: the path stops as soon as it can, beyond the goal, and then comes back. A new plan is made when
    the share becomes smaller than that of the plan, never when it grows or is NaN. Without any share to
    speak of (below 1e-6) the path coasts.

    Parameters
    ----------
    displacement : array_like
        Δ [unit]; its shape is that of the trajectory.
    duration : float
        T > 0 [s].
    sample_time : float
        How often the path is computed and the share is looked at [s].
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
    The share is one of demands in a fixed direction. If the path turns a body, its demands grow with the
    square of the speed as well, and a share found for the motion as given is a guide only.
    """

    share = Input(default=1.0, meaning="f: what is left of the peak acceleration")
    arrival = Output(unit="s", meaning="when the path will rest at the goal")
    overshoot = Output(meaning="how far beyond the goal the plan stops, as a share of the displacement")

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
        super().__init__(displacement, duration, start=start, start_time=start_time, unit=unit)
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration, and where the plan leads."""
        s, ds, dds = _planned(t, x)
        beyond = x.passed + x.speed * x.lasts / 2.0 + x.way - 1.0
        beyond = np.where(np.abs(beyond) > ARRIVED, beyond, 0.0)
        back = p.duration * np.sqrt(np.maximum(np.abs(beyond), ARRIVED) / x.allowed)
        return {
            "position": self.moved(p.start, p.displacement * s),
            "velocity": p.displacement * ds,
            "acceleration": p.displacement * dds,
            "arrival": x.began + x.lasts + np.where(beyond == 0.0, 0.0, back),
            "overshoot": beyond,
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Make a new plan if less is left than it needs, or if it has stopped beside the goal."""
        s, ds, _ = _planned(t, x)
        share = np.where(u.share < LEAST_SHARE, LEAST_SHARE, u.share)
        worse, ended = share < x.allowed, t >= x.began + x.lasts
        allowed = np.where(worse, share, x.allowed)
        a, left, speed = allowed * PEAK_ACCELERATION / p.duration**2, 1.0 - s, np.abs(ds)
        stop = PEAK_BRAKING * speed / a
        gain = (PEAK_ACCELERATION / 2.0 - PEAK_BRAKING) * speed
        # At a distance of zero the root would have no derivative.
        go = (np.sqrt(gain**2 + 4.0 * a * PEAK_ACCELERATION * np.maximum(np.abs(left), ARRIVED)) - gain) / (
            2.0 * a
        )
        reaches = (left - ds * stop / 2.0) * ds >= 0.0
        lasts = np.where(reaches, go, stop)
        plan = {
            "began": np.maximum(t, x.began),
            "lasts": lasts,
            "passed": s,
            "speed": ds,
            "way": np.where(reaches, left - ds * lasts / 2.0, 0.0),
            "allowed": allowed,
        }
        arrived = np.logical_and(ended, np.abs(left) <= ARRIVED)
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
