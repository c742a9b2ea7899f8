"""
A frame of your own
===================

Nodes, members, sections and materials in a file become a flexible body that robots carry. Its assumptions
are listed. ``Structure.from_matrices`` and ``structure_from_nastran`` read matrices of other programs.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.models import Frame, RobotArm, SpaceTruss, TrussDynamics, reduced_modes

structure = Frame.from_file("boom.toml").structure()
print(f"{structure.rigid_mass[0, 0]:.2f} kg, centre at {structure.centre.round(3)} m")
print("assumed:", *structure.assumptions, sep="\n- ")

# Grasps: the whole triangle at the root, and a corner at the tip. The body frame floats.
boom = reduced_modes(structure, 6, [{1, 2, 3}, 14], highest_frequency=100.0).damped(
    0.005
)
print(f"{boom.modes} shapes: the first at", boom.frequencies[:6].round(2), "Hz")

figure, axes = plt.subplots(
    2, 3, subplot_kw={"projection": "3d"}, figsize=(9, 6), layout="constrained"
)
for k, axis in enumerate(axes.flat):
    shape = boom.shapes[:, :, k]
    moved = boom.positions + 0.6 / abs(shape).max() * shape
    axis.scatter(*boom.positions.T, s=2, color="lightgrey")
    axis.scatter(*moved.T, s=6, c=np.linalg.norm(shape, axis=1), cmap="viridis")
    axis.scatter(*boom.grasp_positions.T, marker="^", color="tab:red")
    axis.set(title=f"{boom.frequencies[k]:.2f} Hz", xticks=[], yticks=[], zticks=[])
    axis.set_box_aspect(np.ptp(boom.positions, axis=0) + 1.0)

# %%
# Two robots with limp joints: the base of the one at the root pushes with 5 N.

plant = SpaceTruss(
    TrussDynamics(modes=boom, arms=(RobotArm.jaco(),) * 2, elastic_integrals=True)
)
push = np.zeros(plant.actuators)
push[1] = 5.0
flight = Diagram("boom")
force, body = flight.add(force=Constant(push), body=plant)
force.y >> body.actuation
result = simulate(
    flight,
    2.0,
    step=2e-3,
    log=[body.grasp_displacement, body.coordinates],
    log_step=0.01,
)
plt.figure()
plt.plot(
    result.time, 1e6 * result["body.grasp_displacement"][:, 1], label=["x", "y", "z"]
)
plt.gca().set(xlabel="time [s]", ylabel="elastic displacement of the tip [µm]")
plt.legend()
plt.show()
