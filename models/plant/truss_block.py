"""Base of the blocks with the equations of a truss: sizes, units and labels of their ports."""

from __future__ import annotations

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Attribute
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.geometry.attitude import QUATERNION

MODAL_UNIT = "kg**0.5*m"
MODAL_RATE_UNIT = "kg**0.5*m/s"
MODAL_FORCE_UNIT = "kg**0.5*m/s**2"
AXES = ("x", "y", "z")
SPEEDS = Attribute("rigid_speed_labels")

# Units of ports, which depend on the robots; see `TrussBlock.set_dynamics`.
POSITION_UNITS = Attribute("position_units")
RATE_UNITS = Attribute("task_rate_units")
ACCELERATION_UNITS = Attribute("acceleration_units")
FORCE_UNITS = Attribute("force_units")
ACTUATOR_UNITS = Attribute("actuator_units")


class TrussBlock(Block):
    """Block with the dynamics of a truss, and with sizes, units and labels of its generalized coordinates.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    **parameters
        Parameter values of the derived block.
    """

    def __init__(self, dynamics: TrussDynamics, **parameters: object) -> None:
        self.set_dynamics(dynamics)
        super().__init__(**parameters)

    def set_dynamics(self, dynamics: TrussDynamics) -> None:
        """Set the dynamics, and the sizes, units and labels that ports and states refer to.

        Parameters
        ----------
        dynamics : TrussDynamics
            Truss and robots.
        """
        self.dynamics = dynamics
        self.nq, self.rigid_q = dynamics.coordinates, dynamics.rigid_coordinates
        self.n, self.rigid = dynamics.freedoms, dynamics.rigid_freedoms
        self.modes, self.robots = dynamics.modes.modes, len(dynamics.arms)
        self.joints, self.actuators = dynamics.joints, dynamics.actuators
        self.joint_units = tuple(joint.unit for joint in dynamics.joint_data)
        self.effort_units = tuple(joint.effort_unit for joint in dynamics.joint_data)
        self.task_units = ("m",) * 3 + ("rad",) * 3 + self.joint_units
        self.task_rate_units = tuple(f"{unit}/s" for unit in self.task_units)
        self.acceleration_units = tuple(f"{unit}/s**2" for unit in self.task_units)
        wrench, rates = ("N",) * 3 + ("N*m",) * 3, self.task_rate_units
        self.force_units = wrench + self.effort_units
        self.actuator_units = wrench * self.robots + self.effort_units
        self.actuator_rate_units = rates[:6] * self.robots + rates[6:]
        self.position_units = ("m",) * 3 + dynamics.attitude.units + self.joint_units
        self.coordinate_units = self.position_units + (MODAL_UNIT,) * self.modes
        self.speed_units = rates + (MODAL_RATE_UNIT,) * self.modes
        robots = tuple(range(1, self.robots + 1))
        modes = tuple(range(1, self.modes + 1))
        joints = tuple(
            f"theta_{i}_{j + 1}"
            for i, arm in zip(robots, dynamics.arms, strict=True)
            for j in range(arm.joints)
        )
        self.joint_labels, self.mode_labels = {"joint": joints}, {"mode": modes}
        self.base_labels = {"robot": robots, "axis": AXES}
        kind, modal_names = dynamics.attitude, tuple(f"tau_{k}" for k in modes)
        self.task_labels = {"axis": AXES, "angle": kind.task_labels, "joint": joints}
        attitude = "quaternion" if kind == QUATERNION else "angle"
        self.position_labels = {"axis": AXES, attitude: kind.labels, "joint": joints}
        self.coordinate_labels = {**self.position_labels, "mode": modal_names}
        rigid = (*AXES, *QUATERNION.task_labels, *joints)
        self.rigid_speed_labels = {"speed": rigid}
        self.speed_labels = {"speed": rigid + modal_names}
