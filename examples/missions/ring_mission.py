"""
A ring and eight robots
=======================

``ring.toml`` is a ring of eight metres made of nodes, members, sections and masses. Around it four tugs
that slide on a rail and tilt alternate with four modules without joints, all facing outward (``rotation``
in ``ring_mission.toml``). Together they move and turn the ring. ``trussflow fly ring_mission.toml`` does
the same.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models.transport import MissionFile, check_run
from trussflow.models.viewer import replay

flown = MissionFile.read("ring_mission.toml")
truss = flown.truss
modes, arms = truss.dynamics.modes, truss.dynamics.arms
print(
    f"{modes.masses.sum():.1f} kg, {modes.modes} modes from {modes.frequencies[0]:.2f} Hz on"
)
print(
    ", ".join(f"{arm.name} ({arm.joints} joints, {arm.mass:g} kg)" for arm in arms[:2]),
    "and so on",
)

# %%
# A linear program over 48 forces and torques of bases and 8 of joints gives the least duration.

least, taken = flown.least_duration(), flown.mission.duration
print(
    f"the path takes {taken:g} s, the actuators need {least:.1f} s: they use {(least / taken) ** 2:.0%}"
)

# %%
# Run it, with sensors, delay and thrust quantization:

result = check_run(
    flown.simulator(flown.diagram()).run(flown.duration, progress=False), truss
)
position = 1e6 * np.linalg.norm(result["position_error"], axis=1)
attitude = 1e6 * np.linalg.norm(result["attitude_error"], axis=1)
joints = 1e6 * abs(result["joint_error"]).max("joint")
print(
    f"at most {position.max():.0f} µm, {attitude.max():.0f} µrad, joints {float(joints.max()):.0f} µm or µrad"
)

figure, (above, below) = plt.subplots(2, sharex=True, layout="constrained")
above.plot(result["time"], position, label="position [µm]")
above.plot(result["time"], attitude, label="attitude [µrad]")
above.set(ylabel="error")
above.legend()
for robot in (1, 2):
    force = np.linalg.norm(result["base_force"].sel(robot=robot), axis=1)
    below.plot(result["time"], force, label=arms[robot - 1].name)
below.set(xlabel="time [s]", ylabel="thrust [N]")
below.legend()
plt.show()

# %%
# In motion:

replay(result, truss, "ring.html", rods=flown.rods, title=flown.title)
