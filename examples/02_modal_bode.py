"""
Bode plot and margins of the truss
==================================

The control loop of a mission, opened at the force that it demands. The modal loop, from the force on a mode
back to that force, is in the README and in ``trussflow analyse``.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import delay_margin, linearize, loop_transfer
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

omega = np.geomspace(0.1, 1e3, 2000)  # rad/s

# The plant: base force of Robot 4 along z to the six modes, from exact Jacobians.
truss = SpaceTruss.consistent()
plant = linearize(truss, ["actuation[20]"], ["modal_coordinate"])

# The loop opened at the demand along z, all others closed. The powers |x|^0.9 of the ISMC have no derivative
# at zero, so describing functions are used, for errors of 1 mm or 1 mrad oscillating at 1 rad/s.
diagram = transport_diagram(Mission.of_case(1), SpaceTruss.consistent())
amplitude = {"controller.position": 1e-3, "controller.velocity": 1e-3}
amplitude["controller.integral"] = 2.2e-3  # integral that results from these two
loop = loop_transfer(diagram, "feedback_allocation.demand[2]", amplitude=amplitude)

figure, (upper, lower) = plt.subplots(2, 1, figsize=(7, 7), layout="constrained")
for k, gain in enumerate(plant(1j * omega, squeeze=False)[:, 0], 1):
    upper.loglog(omega, abs(gain), label=f"mode {k}")
upper.set(ylabel="force to mode [kg^½·m/N]", title="plant")
lower.loglog(omega, abs(loop(1j * omega)), color="black")
lower.axhline(1, color="grey")
lower.set(xlabel="frequency [rad/s]", ylabel="loop gain [-]", title="loop at the demand along z")
upper.legend(ncols=3)
figure.savefig("bode.png")

data = control.FrequencyResponseData(loop(1j * omega), omega, smooth=True)
gain, phase, _, at_phase, at_gain, _ = control.stability_margins(data)
delay, _ = delay_margin(loop, omega=omega)
print(f"gain margin  {20 * np.log10(gain):6.1f} dB  at {at_phase:.3g} rad/s")
print(f"phase margin {phase:6.1f} deg at {at_gain:.3g} rad/s")
print(f"delay margin {1e3 * delay:6.1f} ms")
