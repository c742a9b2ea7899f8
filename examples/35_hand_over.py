"""
A robot lets go: three carry the truss back
===========================================

Four robots carry the truss to its destination. Then one of them leaves, and the remaining three bring the
truss back with a controller for three robots.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Simulator
from trussflow.models import SpaceTruss
from trussflow.models.feasibility import ActuatorLimits, survey
from trussflow.models.transport import Mission, mean_axes_transport, path_of

there, four = Mission.of_case(1), SpaceTruss.consistent()


def flight(mission, truss):
    """Simulate a mission under mean-axes control."""
    diagram = mean_axes_transport(mission, truss)
    log = ["truss.q", "truss.v", "trajectory.position"]
    return Simulator(diagram, step=2e-3, log=log, log_step=0.1).run(75.0, progress=False)


way = flight(there, four)

# %%
# Robot 2 lets go in the final state, with the remaining motion. Feasibility of the way back, also with one
# more failure, is checked first:

three = four.without(2, way["truss.q"].values[-1], way["truss.v"].values[-1])
back = replace(there, case=None, position=-there.position)
for verdict in survey(three.dynamics, path_of(back, three), ActuatorLimits.flight()):
    print(verdict)
home = flight(back, three)

# %%
# The controller of the three starts from its measurements, without a jump.

figure, axes = plt.subplots(2, sharex=True)
for result, start, label in ((way, 0.0, "four"), (home, 75.0, "three")):
    error = result["truss.q"].values[:, :3] - result["trajectory.position"].values[:, :3]
    axes[0].plot(result["time"] + start, result["truss.q"][:, 2], label=label)
    axes[1].plot(result["time"] + start, 1e6 * np.linalg.norm(error, axis=1))
axes[0].set(ylabel="height [m]")
axes[0].legend()
axes[1].set(xlabel="time [s]", ylabel="error [µm]")
plt.show()
