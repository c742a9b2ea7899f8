"""
Tutorial 5: thousands of runs
=============================

A controller has to work for every mass and disturbance that may occur, and not only for one. The tutorial simulates
2000 samples of one axis of the paper's loop, finds the worst, and varies a gain of the whole loop.
"""

# %%
# One axis
# --------
#
# On one axis, truss and robots are a mass of 577 kg. Trajectory, sliding mode and observer are the blocks of
# :doc:`tutorial 1 </gallery/01_wire_and_simulate>`. A constant force pulls at the mass, and the thrusters give at
# most 8 N. The block ``mass`` is the plant; ``demand`` contains the mass that the controller assumes.

from trussflow.blocks import (
    Constant,
    Diagram,
    DisturbanceObserver,
    Gain,
    IntegralSlidingMode,
    Integrator,
    Quintic,
    Saturation,
)

loop = Diagram("axis")
trajectory, control, observer, demand, limit = loop.add(
    trajectory=Quintic([6.0], 60.0),
    control=IntegralSlidingMode(
        gamma=1.0, mu=0.25, beta=0.9, eta=1e-3, sigma=0.3, boundary_layer=1e-3
    ),
    observer=DisturbanceObserver(4.0),
    demand=Gain(577.3),  # kg
    limit=Saturation(-8.0, 8.0),  # N
)
pull, mass, velocity, position = loop.add(
    pull=Constant([0.0]),  # N
    mass=Gain(1.0 / 577.3),  # 1/kg
    velocity=Integrator([0.0]),
    position=Integrator([0.0]),
)
trajectory.position >> control.reference_position
trajectory.velocity >> control.reference_velocity
trajectory.acceleration >> control.reference_acceleration
position >> control.position
velocity >> control.velocity
velocity >> observer.velocity
wanted = control.feedforward + control.feedback
wanted >> observer.nominal_acceleration
(wanted - observer.disturbance_estimate) >> demand >> limit
(limit.y + pull.y) >> mass >> velocity >> position
loop.draw("axis.svg")

# %%
# The sweep
# ---------
#
# ``vary`` maps parameters and initial states to distributions of ``scipy.stats``: the mass is uncertain by 15 %, the pull
# has a standard deviation of 1 N, and the truss begins with an error of a few centimetres. ``keep`` maps names to what
# is kept of each run: a reduction of a signal, or a function of the whole result.
#
# Parameters are inputs of the compiled code, so that new values need no compilation. The runs are divided among worker
# processes.

from scipy import stats

from trussflow.blocks import rerun, sweep

swept = sweep(
    loop,
    80.0,
    step=0.01,
    samples=2000,
    method="latin",
    seed=1,
    vary={
        "mass.gain": stats.uniform(1 / 577.3 / 1.15, 0.3 / 577.3),  # 1/kg
        "pull.value": stats.norm(0.0, 1.0),  # N
        "position.integral": stats.norm(0.0, 0.02),  # m
    },
    keep={
        "force": ("limit.y", "peak"),
        "error": lambda run: float(abs(run["control.error"][-2000:]).max()),
    },
)
swept["status"].to_series().value_counts()

# %%
# The result is a dataset along ``sample``; the varied values are its coordinates. Quantiles of peak force [N] and of the
# largest error after the motion [m]:

swept[["force", "error"]].quantile([0.05, 0.5, 0.95, 1.0]).to_dataframe()

# %%
# What makes a run bad
# --------------------
#
# Each point is a run. The error is small as long as the thrusters are strong enough.

import matplotlib.pyplot as plt

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
left.scatter(swept["pull.value"], swept["force"], 4)
left.set(xlabel="pull [N]", ylabel="peak force [N]")
right.semilogy(swept["pull.value"], swept["error"], ".", markersize=2)
right.set(xlabel="pull [N]", ylabel="error after the motion [m]")
plt.show()

# %%
# The worst run
# -------------
#
# ``rerun`` repeats a sample bit by bit, with all of its signals:

from trussflow.blocks import plot

worst = int(swept["error"].argmax())
result = rerun(loop, swept, worst)
print({name: float(swept[name][worst]) for name in ("mass.gain", "pull.value")})
plot(result, "control.error", "limit.y")

# %%
# The whole truss
# ---------------
#
# A short model finds the critical cases; the complete model confirms them. The same function varies the bandwidth of the
# observer in the loop of tutorial 1. A list of values is a grid:

from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

bandwidths = sweep(
    transport_diagram(Mission.of_case(1), SpaceTruss.published()),
    10.0,
    step=1e-3,
    vary={"observer.gain": [1.0, 2.0, 4.0, 8.0]},  # 1/s
    keep={"force": ("truss.base_force", "peak"), "error": ("errors.error", "peak")},
)
bandwidths[["force", "error"]]

# %%
# To try
# ------
#
# * ``path="folder"`` keeps finished runs; the same call continues after an interruption.
# * ``executor=client.get_executor()`` uses the workers of a Dask cluster (:doc:`guide </sweeps>`).
# * ``tune`` searches the gains with the least cost (:doc:`example </gallery/analysis/identify_damping>`).
