"""
Tutorial 4: FMUs, out and in
============================

A functional mock-up unit (FMU) is a model in a file that many simulators read. The tutorial exports the plant, runs it
in another tool, and puts it back into the paper's loop of :doc:`tutorial 1 </gallery/01_wire_and_simulate>`.
"""

import numpy as np
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.fmu import Fmu, export
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

# %%
# Out
# ---
#
# ``export`` writes the equations of a block as C, compiles them, and packs sources, binary and description into
# one file. The FMU needs neither Python nor this package. It offers both kinds of FMI 3.0: co-simulation (the FMU
# integrates itself, here in steps of 1 ms) and model exchange (the importing tool integrates).

plant = SpaceTruss.published()
export(plant, "space_truss.fmu", version="3.0", step=1e-3)

# %%
# Another tool
# ------------
#
# FMPy is an independent implementation of the standard. Its validator checks the file, and its simulator runs it.
# The input is the force of base 4 along z, one of 52 actuators:

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
# In
# --
#
# ``Fmu`` makes a block of any FMU. Its description gives the ports, with shapes and units. By default it is for
# co-simulation: a sampled block, whose inputs are held during each step.

pushed = Diagram("pushed truss")
force, truss = pushed.add(
    force=Constant(push, unit=plant.actuator_units), truss=Fmu("space_truss.fmu")
)
force >> truss.actuation
pushed.ground(truss.modal_force)
pushed.draw("pushed.svg")

# %%
# ``ground`` sets the second input to zero. Without this line the next one raises an error, since open inputs are
# never zero by accident. The position agrees with FMPy to the last digit, as both step the same code:

result = simulate(pushed, 0.2, step=1e-3, log=[truss.task_position])
print(f"z = {float(result['truss.task_position'][-1, 2]):.15e} m")

# %%
# In the paper's loop
# -------------------
#
# The FMU replaces the plant of the loop. ``add`` with the name of a block that is there replaces the block, and
# the new one takes over the wires. Some outputs of the truss depend on the actuation at the same instant. A
# co-simulation has the actuation of the next step only after these outputs; ``delayed=True`` accepts those of the
# previous instant.

loop = transport_diagram(Mission.of_case(1), SpaceTruss.published())
log = ["truss.base_force", "errors.error"]
expected = simulate(loop, 0.5, step=1e-3, log=log)

loop.add(truss=Fmu("space_truss.fmu", delayed=True))
loop.ground(loop.truss.modal_force)
found = simulate(loop, 0.5, step=1e-3, log=log)

# %%
# The largest forces of the bases, and their differences between both runs:

difference = found["truss.base_force"].values - expected["truss.base_force"].values
print("largest force     ", float(abs(expected["truss.base_force"]).max()), "N")
print("largest difference", float(abs(difference).max()), "N")

# %%
# The difference is the price of co-simulation: the actuation is held for 1 ms. The loop of :doc:`tutorial 3
# </gallery/03_sampled_control>` tolerates 1.5 ms. A shorter step reduces the difference.

# %%
# To try
# ------
#
# * ``Fmu(path, kind="me")`` is for model exchange: a continuous block that the solver of the diagram integrates.
# * ``export(plant, "plant.fmu", version="2.0")`` writes FMI 2.0, for older tools.
# * ``Fmu(path, time_limit=10.0)`` runs an FMU that you do not trust to end in a process of its own.
# * ``cosimulate`` couples several FMUs (:doc:`example </gallery/loops/cosimulation>`, :doc:`guide </exchange>`).
