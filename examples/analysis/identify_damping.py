"""
Damping identified from a test
==============================

A free truss vibrates, and the displacements of four grasps are measured with noise. ``tune`` finds the
frequencies and damping ratios for which the model fits the measurement. It differentiates the whole run
exactly, so about twenty runs suffice. A normalized misfit of one is the level of the noise.
"""

# %%
# The test
# --------
# The test is simulated, so the true values are known: three modes whose frequencies and damping ratios differ
# from the initial values of the model.

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Diagram, simulate, tune
from trussflow.models import TunableTruss

NOISE_DEVIATION = 1e-5  # of the measured displacements [m]
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
measured = test.values + np.random.default_rng(1).normal(
    0.0, NOISE_DEVIATION, test.shape
)

# %%
# Fit
# ---
# The cost is traced like an equation of a block; it is one if only the noise remains.


def misfit(run):
    """Return the mean square of the misfit, in units of the noise."""
    return (
        np.mean((run["truss.grasp_displacement"] - measured) ** 2) / NOISE_DEVIATION**2
    )


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
# Result
# ------

figure, axes = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")
for axis, name in zip(axes, truth, strict=True):
    key = name.partition(".")[2]
    for values, marker, label in (
        (believed[key], "x", "believed"),
        (found.values[name], "o", "found"),
    ):
        axis.plot(range(1, 4), values / truth[name], marker, label=label)
    axis.axhline(1.0, color="grey", linewidth=0.8)
    axis.set(
        xlabel="mode", ylabel=f"{key.replace('_', ' ')} / true [-]", xticks=range(1, 4)
    )
axes[0].legend()
plt.show()
