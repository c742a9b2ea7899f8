"""
A run in motion
===============

The base of one robot pushes the truss for a moment, without control. ``replay`` writes the run as one page:
the truss in motion, with deformations exaggerated by a slider, and charts of all logged signals.
"""

import numpy as np

from trussflow.blocks import Diagram, Step, simulate
from trussflow.models import SpaceTruss
from trussflow.models.viewer import replay

plant = SpaceTruss.consistent()
push = np.zeros(plant.actuators)
push[20] = 2.0  # N, Robot 4 along z
flight = Diagram("pushed")
force, truss = flight.add(
    force=Step(2.0, initial_value=push, final_value=0 * push, unit=plant.actuator_units), truss=plant
)
force.y >> truss.actuation
flight.draw("pushed.svg")

# %%
log = [truss.coordinates, truss.base_force, truss.base_torque, truss.modal_coordinate, truss.energy]
result = simulate(flight, 20.0, step=1e-3, log=log, log_step=0.02)
replay(result, truss, "pushed.html", title="A push and what it leaves")
