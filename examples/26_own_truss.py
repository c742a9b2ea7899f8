"""
A truss of your own
===================

A truss is data: stiffer, heavier, with a payload, or from your own finite elements as a ``TrussModes``. In a
``TunableTruss`` these data are parameters, so one compiled program simulates every Monte Carlo sample.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.models import TrussModes, loaded, scaled

truss = TrussModes.reconstructed()
corner = truss.positions[np.argmax(truss.positions[:, 0])]
draws = {
    "as in the paper": truss,
    "10 % heavier": scaled(truss, mass=1.1),
    "10 % stiffer": scaled(truss, frequency=np.sqrt(1.1)),
    "20 kg at a corner": loaded(truss, corner, 20.0),
    "100 kg at a corner": loaded(truss, corner, 100.0),
}
for k, (name, one) in enumerate(draws.items()):
    plt.plot(np.arange(1, 7) + 0.1 * k - 0.2, one.frequencies[:6], "o", label=name)
    print(f"{name:20} {one.masses.sum():6.1f} kg, first {one.frequencies[0]:.4f} Hz")
plt.gca().set(xlabel="mode", ylabel="frequency [Hz]")
plt.legend()
plt.show()
