r"""
Sweeps: compiled once, run often
================================

Parameters are inputs of the compiled code: other values need no compilation. A ``Simulator`` is made once
and run for each.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Constant, Diagram, Gain, Integrator, Simulator, Sum

loop = Diagram("second order")
goal, error, stiffness, damping, speed, place = loop.add(
    goal=Constant(1.0),
    error=Sum("+--"),
    stiffness=Gain(1.0),
    damping=Gain(0.2),
    speed=Integrator(),
    place=Integrator(),
)
goal.y >> error.u1
place.y >> stiffness >> error.u2
speed.y >> damping >> error.u3
error >> speed >> place
loop.draw("second_order.svg")

# %%
# A hundred dampings, from hardly any to critical and beyond:

simulator = Simulator(loop, step=1e-2, log=[place.y])
dampings = np.linspace(0.05, 3.0, 100)
begun = time.perf_counter()
overshoots = []
for number, value in enumerate(dampings):
    result = simulator.run(20.0, parameters={"damping.gain": value})
    overshoots.append(float(result["place.y"].max()) - 1.0)
    if number % 12 == 0:
        plt.plot(result["time"], result["place.y"], label=f"{value:.2f}")
print(f"{len(dampings)} runs in {time.perf_counter() - begun:.2f} s")
plt.gca().set(xlabel="time [s]", ylabel="position")
plt.legend(title="damping")
plt.show()

# %%
# The overshoot of a second-order system is known: :math:`e^{-\pi \zeta / \sqrt{1 - \zeta^2}}`.

zeta = dampings[dampings < 1.8] / 2
exact = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
worst = abs(np.array(overshoots[: zeta.size]) - exact).max()
print(f"largest difference from the exact overshoot: {worst:.1e}")
