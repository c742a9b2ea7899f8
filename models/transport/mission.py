"""Transport missions: displacement, duration and controller gains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.layered_file import LayeredFile
from trussflow.models.parameter_files import shipped_file
from trussflow.models.validation import check_choice, check_number

CASES = (1, 2)

FASTEST = "fastest"
"""Value of a duration in a file for the fastest feasible path."""


def case_file(case: int) -> Path:
    """Return the mission file of a case of the paper.

    Parameters
    ----------
    case : int
        Case 1 or 2 [-].

    Raises
    ------
    ModelError
        If the case does not exist.
    """
    check_choice("transport case", case, CASES)
    return shipped_file(f"case_{case}.toml")


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """Rest-to-rest transport of the truss, with controller gains.

    Attributes
    ----------
    position : Vector, shape (3,)
        Displacement of the truss frame, inertial axes [m].
    attitude : Vector, shape (3,)
        Change of the 3-1-2 Euler angles, or, with a quaternion, axis in the truss frame times angle [rad].
    duration : float
        Duration of the motion, after which the truss is held [s]. Infinite before the fastest duration of a
        file is computed.
    observer_bandwidth : float
        L [1/s].
    reaching_gain : float
        sigma [1/s].
    rate_gain, error_gain, exponent, switching_gain, boundary_layer : float
        gamma [1/s], mu [1/s^2], beta [1], eta [unit/s^2], iota [unit/s], unit being m or rad.
    weights : Vector, shape (6,)
        Allocation weights of each base's three forces and three torques [-].
    joint_weight : float
        Allocation weight of each joint torque [-].
    proportional_gain, derivative_gain : float
        k_p [N/m, N·m/rad] and k_d [N·s/m, N·m·s/rad] of the PD law.
    surface_slope, conventional_switching_gain : float
        Slope [1/s] and switching gain [unit/s^2] of conventional sliding mode.
    step : float
        Step of the fixed-step solver [s].
    """

    position: Vector
    attitude: Vector
    duration: float
    observer_bandwidth: float
    reaching_gain: float
    rate_gain: float
    error_gain: float
    exponent: float
    switching_gain: float
    boundary_layer: float
    weights: Vector
    joint_weight: float
    proportional_gain: float
    derivative_gain: float
    surface_slope: float
    conventional_switching_gain: float
    step: float

    @classmethod
    def of_case(cls, case: int) -> Mission:
        """Return a mission of the paper, from ``parameters/case_1.toml`` or ``case_2.toml``.

        Parameters
        ----------
        case : int
            Case 1 or 2 [-].

        Raises
        ------
        ModelError
            If the case does not exist.
        """
        return cls.of(LayeredFile.read(case_file(case)))

    @classmethod
    def of(
        cls, file: LayeredFile, used: Callable[[str, str], bool] = lambda *_: True
    ) -> Mission:
        """Return the mission of a file.

        Parameters
        ----------
        file : LayeredFile
            File as in `trussflow.models.transport.mission_file`.
        used : callable
            Function of table and key that returns whether the mission uses the key. If unused, observer
            bandwidth and reaching gain are optional, by default NaN.

        Raises
        ------
        ModelError
            If a value is missing or has the wrong unit or shape, or a time is not positive.
        """
        path, controller, sliding = (
            file.table(name) for name in ("path", "controller", "sliding_mode")
        )
        allocation, pd = file.table("allocation"), file.table("proportional_derivative")
        conventional = file.table("conventional_sliding_mode")
        gains = ("observer_bandwidth", "reaching_gain")
        needed = [key for key in gains if key in controller or used("controller", key)]
        forces, torques = (
            allocation.array(f"{k}_weights", "1", (3,)) for k in ("force", "torque")
        )
        found = cls(
            position=path.array("position", "m", (3,)),
            attitude=path.array("attitude", "rad", (3,)),
            weights=np.concatenate([forces, torques]),
            surface_slope=conventional.scalar("surface_slope", "1/s"),
            conventional_switching_gain=conventional.scalar("switching_gain", "m/s^2"),
            duration=np.inf
            if path.find("duration") == FASTEST
            else path.scalar("duration", "s"),
            **dict.fromkeys(gains, np.nan)
            | controller.scalars(**dict.fromkeys(needed, "1/s")),
            **sliding.scalars(
                rate_gain="1/s",
                error_gain="1/s^2",
                exponent="1",
                switching_gain="m/s^2",
                boundary_layer="m/s",
            ),
            **allocation.scalars(joint_weight="1"),
            **pd.scalars(proportional_gain="N/m", derivative_gain="N*s/m"),
            **file.table("simulation").scalars(step="s"),
        )
        if found.duration != np.inf:
            check_number("path", duration=found.duration)
        return found

    def displacement(self, rigid: int) -> Vector:
        """Return the displacement of all task coordinates, zero for joints.

        Parameters
        ----------
        rigid : int
            Number of task coordinates [-].
        """
        return np.concatenate([self.position, self.attitude, np.zeros(rigid - 6)])

    def actuator_weights(self, robots: int, joints: int) -> Vector:
        """Return the diagonal of W (section 4.2).

        Parameters
        ----------
        robots, joints : int
            Number of robots and of all joints together [-].
        """
        return np.concatenate(
            [np.tile(self.weights, robots), np.full(joints, self.joint_weight)]
        )
