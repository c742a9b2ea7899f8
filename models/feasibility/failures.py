"""Actuator limits and actuator failures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.validation import check_choice, check_number, frozen_array

AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")
"""Actuator axes of a base, in base axes."""

JOINTS = {"working": 1.0, "limp": 0.0, "locked": np.inf}
"""Health of joint drives by state: healthy, free (limp), held by brakes (locked)."""


def actuator_limits(
    dynamics: TrussDynamics,
    *,
    force: npt.ArrayLike,
    base_torque: npt.ArrayLike,
    joint_torque: npt.ArrayLike,
) -> Vector:
    """Return the symmetric limit of each actuator input, as `Hardware.limits` does [N, N·m].

    Parameters
    ----------
    dynamics : TrussDynamics
        Dynamics with the robots.
    force : array_like
        Force limits of bases: one number, one per axis, or one row per base [N].
    base_torque : array_like
        Torque limits of bases: one number, one per axis, or one row per base [N·m].
    joint_torque : array_like
        Torque limits of joints: one number, or one per joint of all robots [N·m].

    Returns
    -------
    Vector, shape (actuators,)
        Limits [N, N·m].

    Raises
    ------
    ModelError
        If a limit is negative or not finite, or the shapes do not fit the robots.
    """
    least = {
        "force": np.min(force),
        "base_torque": np.min(base_torque),
        "joint_torque": np.min(joint_torque),
    }
    check_number("actuator limits", zero=True, **least)
    robots = len(dynamics.arms)
    try:
        bases = [np.broadcast_to(each, (robots, 3)) for each in (force, base_torque)]
        joints = np.broadcast_to(joint_torque, dynamics.joints)
    except ValueError:
        raise ModelError(
            f"actuator limits do not fit {robots} robots and {dynamics.joints} joints: those of bases "
            f"must be of shape (), (3,) or ({robots}, 3), that of joints () or ({dynamics.joints},)"
        ) from None
    limits = np.concatenate([np.hstack(bases).ravel(), joints])
    return frozen_array("actuator limits", limits, (dynamics.actuators,))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Failure:
    """Failure of actuators.

    Attributes
    ----------
    name : str
        Name in reports.
    effectiveness : Vector, shape (actuators,)
        Health, the factor of each limit [1]: 1 healthy, 0 failed. A joint with 0 is free. A joint with
        infinity is locked by its brake.
    """

    name: str
    effectiveness: Vector

    @classmethod
    def of(
        cls,
        dynamics: TrussDynamics,
        robot: int,
        *,
        axes: Sequence[str] = AXES,
        joints: str = "working",
    ) -> Failure:
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
        left = np.ones(dynamics.actuators)
        for axis in axes:
            check_choice("axis of a base", axis, AXES)
            left[6 * (robot - 1) + AXES.index(axis)] = 0.0
        before = 6 * len(dynamics.arms) + sum(
            arm.joints for arm in dynamics.arms[: robot - 1]
        )
        left[before : before + dynamics.arms[robot - 1].joints] = JOINTS[joints]
        part = "" if set(axes) == set(AXES) else f" ({', '.join(axes)})"
        name = (
            f"base {robot}"
            if joints == "working"
            else f"robot {robot}, joints {joints}"
        )
        return cls(name=f"{name}{part}", effectiveness=left)


def single_failures(dynamics: TrussDynamics) -> tuple[Failure, ...]:
    """Return the healthy state, then each failure of a base, and of a robot with limp or locked joints.

    Parameters
    ----------
    dynamics : TrussDynamics
        Dynamics with the robots.
    """
    none = Failure(name="healthy", effectiveness=np.ones(dynamics.actuators))
    robots = range(1, len(dynamics.arms) + 1)
    return none, *(
        Failure.of(dynamics, i, joints=joints) for joints in JOINTS for i in robots
    )
