"""
A block of your own
===================

An oscillator with its equations in plain NumPy, compared with the exact solution.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Block, Diagram, Input, Output, Parameter, State, simulate
from trussflow.blocks.testing import check_block


class Oscillator(Block):
    """Mass on a spring."""

    force = Input(unit="N", meaning="force on the mass")
    position = Output(unit="m", meaning="position of the mass")
    q = State(unit="m", initial=1.0)
    v = State(unit="m/s")
    stiffness = Parameter(4.0, unit="N/m", above=0.0)

    def output(self, t, x, u, p):
        """Return the position."""
        return {"position": x.q}

    def derivative(self, t, x, u, p):
        """Return velocity and acceleration of a mass of 1 kg."""
        return {"q": x.v, "v": u.force - p.stiffness * x.q}


# %%
# `check_block` reports each check; for each fault it states the remedy.

print(check_block(Oscillator()))

# %%
diagram = Diagram("free vibration")
mass = diagram.add(mass=Oscillator())
diagram.ground(mass.force)

# %%
for backend in ("compiled", "interpreted", "numpy"):
    result = simulate(diagram, 10.0, step=1e-2, backend=backend)
    error = abs(
        result["mass.position"].values - np.cos(2.0 * result["time"].values)
    ).max()
    print(f"{backend:12s} largest error {error:.1e} m")

# %%
plt.plot(result["time"], result["mass.position"], label="4 N/m")
softer = simulate(diagram, 10.0, step=1e-2, parameters={"mass.stiffness": 1.0})
print(
    "stiffness 1 N/m, nothing compiled again:",
    softer["mass.position"][-1].values.round(4),
    "m",
)
plt.plot(softer["time"], softer["mass.position"], label="1 N/m")
plt.gca().set(xlabel="time [s]", ylabel="position [m]")
plt.legend(loc="upper right", bbox_to_anchor=(1.0, 1.12), ncols=2)
plt.show()
