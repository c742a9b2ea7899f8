"""
Designs from python-control, and back
=====================================

A regulator designed with python-control's ``lqr`` becomes a gain in a diagram. ``from_control`` makes a
block from a python-control system, ``linearize`` a python-control system from a diagram.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Diagram, MatrixGain, from_control, linearize, simulate

# A cart of 1 kg with an inverted pendulum of 0.2 kg, 0.5 m: force to position, angle and their rates.
cart = control.ss(
    [[0, 0, 1, 0], [0, 0, 0, 1], [0, -1.962, 0, 0], [0, 23.544, 0, 0]],
    [[0], [0], [1.0], [-2.0]],
    np.eye(4),
    np.zeros((4, 1)),
)
gain, _, _ = control.lqr(cart, np.diag([10.0, 10.0, 1.0, 1.0]), [[0.1]])

loop = Diagram("upright")
plant, law = loop.add(
    plant=from_control(cart, initial_value=[0.0, 0.1, 0.0, 0.0]), law=MatrixGain(-gain)
)
plant.y >> law.u
law.y >> plant.u
loop.draw("regulator.svg")
result = simulate(loop, 5.0, step=1e-3)
plt.plot(result["time"], result["plant.y"][:, :2], label=["place [m]", "angle [rad]"])
plt.gca().set(xlabel="time [s]")
plt.legend()
plt.show()

# %%
# The poles of the linearized diagram are those of the design.

closed = linearize(loop, [plant.u], [plant.y])
wanted = np.sort_complex(np.linalg.eigvals(cart.A - cart.B @ gain))
print("poles        ", wanted.round(3))
print("of the loop  ", np.sort_complex(closed.poles()).round(3))
