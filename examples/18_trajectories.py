"""
Trajectories
============

Three trajectories over two metres: a quintic with continuous acceleration, the fastest one within limits of
velocity and acceleration (trapezoid), and a spline through waypoints.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import Diagram, Quintic, Trapezoid, Waypoints, simulate

ways = Diagram("ways")
ways.add(
    quintic=Quintic(2.0, duration=4.0, unit="m"),
    trapezoid=Trapezoid(2.0, max_velocity=0.8, max_acceleration=1.0, unit="m"),
    waypoints=Waypoints([0.0, 1.0, 2.5, 4.0], [0.0, 1.2, 1.0, 2.0], unit="m"),
)
result = simulate(ways, 5.0, step=1e-2)
figure, axes = plt.subplots(3, 1, sharex=True, layout="constrained", figsize=(6.4, 6.4))
for axis, signal in zip(axes, ("position", "velocity", "acceleration"), strict=True):
    for name in ways.blocks:
        axis.plot(result["time"], result[f"{name}.{signal}"], label=name)
    axis.set(ylabel=f"{signal} [{result[f'quintic.{signal}'].attrs['units'].replace('**2', '²')}]")
axes[0].legend()
axes[-1].set(xlabel="time [s]")
plt.show()
