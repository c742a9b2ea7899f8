"""
FMUs, out and in
================

The plant is exported as an FMU, checked and run by FMPy, and imported again as a block.
"""

import numpy as np
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.fmu import Fmu, export
from trussflow.models import SpaceTruss

TIME_STEP = 1e-3  # s
STOP_TIME = 0.2  # s

# 1. Export: C sources and a binary that needs no Python, for co-simulation and model exchange.
path = "space_truss.fmu"
export(SpaceTruss.consistent(), path, version="3.0", step=TIME_STEP)
print("problems found by the validator:", validate_fmu(path) or "none")

# 2. In another tool: the force of Robot 4 along z, one of 52 actuators.
push = np.zeros(52)
push[20] = 2.0  # N
run = simulate_fmu(
    path,
    fmi_type="CoSimulation",
    stop_time=STOP_TIME,
    output_interval=TIME_STEP,
    step_size=TIME_STEP,
    start_values={"actuation": " ".join(map(str, push))},
    output=["task_position", "energy"],
)
print(f"fmpy:  z = {run['task_position'][-1][2]:.12e} m, {run['energy'][-1]:.6e} J")


# 3. Back in a diagram: the FMU for model exchange, under the diagram's solver.
def moved(plant):
    """Return the final position along z [m]."""
    diagram = Diagram("pushed truss")
    force, truss = diagram.add(
        force=Constant(push, unit=SpaceTruss.consistent().actuator_units), truss=plant
    )
    force >> truss.actuation
    diagram.draw("truss_as_block.svg")
    result = simulate(diagram, STOP_TIME, step=TIME_STEP, log=["truss.task_position"])
    return float(result["truss.task_position"][-1, 2])


print(f"block: z = {moved(SpaceTruss.consistent()):.12e} m")
print(f"FMU:   z = {moved(Fmu(path, kind='me')):.12e} m")
