"""Paths of a truss through waypoints, whatever the coordinates of its attitude."""

from __future__ import annotations

from typing import Self

import numpy as np

from trussflow.blocks.control.trajectory import Trajectory, Waypoints
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import Output
from trussflow.blocks.framework.types import Array, Vector
from trussflow.models.dynamics.task_space import task_motion
from trussflow.models.geometry.attitude import EULER, AttitudeCoordinates
from trussflow.models.plant.space_truss import SpaceTruss


class TrussPath(Waypoints):
    """Polynomials of fifth degree in the coordinates of a truss; quaternions are made ones of length 1.

    Parameters
    ----------
    truss : SpaceTruss
        The plant; it is only looked at.
    times : Vector, shape (k,)
        Where one polynomial follows another [s].
    coefficients : list of Vector, shape (k - 1, rigid_q)
        By power, of the time since the last of `times` [unit/s^power].
    """

    position = Output("places", unit=Attribute("place_units"), meaning="where to be")

    def __init__(self, truss: SpaceTruss, times: Vector, coefficients: list[Vector]) -> None:
        self.kind = truss.dynamics.attitude
        self.places, self.place_units = truss.rigid_q, truss.position_units
        self._times, self._coefficients = times, coefficients
        Trajectory.__init__(self, (truss.rigid,), truss.task_units)

    @classmethod
    def through(cls, truss: SpaceTruss, times: Vector, rows: Vector) -> Self:
        """Return the path that flows through waypoints, as `Waypoints` does.

        Parameters
        ----------
        truss : SpaceTruss
            The plant; it is only looked at.
        times : Vector, shape (k,)
            Of the waypoints [s].
        rows : Vector, shape (k, rigid_q)
            Rigid coordinates there [m, unit of the attitude, rad].
        """
        rows = on_one_side(truss.dynamics.attitude, rows)
        return cls(truss, times, Waypoints(times, rows, stop=False)._coefficients)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
        numbers = super().output(t, x, u, p)
        motion = task_motion(self.kind, *numbers.values())
        return dict(zip(numbers, motion, strict=True))


def on_one_side(kind: AttitudeCoordinates, rows: Vector) -> Vector:
    """Return waypoints of which each quaternion is the one of its two that is nearer to that before.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude; Euler angles stay as they are.
    rows : Vector, shape (k, m)
        Coordinates, of which those of the truss count [m, unit of the attitude].
    """
    if kind == EULER:
        return rows
    attitudes, found = rows[:, 3 : kind.end], rows.copy()
    same = np.sum(attitudes[1:] * attitudes[:-1], axis=1) >= 0.0
    found[1:, 3 : kind.end] *= np.cumprod(np.where(same, 1.0, -1.0))[:, None]
    return found
