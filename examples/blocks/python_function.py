"""
Sampled control in Python code
==============================

A digital controller in plain Python, sampled at 50 Hz, on a continuous plant.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import (
    Constant,
    Diagram,
    Input,
    Output,
    PythonFunction,
    StateSpace,
    simulate,
)


def law(position, velocity, goal):
    """Return a saturated PD force; any Python code is allowed here."""
    return float(np.clip(20.0 * (goal - position) - 3.0 * velocity, -5.0, 5.0))


loop = Diagram("sampled control")
goal, controller, plant = loop.add(
    goal=Constant(1.0, unit="m"),
    controller=PythonFunction(
        law,
        sample_time=0.02,
        outputs={"force": Output(unit="N")},
        inputs={"position": Input(), "velocity": Input(), "goal": Input(unit="m")},
    ),
    plant=StateSpace(
        [[0.0, 1.0], [0.0, -0.2]], [[0.0], [1.0]], np.eye(2), [[0.0], [0.0]]
    ),
)
plant.y[0] >> controller.position
plant.y[1] >> controller.velocity
goal >> controller.goal
controller.force >> plant.u[0]

loop.draw("sampled_control.svg")

# %%
result = simulate(loop, 10.0, solver="DOP853", log_step=0.1)
print(result)
print("final position", result["plant.y"][-1, 0].values.round(4), "m")
plt.plot(result["time"], result["plant.y"][:, 0], label="position [m]")
plt.step(result["time"], result["controller.force"], where="post", label="force [N]")
plt.gca().set(xlabel="time [s]")
plt.legend()
plt.show()
