"""
A mission as a file
===================

A file defines structure, robots, hardware, controller and path. It extends another file, here Case 1 of the
paper, and contains only the differences; numbers carry units. ``trussflow fly mission.toml`` simulates it,
``--explain`` lists every value with the file that sets it.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models.transport import MissionFile, tidy

TEXT = """
title = "Two metres up, a turn of ten degrees"
extends = "case_1.toml"

[path]
position = "[0, 0, 2000] mm"
attitude = "[0, 0, 10] deg"
duration = "0.7 min"

[simulation]
duration = "50 s"
"""

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "mission.toml"
    path.write_text(TEXT, encoding="utf-8")
    flown = MissionFile.read(path)

# %%
# Feasibility: a linear program over all actuators gives the least duration of the path.

print(flown.title)
print(f"the path takes {flown.mission.duration:g} s, the actuators need {flown.least_duration():.1f} s")
for told in flown.told:
    if told.place == "mission.toml":
        print(f"  {told.key} = {told.value}")

# %%
# The mission is a diagram like any other.

result = tidy(flown.simulator(flown.diagram()).run(flown.duration, progress=False), flown.truss)
_, axes = plt.subplots(2, sharex=True)
axes[0].plot(result["time"], result["position"], label=list("xyz"))
axes[0].plot(result["time"], np.rad2deg(result["attitude"][:, 2]) / 10, "k--", label="psi / 10 deg")
axes[0].set(ylabel="root [m]")
axes[0].legend()
axes[1].plot(result["time"], abs(result["base_force"]).max("axis"))
axes[1].set(xlabel="time [s]", ylabel="greatest force [N]")
axes[1].legend([f"robot {k}" for k in (1, 2, 3, 4)])
plt.show()
