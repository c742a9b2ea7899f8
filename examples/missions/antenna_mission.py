"""
An antenna from Nastran, three modules without arms
===================================================

``antenna.bdf`` is a mesh reflector on six ribs, in tonnes, millimetres and cylindrical axes. The line
``OUTPUT4 KGG,MGG`` makes the solver write mass and stiffness; ``antenna.op4`` was written by MYSTRAN, an
open solver for Nastran decks. In ``antenna_mission.toml`` three modules with thrusters and wheels are
bolted to the middle ring, under mean-axes control with noisy sensors. ``trussflow fly
antenna_mission.toml`` does the same. Reading Nastran files needs ``pip install trussflow[nastran]``.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models.transport import MissionFile, check_run
from trussflow.models.viewer import replay

flown = MissionFile.read("antenna_mission.toml")
truss = flown.truss
modes = truss.dynamics.modes
print(
    f"{modes.masses.sum():.2f} kg and {truss.robots} modules of {truss.dynamics.arms[0].mass:g} kg"
)

# %%
# Check of the matrices: MYSTRAN also printed its natural frequencies.

# Hz, of its .F06
PRINTED = [6.608789, 6.608789, 8.514173, 15.91218, 15.91218, 23.19858]
print(
    "frequencies less those printed [Hz]:",
    *(f"{f:.0e}" for f in modes.frequencies[:6] - PRINTED),
)

# %%
# Feasibility: a linear program over all thrusters and wheels gives the least duration. A path of twice that
# duration needs a quarter of their strength.

least, taken = flown.least_duration(), flown.mission.duration
print(
    f"the path takes {taken:g} s, the actuators need {least:.1f} s: they use {(least / taken) ** 2:.0%}"
)

# %%
# Run it. Thrust has a quantum of 0.1 N, commands have 40 ms of delay, and no sensor measures the ribs.

result = check_run(
    flown.simulator(flown.diagram()).run(flown.duration, progress=False), truss
)
figure, axes = plt.subplots(3, sharex=True, layout="constrained")
for axis, name, label in zip(
    axes,
    ("position_error", "attitude_error", "grasp_displacement"),
    ("position [µm]", "attitude [µrad]", "ribs [µm]"),
    strict=True,
):
    size = 1e6 * np.linalg.norm(result[name], axis=-1)
    axis.plot(result["time"], size)
    axis.set(ylabel=label)
    print(
        f"{name}: at most {size.max():.0f} {label[-3:-1] if 'µm' in label else 'µrad'}"
    )
axes[-1].set(xlabel="time [s]")
plt.show()

# %%
# In motion, with lines for the elements:

replay(result, truss, "antenna.html", rods=flown.rods, title=flown.title)
