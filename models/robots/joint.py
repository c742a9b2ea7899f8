"""A joint of a robot: what kind it is, and what is known of it beside its place."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from trussflow.models.errors import ModelError


class Joint(NamedTuple):
    """Kind, name and limits of a joint; the equations of motion see the kind alone.

    Attributes
    ----------
    name : str
        As the drawing or file of the robot has it.
    sliding : bool
        Whether it slides along its axis (prismatic) instead of turning about it (revolute).
    lower, upper : float
        Ends of its way [rad or m].
    effort : float
        Largest torque or force of its drive [N·m or N].
    speed : float
        Largest rate [rad/s or m/s].
    """

    name: str
    sliding: bool = False
    lower: float = -inf
    upper: float = inf
    effort: float = inf
    speed: float = inf

    @property
    def unit(self) -> str:
        """Unit of its coordinate."""
        return "m" if self.sliding else "rad"

    @property
    def effort_unit(self) -> str:
        """Unit of what its drive makes."""
        return "N" if self.sliding else "N*m"

    def check(self, owner: str) -> None:
        """Raise unless its limits leave something.

        Parameters
        ----------
        owner : str
            What it belongs to, for the message.

        Raises
        ------
        ModelError
            If they do not.
        """
        if not (self.lower <= self.upper and self.effort >= 0.0 and self.speed >= 0.0):
            raise ModelError(
                f"{owner}: joint {self.name!r} goes from {self.lower:g} to {self.upper:g} {self.unit} with at"
                f" most {self.effort:g} {self.effort_unit} and {self.speed:g} {self.unit}/s; the upper limit"
                " must not be below the lower one, and the others must not be negative"
            )
