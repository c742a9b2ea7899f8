"""What actuators there are: their limits, and what failures leave of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.parameter_files import ParameterTable
from trussflow.models.validation import check_choice, frozen_array

AXES = ("force x", "force y", "force z", "torque x", "torque y", "torque z")
"""What acts on a base, in its own axes."""

JOINTS = {"working": 1.0, "limp": 0.0, "locked": np.inf}
"""What may become of the joints of a robot, and their effectiveness."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ActuatorLimits:
    """The largest size of what each actuator does; the same in both directions.

    Attributes
    ----------
    force : array_like
        On a base [N]: one number, one for each axis, or a row for each base.
    base_torque : array_like
        On a base, likewise [N·m].
    joint_torque : array_like
        One number, or one for each joint of all robots [N·m].

    Raises
    ------
    ModelError
        If a limit is negative or not finite.
    """

    force: npt.ArrayLike
    base_torque: npt.ArrayLike
    joint_torque: npt.ArrayLike

    def __post_init__(self) -> None:
        for field in fields(self):
            given = np.asarray(getattr(self, field.name))
            value = frozen_array(f"actuator limits: {field.name}", given, given.shape)
            if np.any(value < 0.0):
                raise ModelError(f"actuator limits: {field.name} is {given.tolist()}; it must be at least 0")
            object.__setattr__(self, field.name, value)

    @classmethod
    def flight(cls) -> ActuatorLimits:
        """Return the limits of `Hardware.flight`, from ``parameters/hardware.toml``."""
        file = ParameterTable.shipped("hardware.toml")
        return cls(
            force=file.table("thrusters").scalar("maximum", "N"),
            base_torque=file.table("wheels").scalar("torque", "N*m"),
            joint_torque=file.table("joints").scalar("torque", "N*m"),
        )

    def of(self, dynamics: TrussDynamics) -> Vector:
        """Return the limit of each actuator input.

        Parameters
        ----------
        dynamics : TrussDynamics
            The robots.

        Returns
        -------
        Vector, shape (actuators,)
            [N, N·m].

        Raises
        ------
        ModelError
            If the shapes do not fit the robots.
        """
        robots = len(dynamics.arms)
        try:
            bases = [np.broadcast_to(each, (robots, 3)) for each in (self.force, self.base_torque)]
            joints = np.broadcast_to(self.joint_torque, dynamics.joints)
        except ValueError:
            raise ModelError(
                f"actuator limits do not fit {robots} robots and {dynamics.joints} joints: those of bases "
                f"must be of shape (), (3,) or ({robots}, 3), that of joints () or ({dynamics.joints},)"
            ) from None
        return np.concatenate([np.hstack(bases).ravel(), joints])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Failure:
    """What a failure leaves of each actuator.

    Attributes
    ----------
    name : str
        What has failed, for reports.
    effectiveness : Vector, shape (actuators,)
        What is left of each limit [1]: 1 as before, 0 dead. A joint with 0 swings freely: its acceleration
        is what it will be. A joint with infinity is held by its brake.
    """

    name: str
    effectiveness: Vector

    @classmethod
    def of(
        cls, dynamics: TrussDynamics, robot: int, *, axes: Sequence[str] = AXES, joints: str = "working"
    ) -> Failure:
        """Return the failure of a base, of some of its axes, or of a whole robot.

        Parameters
        ----------
        dynamics : TrussDynamics
            The robots.
        robot : int
            Which, from 1 on [-].
        axes : sequence of str
            Those of `AXES` that are dead; by default all, the whole base.
        joints : str
            ``"working"``, ``"limp"`` or ``"locked"``.

        Raises
        ------
        ModelError
            If there is no such robot or axis, or nothing that may become of joints is named.
        """
        check_choice("robot", robot, range(1, len(dynamics.arms) + 1))
        check_choice("state of joints", joints, JOINTS)
        left = np.ones(dynamics.actuators)
        for axis in axes:
            check_choice("axis of a base", axis, AXES)
            left[6 * (robot - 1) + AXES.index(axis)] = 0.0
        before = 6 * len(dynamics.arms) + sum(arm.joints for arm in dynamics.arms[: robot - 1])
        left[before : before + dynamics.arms[robot - 1].joints] = JOINTS[joints]
        part = "" if set(axes) == set(AXES) else f" ({', '.join(axes)})"
        name = f"base {robot}" if joints == "working" else f"robot {robot}, joints {joints}"
        return cls(name=f"{name}{part}", effectiveness=left)


def single_failures(dynamics: TrussDynamics) -> tuple[Failure, ...]:
    """Return no failure, then each single one: of a base, and of a whole robot with joints limp or locked.

    Parameters
    ----------
    dynamics : TrussDynamics
        The robots.
    """
    none = Failure(name="healthy", effectiveness=np.ones(dynamics.actuators))
    robots = range(1, len(dynamics.arms) + 1)
    return none, *(Failure.of(dynamics, i, joints=joints) for joints in JOINTS for i in robots)
