"""
Damping found in a test
=======================

A truss floats free and rings. What four grasps do is measured with noise, and one wants to know frequencies
and damping of its modes. ``tune`` looks for those with which the model does what was measured: it
differentiates the whole run exactly, so some twenty runs will do. Where the misfit comes down to the noise,
one, there is nothing more to be learnt.
"""

# %%
# The test
# --------
# Here the truth is known, for the test is simulated: three modes, with other frequencies and damping ratios
# than the model begins with.

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Diagram, simulate, tune
from trussflow.models import TunableTruss

NOISE = 1e-5  # of the measured displacements [m]
truss = TunableTruss.consistent(modes=3)
model = Diagram("ringing truss")
model.add(truss=truss)
model.ground(truss.actuation)
believed = {name: truss.parameters[name] for name in ("frequency", "damping_ratio")}
truth = {
    "truss.frequency": believed["frequency"] * [1.01, 0.99, 1.008],
    "truss.damping_ratio": np.array([0.004, 0.006, 0.009]),
}
bent = truss.parameters["initial_coordinates"].copy()
bent[-3:] = 0.02
run = simulate(
    model,
    2.0,
    parameters=truth,
    initial={"truss.q": bent},
    step=0.01,
    log=[truss.grasp_displacement],
    log_step=0.02,
)
test = run["truss.grasp_displacement"]
measured = test.values + np.random.default_rng(1).normal(0.0, NOISE, test.shape)

# %%
# What explains it
# ----------------
# The cost is written as equations of blocks are; it is one where only the noise is left.


def misfit(run):
    """Return the mean square of what the model misses, in units of the noise."""
    return np.mean((run["truss.grasp_displacement"] - measured) ** 2) / NOISE**2


found = tune(
    model,
    2.0,
    misfit,
    {
        "truss.frequency": (0.97 * believed["frequency"], 1.03 * believed["frequency"]),
        "truss.damping_ratio": (0.0, 0.05),
    },
    samples=[{"truss.q": bent}],
    step=0.01,
    log=[truss.grasp_displacement],
    log_step=0.02,
)
print(found)

# %%
# Found and true
# --------------

figure, axes = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
for axis, name in zip(axes, truth, strict=True):
    key = name.partition(".")[2]
    for values, marker, label in ((believed[key], "x", "believed"), (found.values[name], "o", "found")):
        axis.plot(range(1, 4), values / truth[name], marker, label=label)
    axis.axhline(1.0, color="grey", linewidth=0.8)
    axis.set(xlabel="mode", ylabel=f"{key.replace('_', ' ')} / true [-]", xticks=range(1, 4))
axes[0].legend()
plt.show()
