"""
A mission of your own: a boom, two arms
=======================================

``boom_mission.toml`` defines the mission: a frame of nodes and members (``boom.toml``), two different arms
from URDF (``walker.urdf`` with four joints, ``slider.urdf``, which slides and tilts), quantized thrusters,
noisy sensors, and the mean-axes controller. ``trussflow fly boom_mission.toml`` does the same and writes a
page.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models.transport import MissionFile, tidy

flown = MissionFile.read("boom_mission.toml")
modes = flown.truss.dynamics.modes
print(f"{modes.masses.sum():.1f} kg, {modes.modes} shapes, the first at {modes.frequencies[0]:.1f} Hz")
for arm in flown.truss.dynamics.arms:
    print(f"{arm.name}: {arm.mass:.1f} kg; {', '.join(joint.name for joint in arm.joint_data)}")
print(
    f"the actuators need at least {flown.least_duration():.1f} s, the path takes {flown.mission.duration:g} s"
)

# %%
# Run it. Measurements of root and joints have noise of 1e-4, thrust has a quantum of 0.1 N.

result = tidy(flown.simulator(flown.diagram()).run(flown.duration, progress=False), flown.truss)
error = 1e6 * np.linalg.norm(result["position_error"], axis=1)
print(f"the root is never farther than {error.max():.0f} µm from its path")

figure, axes = plt.subplots(2, sharex=True)
axes[0].plot(result["time"], result["position"][:, 2])
axes[0].set(ylabel="height [m]")
axes[1].plot(result["time"], error)
axes[1].set(xlabel="time [s]", ylabel="error [µm]")

# %%
# At the start, and after half a metre:

axis = plt.figure(figsize=(8, 4)).add_subplot(projection="3d")
for height, colour in ((0.0, "lightgrey"), (0.5, "tab:blue")):
    for ends in modes.positions[flown.rods] + [0.0, 0.0, height]:
        axis.plot(*ends.T, color=colour, clip_on=False)
axis.scatter(*modes.grasp_positions.T, marker="^", color="tab:red", s=60, depthshade=False)
axis.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", yticks=[-0.5, 0.5], zticks=[0, 1])
axis.set(xlim=(-0.5, 6.5), ylim=(-1.0, 1.0), zlim=(-0.5, 1.5), xticks=[0, 2, 4, 6])
axis.set_box_aspect((7.0, 2.0, 2.0), zoom=1.5)
plt.show()
