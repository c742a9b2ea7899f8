"""
Bode plot and margins of a motor's speed loop
=============================================

A DC motor with inductance and inertia under a PI controller. ``loop_transfer`` opens the closed loop at
a wire and linearizes it exactly; the result is a python-control model.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import (
    Diagram,
    StateSpace,
    Step,
    Sum,
    delay_margin,
    loop_transfer,
    simulate,
)

resistance, inductance, torque_constant, inertia, friction = (
    1.0,
    5e-3,
    0.05,
    2e-4,
    1e-4,
)  # ohm, H, N*m/A, kg*m^2
motor = StateSpace(
    [
        [-resistance / inductance, -torque_constant / inductance],
        [torque_constant / inertia, -friction / inertia],
    ],
    [[1 / inductance], [0.0]],
    [[0.0, 1.0]],
    [[0.0]],
    input_unit="V",
    output_unit="rad/s",
)
loop = Diagram("speed loop")
goal, error, law, plant = loop.add(
    goal=Step(0.1, initial_value=[0.0], final_value=[100.0], unit="rad/s"),
    error=Sum("+-"),
    # 0.1 + 2/s
    law=StateSpace(
        [[0.0]], [[1.0]], [[2.0]], [[0.1]], input_unit="rad/s", output_unit="V"
    ),
    plant=motor,
)
goal.y >> error.u1
error >> law >> plant
plant.y >> error.u2
loop.draw("speed_loop.svg")

# %%
# The loop gain, opened at the voltage:

opened = loop_transfer(loop, plant.u)
omega = np.geomspace(1.0, 1e4, 500)  # rad/s
control.bode_plot(opened, omega, display_margins=True)
plt.show()
gain, phase, _, at_gain = control.margin(opened)
delay, at = delay_margin(opened)
print(
    f"phase margin {phase:.1f} deg at {at_gain:.1f} rad/s; delay margin {1e3 * delay:.2f} ms"
)

# %%
# The closed loop:

result = simulate(loop, 1.0, step=1e-4, log=[plant.y, law.y], log_step=1e-3)
plt.plot(result["time"], result["plant.y"])
plt.gca().set(xlabel="time [s]", ylabel="speed [rad/s]")
plt.show()
