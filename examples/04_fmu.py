"""
Tutorial 4: FMUs, out and in
============================

A functional mock-up unit (FMU) is a model in a file that many simulators read. The tutorial exports the plant, runs it
in another tool, and puts it back into the paper's loop of :doc:`tutorial 1 </gallery/01_wire_and_simulate>`.
"""

# %%
# Out
# ---
#
# ``export`` writes the equations of a block as C, compiles them, and packs sources, binary and description into one
# file. The FMU needs neither Python nor this package. It offers both kinds of FMI 3.0: co-simulation (the FMU
# integrates itself, here in steps of 1 ms) and model exchange (the importing tool integrates).

from trussflow.fmu import Fmu, export
from trussflow.models import SpaceTruss

plant = SpaceTruss.published()
export(plant, "space_truss.fmu", version="3.0", step=1e-3)

# %%
# Another tool
# ------------
#
# FMPy is an independent implementation of the standard. Its validator checks the file, and its simulator runs it. The
# input is the force of base 4 along z, one of 52 actuators:

import numpy as np
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

push = np.zeros(52)
push[20] = 2.0  # N
print("problems found by the validator:", validate_fmu("space_truss.fmu") or "none")
run = simulate_fmu(
    "space_truss.fmu",
    fmi_type="CoSimulation",
    stop_time=0.2,
    output_interval=1e-3,
    step_size=1e-3,
    start_values={"actuation": " ".join(map(str, push))},
    output=["task_position"],
)
print(f"z = {run['task_position'][-1][2]:.15e} m")

# %%
# The same push in a diagram, with the block that was exported:

from trussflow.blocks import Constant, Diagram, simulate

pushed = Diagram("pushed truss")
force, truss = pushed.add(
    force=Constant(push, unit=plant.actuator_units), truss=plant
)
force >> truss.actuation
result = simulate(pushed, 0.2, step=1e-3, log=[truss.task_position])
print(f"z = {float(result['truss.task_position'][-1, 2]):.15e} m")

# %%
# All digits agree, since both run the same C with the same method and step.

# %%
# In
# --
#
# ``Fmu`` makes a block of any FMU. Its description gives the ports, with shapes and units. With ``kind="me"`` the block is
# for model exchange: the solver of the diagram integrates it.

fmu = Fmu("space_truss.fmu", kind="me")
fmu

# %%
# The FMU replaces the plant in the paper's loop. ``add`` with the name of a block that is there replaces the block; the
# new block takes over all wires whose ports it has:

from trussflow.models.transport import Mission, transport_diagram

loop = transport_diagram(Mission.of_case(1), SpaceTruss.published())
log = {"log": ["truss.base_force"], "step": 1e-3}
expected = simulate(loop, 0.5, **log)

loop.add(truss=fmu)
loop.draw("loop_with_fmu.svg")
found = simulate(loop, 0.5, **log)

# %%
# The forces of the bases in both runs:

difference = abs(found["truss.base_force"].values - expected["truss.base_force"].values)
print("largest force     ", float(abs(expected["truss.base_force"]).max()), "N")
print("largest difference", difference.max(), "N")

# %%
# The loop with the FMU is slower, because each evaluation of the plant crosses the interface of the standard. It is the
# way to include a plant of another tool, or to test an FMU before it is delivered.

# %%
# To try
# ------
#
# * ``export(plant, "plant.fmu", version="2.0")`` writes FMI 2.0, for older tools.
# * ``Fmu(path, time_limit=10.0)`` runs an FMU that you do not trust to end in a process of its own.
# * ``cosimulate`` couples several FMUs (:doc:`example </gallery/loops/cosimulation>`, :doc:`guide </exchange>`).
