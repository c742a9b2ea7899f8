"""Hardware and loop of robots of any kinds: units of the joints, robots without joints, no robots."""

import numpy as np
import pytest
from systems import assert_near

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.models import (
    Hardware,
    Joint,
    JointDrives,
    MeanAxesDesign,
    MeanAxesLaw,
    ModelError,
    SpaceTruss,
)


def wired(truss):
    """Return a truss with actuators and sensors."""
    hardware = Hardware.flight()
    diagram = Diagram("wired")
    plant, actuators, sensors, nothing = diagram.add(
        truss=truss,
        actuators=hardware.actuators(truss),
        sensors=hardware.sensors(truss, seed=1),
        nothing=Constant(np.zeros(truss.actuators)),
    )
    nothing.y >> actuators.command
    if plant.joints:
        plant.task_position[6:] >> actuators.joint_angles
        plant.rigid_speeds[6:] >> actuators.joint_rates
        plant.task_position[6:] >> actuators.joint_reference
        diagram.ground(actuators.joint_reference_rate)
    actuators.actuation >> plant.actuation
    plant.coordinates >> sensors.coordinates
    plant.speeds >> sensors.speeds
    return diagram


def test_any_arrangement_carries_hardware(random_system, arrangement):
    """Without commands each keeps its place: all connected ports have equal units and sizes.

    The noise of the servo's sensors moves the joints a little.
    """
    truss = SpaceTruss(random_system(*arrangement, elastic_integrals=True))
    if not truss.robots:
        with pytest.raises(
            ModelError, match="has no robots, so there are no actuators"
        ):
            wired(truss)
        return
    assert Hardware.flight().limits(truss).shape == (truss.actuators,)
    result = simulate(wired(truss), 0.04, step=1e-3, log=["truss.coordinates"])
    assert_near(result["truss.coordinates"][-1], truss.dynamics.rest, 1e-6)


def test_drives_have_the_units_of_their_joints():
    drives = JointDrives((Joint("a"), Joint("b", sliding=True)), torque=1.0)
    assert drives.command.unit == ("N*m", "N")
    assert drives.rate.unit == ("rad/s", "m/s")


def test_a_truss_without_robots_is_not_controlled(random_system):
    with pytest.raises(ModelError, match="a truss without robots has no actuators"):
        MeanAxesLaw(
            random_system((), 3, elastic_integrals=True), MeanAxesDesign.shipped()
        )
