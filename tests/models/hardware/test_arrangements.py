"""Hardware and loop of robots of any kinds: units of the joints, robots without joints, no robots."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.models import (
    Hardware,
    Joint,
    JointDrives,
    MeanAxesDesign,
    MeanAxesLaw,
    Measurement,
    ModelError,
    SpaceTruss,
    TrussDynamics,
    TunableTruss,
)

System = Callable[..., TrussDynamics]
Arrangement = tuple[tuple[int | str, ...], int]


def wired(truss):
    """Return a truss with actuators and sensors; accelerometers too."""
    hardware = replace(Hardware.flight(), accelerometer=Measurement(sample_time=0.02, noise=0.0))
    diagram = Diagram("wired")
    plant, actuators, sensors, nothing = diagram.add(
        truss=truss,
        actuators=hardware.actuators(truss),
        sensors=hardware.sensors(truss, seed=1),
        nothing=Constant(np.zeros(truss.actuators)),
    )
    nothing.y >> actuators.command
    actuators.actuation >> plant.actuation
    plant.coordinates >> sensors.coordinates
    plant.speeds >> sensors.speeds
    return diagram


def test_any_arrangement_carries_hardware(random_system, arrangement):
    """Left alone, each keeps its place: what is wired has the units and sizes that it must have."""
    truss = SpaceTruss(random_system(*arrangement, elastic_integrals=True))
    if not truss.robots:
        with pytest.raises(ModelError, match="has no robots, which carry the hardware"):
            wired(truss)
        return
    assert Hardware.flight().limits(truss).shape == (truss.actuators,)
    result = simulate(wired(truss), 0.04, step=0.02, log=["truss.coordinates"], backend="interpreted")
    assert np.array_equal(result["truss.coordinates"][-1], truss.dynamics.rest)


def test_drives_have_the_units_of_their_joints():
    drives = JointDrives((Joint("a"), Joint("b", sliding=True)), torque=1.0)
    assert drives.command.unit == ("N*m", "N")
    assert drives.rate.unit == ("rad/s", "m/s")


def test_a_truss_without_robots_flies_and_is_not_controlled(random_system):
    system = random_system((), 3, elastic_integrals=True)
    alone = TunableTruss(system)
    diagram = Diagram("alone")
    diagram.add(truss=alone)
    start = np.linspace(0.1, 0.9, alone.n)
    log = ["truss.energy"]
    energy = simulate(diagram, 1.0, step=0.01, initial={"truss.v": start}, log=log)["truss.energy"].values
    assert np.ptp(energy) < 1e-9 * energy[0]
    with pytest.raises(ModelError, match="a truss without robots has nothing to be controlled by"):
        MeanAxesLaw(system, MeanAxesDesign.shipped())
