"""
A pendulum on a spring (PathSim)
================================

A mass on a spring swings; friction damps both motions. The remaining energy and the energy
dissipated add up to the initial energy. PathSim: ``example_elastic_pendulum.py``.
"""

import numpy as np

from trussflow.blocks import Block, Diagram, EnergyAccount, Output, State
from trussflow.blocks.testing import energy_audit

g, l0, k, m, c_r, c_phi = 9.81, 1.0, 50.0, 1.0, 0.3, 0.1


class Pendulum(Block):
    """Length and angle."""

    energy, loss = Output(unit="J"), Output(unit="W")
    r, vr, phi, w = State(initial=2.0), State(), State(initial=0.3 * np.pi), State()
    energy_account = EnergyAccount(stored="energy", dissipated="loss")

    def output(self, t, x, u, p):
        """Return the energy and the power of friction."""
        kinetic = m * (x.vr**2 + (x.r * x.w) ** 2) / 2
        energy = kinetic + k * (x.r - l0) ** 2 / 2 - m * g * x.r * np.cos(x.phi)
        return {"energy": energy, "loss": c_r * x.vr**2 + c_phi * x.w**2}

    def derivative(self, t, x, u, p):
        """Return velocities and accelerations in polar coordinates."""
        radial = x.r * x.w**2 + g * np.cos(x.phi) - (k * (x.r - l0) + c_r * x.vr) / m
        turning = -(g * np.sin(x.phi) + 2 * x.vr * x.w) / x.r - c_phi * x.w / (
            m * x.r**2
        )
        return {"r": x.vr, "vr": radial, "phi": x.w, "w": turning}


room = Diagram("room")
room.add(pendulum=Pendulum())
audit = energy_audit(room, 10.0, step=1e-3)
print(audit)
audit.raise_for_missing(1e-8)
