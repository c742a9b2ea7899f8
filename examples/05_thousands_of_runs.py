"""
Tutorial 5: thousands of runs
=============================

A controller has to work for every mass and disturbance that may occur, and not only for one. The tutorial simulates
1000 samples of one axis of the paper's loop, finds the worst, and varies a gain of the whole loop.
"""

import matplotlib.pyplot as plt
from scipy import stats

from trussflow.blocks import (
    Constant,
    Diagram,
    DisturbanceObserver,
    Gain,
    IntegralSlidingMode,
    Integrator,
    Quintic,
    Saturation,
    plot,
    rerun,
    sweep,
)
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

# %%
# One axis
# --------
#
# On one axis, truss and robots are a mass of 577 kg. Trajectory, sliding mode and observer are the blocks of
# :doc:`tutorial 1 </gallery/01_wire_and_simulate>`. A constant force pulls at the mass, and the thrusters give at
# most 8 N. The observer gets the limited thrust. The block ``mass`` is the plant; ``demand`` contains the mass that
# the controller assumes.

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
(control.feedforward + control.feedback - observer.disturbance_estimate) >> demand
demand >> limit
(limit.y / 577.3) >> observer.nominal_acceleration
(limit.y + pull.y) >> mass >> velocity >> position
loop.draw("axis.svg")

# %%
# The sweep
# ---------
#
# ``vary`` maps parameters and initial states to distributions of ``scipy.stats``: the mass is uncertain by 15 %,
# the pull has a standard deviation of 1 N, and the truss begins with an error of a few centimetres. ``keep`` maps
# names to what is kept of each run: a reduction of a signal, here peak and final value, or a function of the whole
# result.
#
# Parameters are inputs of the compiled code, so that new values need no compilation. The runs are divided among
# worker processes. A thousand runs take some seconds; ``samples=100_000`` works in the same way.

swept = sweep(
    loop,
    70.0,
    step=0.02,
    log_step=0.1,
    samples=1000,
    method="latin",
    seed=1,
    vary={
        "mass.gain": stats.uniform(1 / 577.3 / 1.15, 0.3 / 577.3),  # 1/kg
        "pull.value[0]": stats.norm(0.0, 1.0),  # N
        "position.integral[0]": stats.norm(0.0, 0.02),  # m
    },
    keep={"force": ("limit.y", "peak"), "error": ("control.error", "final")},
)
swept["status"].to_series().value_counts().to_frame()

# %%
# The result is a dataset along ``sample``; the varied values are its coordinates. Quantiles of the peak force [N]
# and of the error 10 s after the motion [m]:

swept["error"] = abs(swept["error"])
swept[["force", "error"]].quantile([0.05, 0.5, 0.95, 1.0]).to_dataframe()

# %%
# Critical values
# ---------------
#
# Each point is a run. Many runs reach the limit of the thrusters for a while. Only pulls above 2 N leave an error of
# more than 1 mm.

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
left.scatter(swept["pull.value[0]"], swept["force"], 4)
left.set(xlabel="pull [N]", ylabel="peak force [N]")
right.semilogy(swept["pull.value[0]"], swept["error"], ".", markersize=2)
right.set(xlabel="pull [N]", ylabel="error after the motion [m]")
plt.show()

# %%
# The worst run
# -------------
#
# ``rerun`` repeats a sample bit by bit, with all of its signals:

worst = int(swept["error"].values.argmax())
result = rerun(loop, swept, worst)
print(f"mass {1 / float(swept['mass.gain'][worst]):.0f} kg")
print(f"pull {float(swept['pull.value[0]'][worst]):.2f} N")
result["control.error"].attrs["units"] = "m"
result["limit.y"].attrs["units"] = "N"
plot(result, "control.error", "limit.y")

# %%
# A large mass is pulled against the motion. From 6 s on the thrusters are at their limit, so that the truss falls
# behind. The integral of the controller grows meanwhile, and the truss overshoots. The mission needs more time or
# stronger thrusters.

# %%
# The whole truss
# ---------------
#
# A short model finds the critical cases; the complete model confirms them. The same function varies the bandwidth
# of the observer in the loop of tutorial 1. A list of values is a grid. Four runs need no worker processes:

bandwidths = sweep(
    transport_diagram(Mission.of_case(1), SpaceTruss.published()),
    5.0,
    step=1e-3,
    vary={"observer.gain": [1.0, 2.0, 4.0, 8.0]},  # 1/s
    keep={
        "force": lambda run: float(abs(run["truss.base_force"]).max()),
        "error": lambda run: float(abs(run["errors.error"][:, :3]).max()),
    },
    log=["truss.base_force", "errors.error"],
    executor="serial",
)
bandwidths[["force", "error"]].to_dataframe()

# %%
# A larger bandwidth gives a smaller position error [m] at a little more force [N]: the error of the observer is at
# most the rate of change of the disturbance, divided by the bandwidth. Tutorial 3 shows the price, noise.

# %%
# To try
# ------
#
# * ``path="folder"`` keeps finished runs; the same call continues after an interruption.
# * ``executor=client.get_executor()`` uses the workers of a Dask cluster (:doc:`guide </sweeps>`).
# * ``tune`` searches the gains with the least cost (:doc:`example </gallery/analysis/identify_damping>`).
