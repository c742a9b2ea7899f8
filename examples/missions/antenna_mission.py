"""
An antenna from Nastran, three modules without arms
===================================================

``antenna.bdf`` is a mesh reflector on six ribs, in tonnes, millimetres and cylindrical axes. A line of its
executive control, ``OUTPUT4 KGG,MGG``, has the solver write the matrices of mass and stiffness; those beside
it are MYSTRAN's, an open solver of Nastran's decks, kept sparse. ``antenna_mission.toml`` says what flies it:
three modules with thrusters and wheels, bolted to the middle ring, and the law of the mean axes behind
sensors with noise. The same as ``trussflow fly antenna_mission.toml``. Nastran's files are read by an extra,
``pip install trussflow[nastran]``.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models.transport import MissionFile, tidy
from trussflow.models.viewer import replay

flown = MissionFile.read("antenna_mission.toml")
truss = flown.truss
modes = truss.dynamics.modes
print(f"{modes.masses.sum():.2f} kg and {truss.robots} modules of {truss.dynamics.arms[0].mass:g} kg")

# %%
# Are these the matrices of this deck? MYSTRAN printed the frequencies that it found itself.

PRINTED = [6.608789, 6.608789, 8.514173, 15.91218, 15.91218, 23.19858]  # Hz, of its .F06
print("frequencies less those printed [Hz]:", *(f"{f:.0e}" for f in modes.frequencies[:6] - PRINTED))

# %%
# Can it be flown? The least duration is a linear programme over all thrusters and wheels; a path of twice
# that takes a quarter of their strength.

least, taken = flown.least_duration(), flown.mission.duration
print(f"the path takes {taken:g} s, the actuators need {least:.1f} s: they use {(least / taken) ** 2:.0%}")

# %%
# Fly it. Thrust comes in steps of 0.1 N, commands 40 ms late, and nobody sees the ribs bend.

raw = flown.simulator(flown.diagram()).run(flown.duration, progress=False)
result = tidy(raw, truss)
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
    print(f"{name}: at most {size.max():.0f} {label[-3:-1] if 'µm' in label else 'µrad'}")
axes[-1].set(xlabel="time [s]")
plt.show()

# %%
# And in motion, as elements join the nodes:

replay(raw, truss, "antenna.html", rods=flown.rods, title=flown.title)
