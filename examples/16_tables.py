"""
Tables, noise and drift
=======================

A measured thrust curve over time, a lookup table of drag, and a sensor with white noise and slow drift.
"""

import matplotlib.pyplot as plt

from trussflow.blocks import Diagram, Drift, Gain, Integrator, Noise, Sum, Table, TimeTable, simulate

MASS = 2.0  # kg

sled = Diagram("sled")
thrust, drag, force, speed = sled.add(
    thrust=TimeTable([0.0, 0.2, 1.5, 2.0], [0.0, 40.0, 30.0, 0.0], unit="N"),
    drag=Table([0.0, 5.0, 10.0, 20.0, 40.0], [0.0, 1.0, 4.0, 14.0, 50.0], output_unit="N"),
    force=Sum("+-"),
    speed=Integrator(),
)
measured, noise, drift = sled.add(
    measured=Sum("+++"), noise=Noise(0.3, 0.01, seed=1), drift=Drift(0.2, 0.01, seed=2, correlation_time=5.0)
)
inertia = sled.add(inertia=Gain(1.0 / MASS))
thrust.y >> force.u1
drag.y >> force.u2
force >> inertia >> speed >> drag
speed.y >> measured.u1
noise.y >> measured.u2
drift.y >> measured.u3
sled.draw("sled.svg")

# %%
# Noise comes from seeds, so a run gives the same noise on every machine.

result = simulate(sled, 10.0, step=1e-3, log=[speed.y, measured.y], log_step=0.01)
plt.plot(result["time"], result["measured.y"], color="lightgrey", label="measured")
plt.plot(result["time"], result["speed.y"], label="true")
plt.gca().set(xlabel="time [s]", ylabel="speed [m/s]")
plt.legend()
plt.show()
