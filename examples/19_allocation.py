"""
Allocation within limits
========================

Five thrusters in a plane share a demand of force and torque. The weighted pseudo-inverse
exceeds the limits of the thrusters; bounded allocation keeps them and minimizes the error of the demand.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import BoundedAllocation, Constant, Diagram, Sine, WeightedAllocation, simulate

# Force along x and y [N] and torque [N*m] per newton of each thruster.
effect = np.array([[1.0, 1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, -1.0], [-0.5, 0.5, 0.0, 0.3, 0.3]])
free, bounded = WeightedAllocation(3, np.ones(5)), BoundedAllocation(3, 1e-3 * np.ones(5))
craft = Diagram("allocation")
craft.add(
    demand=Sine([1.5, 1.0, 0.4], frequency=[0.1, 0.2, 0.05]),
    effect=Constant(effect),
    spread=Constant(np.eye(3)),
    least=Constant(np.zeros(5)),
    most=Constant(np.ones(5)),
    free=free,
    bounded=bounded,
)
for law in (free, bounded):
    craft.demand.y >> law.demand
    craft.effect.y >> law.effectiveness
craft.spread.y >> bounded.spread
craft.least.y >> bounded.lower
craft.most.y >> bounded.upper
craft.draw("allocation.svg")

# %%
result = simulate(craft, 20.0, step=0.02)
figure, axes = plt.subplots(3, 1, sharex=True, layout="constrained", figsize=(6.4, 6.4))
axes[0].plot(result["time"], result["free.command"])
axes[0].set(ylabel="free [N]")
axes[1].plot(result["time"], result["bounded.command"])
axes[1].set(ylabel="bounded [N]")
axes[2].plot(result["time"], result["bounded.missed"], label=["x", "y", "torque"])
axes[2].set(xlabel="time [s]", ylabel="missed [N, N·m]")
axes[2].legend(loc="lower left")
plt.show()
