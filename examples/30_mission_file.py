"""
A mission as a file
===================

What is flown can be said in a file: structure, robots, hardware, control law, path. It extends another,
here the first mission of the paper, and says only what differs; numbers carry their units. The command
``trussflow fly mission.toml`` flies it, ``--explain`` lists every value and the file that says so.
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
# Before it is flown: how fast could the actuators do it at all? A linear programme over all of them says it.

print(flown.title)
print(f"the path takes {flown.mission.duration:g} s, the actuators need {flown.least_duration():.1f} s")
for told in flown.told:
    if told.place == "mission.toml":
        print(f"  {told.key} = {told.value}")

# %%
# Then it is a diagram like any other.

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
