"""Actuator failures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.validation import check_choice

AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")
"""Actuator axes of a base, in base axes."""

JOINTS = {"working": 1.0, "limp": 0.0, "locked": np.inf}
"""Health of joint drives by state: healthy, free (limp), held by brakes (locked)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActuatorFailure:
    """Failure of actuators, such as those of a base, or of a robot with its joints.

    Attributes
    ----------
    name : str
        Name in reports.
    health : Vector, shape (actuators,)
        Health, the factor of each limit [1]: 1 healthy, 0 failed. A joint with 0 is free. A joint with
        infinity is locked by its brake.
    """

    name: str
    health: Vector

    @classmethod
    def of(
        cls,
        dynamics: TrussDynamics,
        robot: int,
        *,
        axes: Sequence[str] = AXES,
        joints: str = "working",
    ) -> ActuatorFailure:
        """Return the failure of a base, of some of its axes, or of a whole robot.

        Parameters
        ----------
        dynamics : TrussDynamics
            Dynamics with the robots.
        robot : int
            Number of the robot, from 1 [-].
        axes : sequence of str
            Failed axes, from `AXES`; by default all.
        joints : str
            ``"working"``, ``"limp"`` or ``"locked"``.

        Raises
        ------
        ModelError
            If robot, axis or state of the joints is unknown.
        """
        check_choice("robot", robot, range(1, len(dynamics.arms) + 1))
        check_choice("state of joints", joints, JOINTS)
        health = np.ones(dynamics.actuators)
        for axis in axes:
            check_choice("axis of a base", axis, AXES)
            health[6 * (robot - 1) + AXES.index(axis)] = 0.0
        before = 6 * len(dynamics.arms) + sum(
            arm.joints for arm in dynamics.arms[: robot - 1]
        )
        health[before : before + dynamics.arms[robot - 1].joints] = JOINTS[joints]
        part = "" if set(axes) == set(AXES) else f" ({', '.join(axes)})"
        name = (
            f"base {robot}"
            if joints == "working"
            else f"robot {robot}, joints {joints}"
        )
        return cls(name=f"{name}{part}", health=health)


def single_failures(dynamics: TrussDynamics) -> tuple[ActuatorFailure, ...]:
    """Return the healthy state, then each failure of a base, and of a robot with limp or locked joints.

    Parameters
    ----------
    dynamics : TrussDynamics
        Dynamics with the robots.
    """
    none = ActuatorFailure(name="healthy", health=np.ones(dynamics.actuators))
    robots = range(1, len(dynamics.arms) + 1)
    return none, *(
        ActuatorFailure.of(dynamics, i, joints=joints)
        for joints in JOINTS
        for i in robots
    )
