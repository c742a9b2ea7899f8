"""
Tutorial 2: linearize, Bode plot, margins
=========================================

The loop of :doc:`tutorial 1 </gallery/01_wire_and_simulate>` is linearized at rest. The tutorial computes its modes
and margins, and closes a path that the paper leaves out. With that path the published loop is unstable.
"""

from dataclasses import replace

from trussflow.blocks import linearize, loop_margins, modal_bode, modal_table, trim
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

# %%
# A law with a slope
# ------------------
#
# The published law contains the error to the power 0.9, which has an infinite slope at zero error. A linear
# analysis needs a finite slope, so the exponent is 1 here and the switching gain 0.

law = replace(Mission.of_case(1), exponent=1.0, switching_gain=0.0)
loop = transport_diagram(law, SpaceTruss.published())
loop.draw("loop.svg")

# %%
# An operating point
# ------------------
#
# ``trim`` finds states and inputs at which nothing changes. Here the forces and torques of the actuators are
# given, all zero, and the truss rests. For this plant the answer is known; an aircraft needs the search
# (:doc:`example </gallery/loops/trim_aircraft>`).

plant = SpaceTruss.published()
point = trim(plant, inputs={"actuation": [0.0] * plant.actuators})
point

# %%
# Long arrays are shortened. ``point.residual`` is the largest violation of an equation, here zero. ``point.report`` has
# a row for each element, with its rate of change.

# %%
# Modes of the plant
# ------------------
#
# ``linearize`` differentiates the equations exactly, without finite differences. ``modal_table`` lists the
# oscillating poles of the linear model, and the inputs that drive each mode most:

modal_table(plant, "actuation")

# %%
# The damping is zero, as the paper has no number for it. The elements 24 to 51 are joint torques, which drive the
# modes 1 to 4 most. The modes 5 and 6 are driven by forces of the bases.

# %%
# Margins of the loop
# -------------------
#
# ``loop_margins`` opens the closed loop at a wire. The elements 18 to 23 are the forces and torques of base 4.
# Each row opens one of them and keeps all others closed. A gain of "-inf to inf dB" means that no gain makes the
# loop unstable.

loop_margins(loop, loop.truss.actuation[18:24])

# %%
# Gain and phase look excellent, but the force along z (element 20) tolerates only 1.3 ms of delay. Its loop
# crosses at a high frequency, where a small delay is a large phase. A computer that holds its commands adds such a
# delay. :doc:`Tutorial 3 </gallery/03_sampled_control>` returns to this number.
#
# The disk margin in the title holds for changes of gain and phase in all six channels at once.

# %%
# The modal loop
# --------------
#
# By Eq. 42 of the paper the actuators also push the modes of the truss. In the plant this force is a wire, from
# ``modal_demand`` to ``modal_force``. The paper leaves it out. One line closes it:

loop.truss.modal_demand >> loop.truss.modal_force
loop.draw("modal_loop.svg")
poles = linearize(loop, ["truss.modal_force"], ["truss.modal_demand"]).poles()
print("fastest growth", poles.real.max().round(2), "1/s")

# %%
# A positive real part is an unstable loop: a vibration grows by a factor of e in 0.09 s. The Bode plot shows the
# loop through each mode, the others closed. An unstable loop has no margins, so the title lists the unstable
# poles.

figure = modal_bode(loop, "truss.modal_force")

# %%
# A loop with margins
# -------------------
#
# Damping stabilizes the loop. ``consistent()`` is the plant with exact integrals over the truss; here each mode of
# the clamped truss gets 10 % of damping. Every loop through a mode then has margins:

damped = transport_diagram(
    law, SpaceTruss.consistent(damping=0.1), allocation="published"
)
figure = modal_bode(damped, "truss.modal_force")

# %%
# The legend names the mode that each element drives most. The modes of the plant, with robots, have up to 66 % of
# damping. Real trusses have about 0.5 %, so that damping alone is no remedy. The other remedy is an allocation
# whose forces do no work on the modes, ``allocation="mode-neutral"``.

# %%
# To try
# ------
#
# * ``loop_transfer(loop, port)`` returns the loop gain as a python-control model, for ``control.nyquist_plot``
#   (:doc:`example </gallery/loops/margins>`).
# * ``loop_margins(damped, "truss.modal_force")`` gives the margins of the last plot as a table.
# * ``trussflow analyse script.py:loop --at truss.modal_force`` prints modes and margins of any diagram.
