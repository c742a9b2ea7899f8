"""
A PID loop, as a formula
========================

Arithmetic on ports, a function as a block, PID with limits, and conversions of results.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import (
    PID,
    Diagram,
    Integrator,
    Pulse,
    TransportDelay,
    as_block,
    plot,
    simulate,
    to_control,
    to_pandas,
)

# %%
# A pendulum with friction; torque in newton metres. Each operator adds a block; ``>>`` wires it.


@as_block
def weight(angle):
    """Return the torque of the weight."""
    return -3.0 * np.sin(angle)


loop = Diagram("pendulum")
wanted, pid, rate, angle = loop.add(
    wanted=Pulse(8.0, 0.5, high=1.0),
    pid=PID(12.0, 6.0, 4.0, lower=-5.0, upper=5.0),
    rate=Integrator(),
    angle=Integrator(),
)
late = loop.add("late", TransportDelay(0.02))
(late.y + weight(angle) - 0.4 * rate.y) >> rate >> angle
wanted >> pid.reference
angle >> pid.measurement
pid >> late

# %%
# States are logged by their path. A block added under a used name takes over the wires of the old one.
log = ["wanted.y", "angle.y", "pid.y", "pid.integral"]
good = simulate(loop, 16.0, step=0.01, log=log)
loop.add("pid", PID(12.0, 6.0, 4.0, lower=-5.0, upper=5.0, back_calculation=0.0))
wound_up = simulate(loop, 16.0, step=0.01, log=log)
for name, result in (("back-calculation", good), ("none", wound_up)):
    print(f"{name:17s} largest angle {result['angle.y'].values.max():.3f} rad")

# %%
plot(good, "wanted.y", "angle.y", "pid.y")
plt.show()

# %%
to_pandas(good).to_csv("pendulum.csv")
print(to_pandas(good).loc[4.0].round(3).to_string())
print(to_control(good, outputs=["angle.y"], inputs=["pid.y"]).output_labels)
