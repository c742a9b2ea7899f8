"""The two loops of the overhead benchmarks, as trussflow blocks and written by hand in numba.

Job A: an oscillator (m = 1, k = 4, c = 0.2) under a PD law (20, 3), step reference. Job B: a
chain of 40 masses with full stiffness and damping matrices, 80 states, a PD law on each
channel. Both: RK4, 1 ms, position, velocity and force logged at each step.
"""

from __future__ import annotations

import numba
import numpy as np

from trussflow.blocks import Block, Diagram, Input, Output, Parameter, State

STEP = 1e-3


class Oscillator(Block):
    """Mass, spring and damper."""

    force = Input(unit="N", meaning="force on the mass")
    position = Output(unit="m", meaning="position")
    velocity = Output(unit="m/s", meaning="velocity")
    q = State(unit="m")
    v = State(unit="m/s")
    stiffness = Parameter(4.0, unit="N/m")
    damping = Parameter(0.2, unit="N*s/m")

    def output(self, t, x, u, p):
        """Return position and velocity."""
        return {"position": x.q, "velocity": x.v}

    def derivative(self, t, x, u, p):
        """Return velocity and acceleration."""
        return {"q": x.v, "v": u.force - p.stiffness * x.q - p.damping * x.v}


class Chain(Block):
    """Forty masses of 1 kg with full stiffness and damping matrices."""

    force = Input(40, unit="N", meaning="force on each mass")
    position = Output(40, unit="m", meaning="positions")
    velocity = Output(40, unit="m/s", meaning="velocities")
    q = State(40, unit="m")
    v = State(40, unit="m/s")

    def __init__(self, stiffness, damping):
        self.stiffness, self.damping = stiffness, damping
        super().__init__()

    def output(self, t, x, u, p):
        """Return positions and velocities."""
        return {"position": x.q, "velocity": x.v}

    def derivative(self, t, x, u, p):
        """Return velocities and accelerations."""
        return {"q": x.v, "v": u.force - self.stiffness @ x.q - self.damping @ x.v}


class PositionControl(Block):
    """PD law towards a constant reference."""

    position = Input("size", unit="m", meaning="measured position")
    velocity = Input("size", unit="m/s", meaning="measured velocity")
    force = Output("size", unit="N", meaning="commanded force")
    reference = Parameter(1.0, unit="m")
    k_p = Parameter(20.0, unit="N/m")
    k_d = Parameter(3.0, unit="N*s/m")

    def __init__(self, size, **gains):
        self.size = size
        super().__init__(**gains)

    def output(self, t, x, u, p):
        """Return the force."""
        return {"force": p.k_p * (p.reference - u.position) - p.k_d * u.velocity}


def loop(plant, size, **gains):
    """Close the loop of a plant and a PD law."""
    diagram = Diagram("loop")
    diagram.add(plant=plant, control=PositionControl(size, **gains))
    diagram.plant.position >> diagram.control.position
    diagram.plant.velocity >> diagram.control.velocity
    diagram.control.force >> diagram.plant.force
    return diagram


def chain_matrices():
    """Return full, symmetric, positive definite stiffness and damping matrices."""
    springs = 2 * np.eye(40) - np.eye(40, k=1) - np.eye(40, k=-1)
    mixed = np.random.default_rng(0).standard_normal((40, 40)) * 0.05
    stiffness = 400 * springs + mixed @ mixed.T
    return stiffness, 0.002 * stiffness


@numba.njit(cache=False)
def oscillator_by_hand(steps, h):
    """Job A by hand."""
    log = np.empty((steps, 3))
    q, v = 0.0, 0.0
    for k in range(steps):
        log[k, 0], log[k, 1], log[k, 2] = q, v, 20.0 * (1.0 - q) - 3.0 * v
        k1q, k1v = v, 20.0 * (1.0 - q) - 3.0 * v - 4.0 * q - 0.2 * v
        a, b = q + h / 2 * k1q, v + h / 2 * k1v
        k2q, k2v = b, 20.0 * (1.0 - a) - 3.0 * b - 4.0 * a - 0.2 * b
        a, b = q + h / 2 * k2q, v + h / 2 * k2v
        k3q, k3v = b, 20.0 * (1.0 - a) - 3.0 * b - 4.0 * a - 0.2 * b
        a, b = q + h * k3q, v + h * k3v
        k4q, k4v = b, 20.0 * (1.0 - a) - 3.0 * b - 4.0 * a - 0.2 * b
        q += h / 6 * (k1q + 2 * k2q + 2 * k3q + k4q)
        v += h / 6 * (k1v + 2 * k2v + 2 * k3v + k4v)
    return log, q, v


@numba.njit(cache=False)
def chain_by_hand(steps, h, stiffness, damping):
    """Job B by hand, matrix products by BLAS."""
    log = np.empty((steps, 120))
    x = np.zeros(80)
    stage = np.empty(80)
    rates = np.empty((4, 80))
    for k in range(steps):
        log[k, :80] = x
        log[k, 80:] = 20.0 * (1.0 - x[:40]) - 3.0 * x[40:]
        stage[:] = x
        for i in range(4):
            q, v = stage[:40], stage[40:]
            rates[i, :40] = v
            rates[i, 40:] = 20.0 * (1.0 - q) - 3.0 * v - stiffness @ q - damping @ v
            if i < 3:
                stage[:] = x + (h if i == 2 else h / 2) * rates[i]
        x += h / 6 * (rates[0] + 2 * rates[1] + 2 * rates[2] + rates[3])
    return log, x
