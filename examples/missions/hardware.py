"""
A base that fails
=================

Four robot bases push a truss, and one of them fails after 0.5 s. Thrusters, wheels, drives and sensors are those of
:doc:`the guide </missions>`.
"""

import numpy as np

from trussflow.blocks import Constant, Diagram, Step, simulate
from trussflow.models import Hardware, SpaceTruss

hardware = Hardware.flight()
plant = hardware.mounted(SpaceTruss.consistent())  # with the inertia of the drives
flight = Diagram("a base fails")
push = np.tile([0.0, 0.0, 1.03, 0.0, 0.0, 0.0], plant.robots)
command, health, actuators, sensors, truss = flight.add(
    command=Constant(np.concatenate([push, np.zeros(plant.joints)])),
    health=Step(0.5, initial_value=np.ones(4), final_value=[1.0, 1.0, 0.0, 1.0]),
    actuators=hardware.actuators(plant),
    sensors=hardware.sensors(plant, seed=1),
    truss=plant,
)
command.y >> actuators.command
health.y >> actuators.base_effectiveness
actuators.actuation >> truss.actuation
truss.task_position[6:] >> actuators.joint_angles
truss.rigid_speeds[6:] >> actuators.joint_rates
# The servo holds the joints at zero.
flight.ground(actuators.joint_reference, actuators.joint_reference_rate)
truss.coordinates >> sensors.coordinates
truss.speeds >> sensors.speeds

result = simulate(
    flight, 1.0, step=1e-3, log=[truss.base_force, sensors.task_position], log_step=0.02
)
impulse = result["truss.base_force"][:-1, :, 2].sum("time").values * 0.02
print("impulse of each base", impulse, "N*s")
print("measured position   ", result["sensors.task_position"][-1, :3].values, "m")
