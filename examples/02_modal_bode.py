"""
Bode plot of the modal loop
===========================

The actuators of the paper's loop also push the modes of the truss (Eq. 42). In the plant this force is a
wire, from ``modal_demand`` to ``modal_force``. The paper leaves it out.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

from trussflow.blocks import linearize, modal_bode, modal_table
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

# The published law has an infinite slope at zero error; here its exponent is 1, and it does not switch.
law = replace(Mission.of_case(1), exponent=1.0, switching_gain=0.0)
truss = SpaceTruss.consistent()
print(modal_table(truss))

# %%
# With the published allocation the loop is unstable: the wire closes loops through lightly damped modes.

loop = transport_diagram(law, truss, allocation="published")
loop.draw("modal_wire.svg")
poles = linearize(loop, ["truss.modal_force"], ["truss.modal_demand"]).poles()
print("fastest growth", poles.real.max(), "1/s")
modal_bode(loop, "truss.modal_force").savefig("bode.png")
plt.show()

# %%
# With 10 % of damping in each mode of the clamped truss it is stable, and each element has margins. The modes of
# the plant, with robots, have up to 66 %; the legend names the one that each element drives most.

damped = transport_diagram(
    law, SpaceTruss.consistent(damping=0.1), allocation="published"
)
modal_bode(damped, "truss.modal_force")
plt.show()
