"""Joint of a robot: kind, name, limits, and inertia of its drive."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from trussflow.models.errors import ModelError


class Joint(NamedTuple):
    """Kind, name and limits of a joint; the equations of motion use the kind and the inertia only.

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
    inertia : float
        Inertia of the drive, reflected to the joint [kg·m² or kg]: the square of the gear ratio times the
        inertia of the rotor.
    """

    name: str
    sliding: bool = False
    lower: float = -inf
    upper: float = inf
    effort: float = inf
    speed: float = inf
    inertia: float = 0.0

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
            If the lower limit exceeds the upper one, another limit is negative, or the inertia is
            negative or not finite.
        """
        if not 0.0 <= self.inertia < inf:
            raise ModelError(
                f"{owner}: the drive of joint {self.name!r} has the inertia {self.inertia:g}; it must be "
                "finite and not negative"
            )
        if not (self.lower <= self.upper and self.effort >= 0.0 and self.speed >= 0.0):
            raise ModelError(
                f"{owner}: joint {self.name!r} has the limits {self.lower:g} to {self.upper:g} {self.unit}, "
                f"{self.effort:g} {self.effort_unit} and {self.speed:g} {self.unit}/s; the upper limit must "
                "not be below the lower one, and effort and speed must not be negative"
            )
