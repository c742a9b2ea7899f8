"""
Hardware, and a base that fails
===============================

A tug with pulsed thrusters and noisy sensors holds its position. Then robot bases push a truss, and one of
them fails.
"""

import numpy as np

from trussflow.blocks import (
    PD,
    Constant,
    Diagram,
    Gain,
    Integrator,
    Step,
    sampled_delay,
    simulate,
)
from trussflow.models import Hardware, Measurement, SpaceTruss, ThrusterSet

mass = np.array([120.0] * 3 + [20.0] * 3)  # kg, and kg*m^2 for small turns
units = ("m",) * 3 + ("rad",) * 3

tug = Diagram("tug")
body, rates, pose, rate, law, computer, thrusters, place = tug.add(
    body=Gain(1.0 / mass),
    rates=Integrator(shape=6),
    pose=Integrator([0.1, -0.05, 0.0, 0.0, 0.02, 0.0]),
    rate=Measurement(sample_time=0.1, noise=1e-3).sensor(6, seed=2),
    law=PD(0.04 * mass, 0.4 * mass),
    computer=sampled_delay(0.1, delay=0.1),
    thrusters=ThrusterSet.pairs(
        0.5,
        maximum=1.0,
        period=0.2,
        tick=0.005,
        minimum_impulse=0.02,
        specific_impulse=70.0,
    ),
    place=Measurement(sample_time=0.1, noise=1e-3, quantum=1e-4).sensor(6, seed=1),
)
goal = tug.add(goal=Constant(np.zeros(6)))
goal.y >> law.reference_position
goal.y >> law.reference_velocity
thrusters.wrench >> body >> rates >> pose >> place
rates.y >> rate
place.y >> law.position
rate.y >> law.velocity
law.force >> computer >> thrusters.demand

tug.draw("tug.svg")
result = simulate(
    tug, 60.0, step=5e-3, log=[pose.y, thrusters.propellant], log_step=0.1
)
print("place after a minute ", result["pose.y"][-1].values.round(4), "m, rad")
print("propellant           ", float(result["thrusters.propellant"][-1]) * 1e3, "g")

# 20 ms hold, 20 ms delay, 0.1 N steps, ...
plant, hardware = (SpaceTruss.consistent(), Hardware.flight())
flight = Diagram("a base dies")
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
truss.coordinates >> sensors.coordinates
truss.speeds >> sensors.speeds

result = simulate(
    flight, 1.0, step=1e-3, log=[truss.base_force, sensors.task_position], log_step=0.02
)
print(
    "impulse of each base ",
    result["truss.base_force"][:-1, :, 2].sum("time").values * 0.02,
    "N*s",
)
print("root as it is seen   ", result["sensors.task_position"][-1, :3].values, "m")
