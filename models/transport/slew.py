"""Paths that turn the truss by any angle."""

from __future__ import annotations

import numpy.typing as npt

from trussflow.blocks.control.time_scaling import RetimedQuintic
from trussflow.blocks.control.trajectory import Quintic
from trussflow.blocks.framework.declarations import Attribute, Parameter
from trussflow.blocks.framework.port import Output
from trussflow.blocks.framework.types import Array
from trussflow.models.dynamics.task_space import moved
from trussflow.models.plant.space_truss import SpaceTruss


class Slew(Quintic):
    r"""Move a truss and turn it about one axis, from rest to rest, as `Quintic` does.

    .. math:: r = r_0 + \Delta r\,s, \qquad a = a_0 \circ \exp(\tfrac12 \varphi\, n s), \qquad
              \omega = \varphi\, n \dot s, \qquad \dot\omega = \varphi\, n \ddot s

    The axis n is the same in the truss and in space, so angular velocity and acceleration are along it.

    Parameters
    ----------
    truss : SpaceTruss
        The plant, at the start; it is only looked at.
    displacement : array_like, shape (m,)
        Way of the truss frame along inertial axes, axis in the truss frame times angle (or changes of Euler
        angles, if the truss has those), and changes of the joints [m, rad].
    duration : float
        T > 0 [s].
    *more : float
        For `RetimedSlew`: its sample time [s].
    start_time : float
        When the motion starts [s].
    """

    position = Output("places", unit=Attribute("place_units"), meaning="where to be")
    start = Parameter(shape="places", meaning="where the motion starts")

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
        start = truss.parameters["initial_coordinates"][: truss.rigid_q]
        super().__init__(
            displacement, duration, *more, start=start, start_time=start_time, unit=truss.task_units
        )

    def moved(self, start: Array, way: Array) -> Array:
        """Return where one is on a way: turned, not added."""
        return moved(self.kind, start, way)


class RetimedSlew(Slew, RetimedQuintic):
    """Move as `Slew` does, and when less acceleration is left, more slowly from there on.

    Parameters
    ----------
    truss : SpaceTruss
        As of `Slew`.
    displacement : array_like, shape (m,)
        Likewise [m, rad].
    duration : float
        Likewise [s].
    sample_time : float
        As of `RetimedQuintic` [s].
    start_time : float
        As of `Slew` [s].
    """
