"""Paths with rotations of the truss by any angle."""

from __future__ import annotations

import numpy.typing as npt

from trussflow.blocks.control.time_scaling import RetimedQuintic
from trussflow.blocks.control.trajectory import Quintic
from trussflow.blocks.framework.declarations import Attribute, Parameter
from trussflow.blocks.framework.port import Output
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.task_space import moved
from trussflow.models.plant.space_truss import SpaceTruss


class Slew(Quintic):
    r"""Rest-to-rest translation of a truss and rotation about one axis, with the time law of `Quintic`.

    .. math:: r = r_0 + \Delta r\,s, \qquad a = a_0 \circ \exp(\tfrac12 \varphi\, n s), \qquad
              \omega = \varphi\, n \dot s, \qquad \dot\omega = \varphi\, n \ddot s

    The axis n is constant in truss and inertial frame, so angular velocity and acceleration are along it.

    Parameters
    ----------
    truss : SpaceTruss
        Plant with the initial coordinates.
    displacement : array_like, shape (m,)
        Displacement of the truss frame in inertial axes, rotation axis in the truss frame times angle (or
        changes of Euler angles), and changes of the joints [m, rad].
    duration : float
        Duration T > 0 [s].
    *more : float
        Sample time of `RetimedSlew` [s].
    start_time : float
        Start time of the motion [s].
    """

    position = Output(
        "places", unit=Attribute("place_units"), meaning="reference position"
    )
    start = Parameter(shape="places", meaning="position at the start")

    def __init__(
        self,
        truss: SpaceTruss,
        displacement: npt.ArrayLike,
        duration: float,
        *more: float,
        start_time: float = 0.0,
    ) -> None:
        self.kind = truss.dynamics.attitude
        self.places, self.place_units = truss.rigid_q, truss.position_units
        start = truss.start_position
        super().__init__(
            displacement,
            duration,
            *more,
            start=start,
            start_time=start_time,
            unit=truss.task_units,
        )

    def moved(self, start: Array, way: Array) -> Array:
        """Return the position after a displacement, with composed rotations."""
        return moved(self.kind, start, way)


class RetimedSlew(Slew, RetimedQuintic):
    """`Slew` whose acceleration can be reduced under way, see `RetimedQuintic`.

    Parameters
    ----------
    truss : SpaceTruss
        Plant with the initial coordinates.
    displacement : array_like, shape (m,)
        Displacement, see `Slew` [m, rad].
    duration : float
        Duration T > 0 [s].
    sample_time : float
        Sample time, see `RetimedQuintic` [s].
    start_time : float
        Start time of the motion [s].
    """
