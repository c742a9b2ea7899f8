"""
Tutorial 1: wire and simulate
=============================

Four space robots carry a flexible truss of 500 kg along z by 6 m in 60 s. This is Case 1 of the paper by Li,
Wei and Chen (2026). The tutorial wires its control loop from blocks, simulates it, and looks at the result.
The other four tutorials use the same loop.

Each page of the tutorial is a script and a notebook; both can be downloaded at its end.
"""

import numpy as np

from trussflow.blocks import (
    Diagram,
    DisturbanceObserver,
    IntegralSlidingMode,
    Quintic,
    WeightedAllocation,
    plot,
    simulate,
)
from trussflow.models import NominalModel, SpaceTruss
from trussflow.models.viewer import replay

# %%
# The plant
# ---------
#
# A block has input ports, output ports, states and parameters. ``SpaceTruss`` is the whole plant: the truss with
# six bending modes, and four robots with seven joints each. ``published()`` has the paper's equations and data.

plant = SpaceTruss.published()
plant

# %%
# The input ``actuation`` has 52 elements: three forces and three torques of each robot base, then the 28 joint
# torques. The output ``task_position`` has 34: position and attitude of the truss, then the 28 joint angles. Each
# port has units, here a different one for each element.

# %%
# The blocks of the loop
# ----------------------
#
# ``add`` puts blocks into a diagram under the names of the keywords, and returns them in the same order. The loop
# needs five blocks besides the plant:
#
# * ``Quintic`` is the trajectory. It moves each coordinate by a displacement, and begins and ends at rest.
# * ``IntegralSlidingMode`` (ISMC) computes the acceleration that removes the error.
# * ``DisturbanceObserver`` (NDO) estimates the acceleration that the model of the controller does not explain.
# * ``NominalModel`` converts accelerations to forces and torques, by the equations of motion.
# * ``WeightedAllocation`` distributes 34 generalized forces to 52 actuators, with least weighted effort.

units = plant.task_units
displacement = np.zeros(34)
displacement[2] = 6.0  # m along z; attitude and joints stay
weights = [1, 1, 1, 2, 1.2, 1 / 6] * 4 + [1] * 28  # bases; joints

loop = Diagram("transport")
trajectory, control, observer, model, allocation, truss = loop.add(
    trajectory=Quintic(displacement, duration=60.0, unit=units),
    control=IntegralSlidingMode(
        gamma=1.0,
        mu=0.25,
        beta=0.9,
        eta=0.001,
        sigma=0.3,
        boundary_layer=0.001,
        unit=units,
    ),
    observer=DisturbanceObserver(4.0, unit=units),
    model=NominalModel(plant.dynamics),
    allocation=WeightedAllocation(34, weights),
    truss=plant,
)

# %%
# The wires
# ---------
#
# ``>>`` connects an output port to an input port. Shapes and units are checked at once: a position [m] cannot
# drive a velocity [m/s]. There are three groups of wires:
#
# * The controller compares the trajectory with the measured motion.
# * The nominal model needs the present coordinates and speeds, and the two parts of the acceleration. The observer
#   receives the measured speeds and the acceleration that the model expects; its estimate returns to the model.
# * The allocation closes the loop. It uses the present actuation matrix, which the model computes.

trajectory.position >> control.reference_position
trajectory.velocity >> control.reference_velocity
trajectory.acceleration >> control.reference_acceleration
truss.task_position >> control.position
truss.task_velocity >> control.velocity

truss.coordinates >> model.coordinates
truss.speeds >> model.speeds
control.feedforward >> model.feedforward
control.feedback >> model.feedback
truss.rigid_speeds >> observer.velocity
model.nominal_acceleration >> observer.nominal_acceleration
observer.disturbance_estimate >> model.disturbance_estimate

model.generalized_force >> allocation.demand
model.actuation_matrix >> allocation.effectiveness
allocation.command >> truss.actuation

loop.draw("loop.svg")

# %%
# The picture shows every block and wire. A notebook shows it for any diagram that is the last value of a cell.

# %%
# The run
# -------
#
# ``simulate`` compiles the equations of all blocks to C, which takes some seconds at the first run, and integrates
# them with the classical Runge–Kutta method. The step is 1 ms, as in the paper. Logged are four signals, every 10
# ms. The last 20 s show whether the truss rests after the motion.

log = [control.error, truss.coordinates, truss.base_force, truss.base_torque]
result = simulate(loop, 80.0, step=1e-3, log=log, log_step=0.01)
result

# %%
# The result is an ``xarray.Dataset``. Each signal has its name in the diagram, its unit, and the names of its
# elements, so that the largest position error along z and the largest force of each base need no indices:

error = result["control.error"].sel(coordinate=["x", "y", "z"])
print("largest position error", float(abs(error).max()), "m")
abs(result["truss.base_force"]).max("time").to_pandas().round(3)

# %%
# No base needs more than 3.3 N. Truss and robots are 577 kg, and the trajectory accelerates them by at most 9.6
# mm/s², which is 5.6 N for all bases together. The bases share it so that the truss does not turn.
#
# ``plot`` shows signals over time, one subplot for each unit. The method ``result.trussflow.plot(...)`` does the
# same; ``result.plot`` is xarray's own.

position = result.sel(coordinate=["x", "y", "z"])
figure = plot(position, "control.error")

# %%
# The error is at most 4 µm. It oscillates with a period of 3.2 s and decays slowly: this is the slowest mode of
# the truss in the closed loop.

# %%
# The motion
# ----------
#
# ``replay`` writes a page with the moving truss and charts of all logged signals. Deformations are exaggerated,
# and a click in a chart sets the time.

replay(result, truss, "transport.html", title="Case 1 of the paper")

# %%
# To try
# ------
#
# * Change ``displacement`` or ``duration``, and run the cells again: a block that is added again under the same
#   name replaces the old one and keeps its wires.
# * Remove a wire with ``loop.disconnect(observer.velocity)`` and simulate: the message names the open input.
# * ``trussflow.models.transport.transport_diagram`` builds this loop in one call. The next tutorials use it.
