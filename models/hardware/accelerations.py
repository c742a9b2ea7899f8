"""Accelerations measured by accelerometers on a truss."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.geometry.rotation import stacked
from trussflow.models.plant.truss_block import TrussBlock


class PointAccelerations(TrussBlock):
    r"""Accelerations of the grasp points, in truss axes, and of the bases' centroids, in base axes.

    An accelerometer averages over its sample. With the velocity v of the point and the angular velocity
    :math:`\omega` of its axes, both averaged over the ends of the sample,

    .. math:: a_k = (v_k - v_{k-1}) / T_s + \bar\omega \times \bar v

    So the equations of motion need not be solved. The first sample assumes constant speeds.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    sample_time : float
        T_s > 0 [s].

    Raises
    ------
    BlockError
        If the sample time is not above 0.
    """

    coordinates = Input("nq", unit=Attribute("coordinate_units"), meaning="q")
    speeds = Input("n", unit=Attribute("speed_units"), meaning="v")
    grasp = Output(
        ("robots", 3),
        unit="m/s**2",
        frame="truss",
        meaning="acceleration of each grasp point",
    )
    base = Output(
        ("robots", 3), unit="m/s**2", frame="base", meaning="acceleration of each base"
    )
    before = State(
        ("points", 6), meaning="velocities of points and axes at the previous sample"
    )

    def __init__(self, dynamics: TrussDynamics, sample_time: float) -> None:
        self.points = 2 * len(dynamics.arms)
        super().__init__(dynamics)
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the accelerations, mean values over the sample."""
        now = self._motion(u)
        mean, change = (now + x.before) / 2.0, (now - x.before) / self.sample_time
        found = change[:, :3] + stacked(
            [np.cross(row[3:], row[:3]) for row in mean], (3,)
        )
        return {"grasp": found[: self.robots], "base": found[self.robots :]}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store the velocities."""
        return {"before": self._motion(u)}

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return the initial velocities."""
        return {"before": self._motion(u)}

    def _motion(self, u: Signals) -> Array:
        """Return velocities of points and angular velocities of axes: all grasps, then all bases."""
        dynamics, rates = self.dynamics, u.speeds[self.rigid :]
        velocity, omega = u.speeds[:3], u.speeds[3:6]
        places = dynamics.modes.grasp_positions + dynamics.grasp_displacement(
            u.coordinates
        )
        grasps = []
        for i, translation in enumerate(dynamics.modes.grasp_translations):
            moving = velocity + np.cross(omega, places[i]) + translation @ rates
            grasps.append(np.concatenate([moving, omega]))
        # The columns of P_Q for a base are its partial velocities (virtual work).
        matrix = dynamics.evaluate(u.coordinates).actuation_matrix
        bases = u.speeds @ matrix[:, : 6 * self.robots]
        return np.concatenate(
            [stacked(grasps, (6,)), np.reshape(bases, (self.robots, 6))]
        )
