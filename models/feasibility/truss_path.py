"""Paths of a truss through waypoints, with any attitude coordinates."""

from __future__ import annotations

from typing import Self

import numpy as np

from trussflow.blocks.control.trajectory import Trajectory, Waypoints
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import Output
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.dynamics.task_space import task_motion
from trussflow.models.geometry.attitude import EULER, AttitudeCoordinates
from trussflow.models.plant.space_truss import SpaceTruss


class TrussPath(Waypoints):
    """Piecewise fifth-degree polynomials in the coordinates of a truss, with normalized quaternions.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    times : Vector, shape (k,)
        Breakpoints of the polynomials [s].
    coefficients : list of Vector, shape (k - 1, rigid_q)
        Coefficients by power of the time since the last breakpoint [unit/s^power].
    """

    position = Output(
        "places", unit=Attribute("place_units"), meaning="reference position"
    )

    def __init__(
        self, truss: SpaceTruss, times: Vector, coefficients: list[Vector]
    ) -> None:
        self.kind = truss.dynamics.attitude
        self.places, self.place_units = truss.rigid_q, truss.position_units
        self._times, self._coefficients = times, coefficients
        Trajectory.__init__(self, (truss.rigid,), truss.task_units)

    @classmethod
    def through(cls, truss: SpaceTruss, times: Vector, rows: Vector) -> Self:
        """Return the path through waypoints without stops, as `Waypoints`.

        Parameters
        ----------
        truss : SpaceTruss
            Plant.
        times : Vector, shape (k,)
            Times of the waypoints [s].
        rows : Vector, shape (k, rigid_q)
            Rigid coordinates of the waypoints [m, unit of the attitude, rad].
        """
        rows = on_one_side(truss.dynamics.attitude, rows)
        return cls(truss, times, Waypoints(times, rows, stop=False)._coefficients)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
        numbers = super().output(t, x, u, p)
        motion = task_motion(self.kind, *numbers.values())
        return dict(zip(numbers, motion, strict=True))


def on_one_side(kind: AttitudeCoordinates, rows: Vector) -> Vector:
    """Return waypoints with the signs of quaternions that are nearer to the previous quaternion.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates; Euler angles are unchanged.
    rows : Vector, shape (k, m)
        Coordinates; only those of the truss are used [m, unit of the attitude].
    """
    if kind == EULER:
        return rows
    attitudes, found = rows[:, 3 : kind.end], rows.copy()
    same = np.sum(attitudes[1:] * attitudes[:-1], axis=1) >= 0.0
    # Cumulative: each change of sign applies also to all later waypoints.
    found[1:, 3 : kind.end] *= np.cumprod(np.where(same, 1.0, -1.0))[:, None]
    return found
