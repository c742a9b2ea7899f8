"""
A first loop
============

A mass on a spring under a PD controller: wired, drawn, simulated and plotted. Blocks are added to a diagram
by name; ``>>`` connects an output to an input and checks shapes and units. The result is an
``xarray.Dataset``: each signal by name, with unit and time.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import PD, Constant, Diagram, StateSpace, simulate

loop = Diagram("mass on a spring")
goal, rest, law, plant = loop.add(
    goal=Constant([1.0], unit="m"),
    rest=Constant([0.0], unit="m/s"),
    law=PD(20.0, 3.0, shape=1),
    plant=StateSpace(
        [[0.0, 1.0], [-4.0, -0.2]], [[0.0], [1.0]], np.eye(2), [[0.0], [0.0]]
    ),
)
goal >> law.reference_position
rest >> law.reference_velocity
plant.y[0:1] >> law.position
plant.y[1:2] >> law.velocity
law.force >> plant.u
loop.draw("first_loop.svg")

# %%
# RK4 with steps of 1 ms; the equations run as compiled C. A controller without integral action leaves a
# steady-state error against the spring.

result = simulate(loop, 10.0, step=1e-3)
print("final position", float(result["plant.y"][-1, 0]), "m")

figure, (upper, lower) = plt.subplots(2, 1, sharex=True, layout="constrained")
upper.plot(result["time"], result["plant.y"][:, 0])
upper.axhline(1.0, color="grey", linestyle="--")
upper.set(ylabel="position [m]")
lower.plot(result["time"], result["law.force"])
lower.set(xlabel="time [s]", ylabel="force [N]")
plt.show()
