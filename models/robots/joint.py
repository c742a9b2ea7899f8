"""Joint of a robot: kind, name and limits."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from trussflow.models.errors import ModelError


class Joint(NamedTuple):
    """Kind, name and limits of a joint; the equations of motion use the kind only.

    Attributes
    ----------
    name : str
        Name in the file of the robot.
    sliding : bool
        Whether the joint is prismatic (slides along its axis) instead of revolute.
    lower, upper : float
        Limits of the coordinate [rad or m].
    effort : float
        Maximum torque or force of the drive [N·m or N].
    speed : float
        Maximum rate [rad/s or m/s].
    """

    name: str
    sliding: bool = False
    lower: float = -inf
    upper: float = inf
    effort: float = inf
    speed: float = inf

    @property
    def unit(self) -> str:
        """Unit of the coordinate."""
        return "m" if self.sliding else "rad"

    @property
    def effort_unit(self) -> str:
        """Unit of the torque or force of the drive."""
        return "N" if self.sliding else "N*m"

    def check(self, owner: str) -> None:
        """Raise if the limits are inconsistent.

        Parameters
        ----------
        owner : str
            Name of the robot, for the message.

        Raises
        ------
        ModelError
            If the lower limit exceeds the upper one, or another limit is negative.
        """
        if not (self.lower <= self.upper and self.effort >= 0.0 and self.speed >= 0.0):
            raise ModelError(
                f"{owner}: joint {self.name!r} has the limits {self.lower:g} to {self.upper:g} {self.unit}, "
                f"{self.effort:g} {self.effort_unit} and {self.speed:g} {self.unit}/s; the upper limit must "
                "not be below the lower one, and effort and speed must not be negative"
            )
