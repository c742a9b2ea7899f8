"""
Uncertain parameters and the worst case
=======================================

A motor turns an antenna through an elastic shaft. The shaft's stiffness is known to 20 %, the antenna's
inertia to 10 %, the damping to a factor of four. ``uncertain`` makes a linear fractional model,
``worst_gain`` finds the largest gain: a member that reaches it, and a bound that no member exceeds.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Block, Diagram, Gain, Input, Output, Parameter, State
from trussflow.blocks.linear_analysis.uncertainty import (
    robust_stability,
    uncertain,
    worst_gain,
)


class Antenna(Block):
    """Motor, shaft and antenna."""

    torque = Input(unit="N*m")
    angles = Output(2, unit="rad")
    rates = Output(2, unit="rad/s")
    angle = State(2, unit="rad")
    rate = State(2, unit="rad/s")
    stiffness = Parameter(40.0, unit="N*m/rad")
    damping = Parameter(0.05, unit="N*m*s/rad")
    inertia = Parameter(0.4, unit="kg*m**2")

    def output(self, t, x, u, p):
        """Return angles and rates of motor and antenna."""
        return {"angles": x.angle, "rates": x.rate}

    def derivative(self, t, x, u, p):
        """Return the rates of both, with a motor of 0.1 kg m²."""
        twist = p.stiffness * (x.angle[0] - x.angle[1]) + p.damping * (
            x.rate[0] - x.rate[1]
        )
        return {
            "angle": x.rate,
            "rate": np.stack([(u.torque - twist) / 0.1, twist / p.inertia]),
        }


loop = Diagram("antenna")
antenna, angle, rate = loop.add(
    antenna=Antenna(),
    angle=Gain(-2.0, output_unit="N*m"),
    rate=Gain(-1.2, output_unit="N*m"),
)
antenna.angles[0] >> angle.u
antenna.rates[0] >> rate.u
angle.y + rate.y >> antenna.torque

# %%
# From motor torque to antenna motion. The model is made from exact Jacobians at the ends of all ranges; its
# misfit is the neglected part of the parameters' influence.

ranges = {
    "antenna.stiffness": 0.2,
    "antenna.inertia": 0.1,
    "antenna.damping": (0.025, 0.1),
}
model = uncertain(loop, "antenna.torque", "antenna.angles[1]", ranges)
print(
    f"the parameters stand {model.fractions.sizes} times in the model, which misses {model.misfit:.1%}"
)

# %%
# Responses of fifty members, and the bound for all members, within ten per cent:

omega = np.geomspace(1.0, 60.0, 40)
worst = worst_gain(model, omega, tolerance=0.1)
for delta in np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3)):
    plt.loglog(omega, abs(model.family(delta)(1j * omega, squeeze=True)), color="0.8")
plt.loglog(omega, worst.bound, "k--", label="none exceeds this")
plt.loglog(
    omega,
    worst.reached,
    "o",
    label="some member reaches this, such as worst.parameters[0]",
)
plt.gca().set(
    xlabel="frequency [rad/s]", ylabel="antenna's angle per torque [rad/(N m)]"
)
plt.legend()
plt.show()

# %%
# Distance to instability: with S the peak of the sensitivity over all members, each has a phase margin of at
# least 2 asin(1 / 2S).

most = max(
    worst_gain(uncertain(loop, "antenna.torque", "antenna.torque", ranges), omega).bound
)
print(
    f"S is at most {most:.2f}: {np.degrees(2.0 * np.arcsin(0.5 / most)):.0f} degrees for every member"
)

# %%
# Poles of fifty members, and the line that no pole of any member crosses:

poles = np.concatenate(
    [model.family(d).poles() for d in np.random.default_rng(0).uniform(-1, 1, (50, 3))]
)
plt.plot(poles.real, poles.imag, ".", markersize=3)
print(robust_stability(model, decay=0.9 * min(-poles.real)))
plt.axvline(0.9 * max(poles.real), color="k", linestyle="--")
plt.xlabel("real part [1/s]")
plt.ylabel("imaginary part [rad/s]")
plt.show()
