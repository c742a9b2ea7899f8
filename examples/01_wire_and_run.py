"""
The paper's mission, wired from blocks
======================================

Case 1 of the paper: four space robots carry a flexible truss by 6 m along z in 60 s. The loop consists of a
quintic trajectory, integral sliding mode control (ISMC), a disturbance observer (NDO), redundant allocation
and the plant.
"""

import numpy as np

from trussflow.blocks import (
    Diagram,
    DisturbanceObserver,
    IntegralSlidingMode,
    Quintic,
    WeightedAllocation,
    simulate,
)
from trussflow.models import NominalModel, SpaceTruss
from trussflow.models.viewer import replay

plant = SpaceTruss.published()
units = plant.task_units  # three positions, three Euler angles, 28 joint angles
displacement = np.zeros(plant.rigid)
displacement[2] = 6.0  # m along z, everything else stays
weights = [1, 1, 1, 2, 1.2, 1 / 6] * plant.robots + [
    1
] * plant.joints  # forces, torques; joints

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
    allocation=WeightedAllocation(plant.rigid, weights),
    truss=plant,
)

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
log = [control.error, truss.coordinates, truss.base_force, truss.base_torque]
result = simulate(loop, 80.0, step=1e-3, log=log, log_step=0.01)
error = result["control.error"].sel(coordinate=["x", "y", "z"])
print("largest position error  ", float(abs(error).max()), "m")
print(
    "largest base force      ",
    abs(result["truss.base_force"]).max(["time", "axis"]).values,
    "N",
)
print("largest base torque     ", float(abs(result["truss.base_torque"]).max()), "N*m")

# %%
# The run as an HTML page: the truss in motion, with its deformation exaggerated, and charts.

replay(result, truss, "transport.html", title="Case 1 of the paper")
