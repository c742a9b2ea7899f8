"""A sweep of 10,000 samples of 500 steps of three states, and the same loop by hand in numba."""

from __future__ import annotations

import numba
import numpy as np

from trussflow.blocks import Block, Diagram, Output, Parameter, State, sweep

STEP, STEPS = 0.01, 500
RHO = np.linspace(10.0, 30.0, 10_000)


class Lorenz(Block):
    """Equations of Lorenz (1963)."""

    y = Output(3)
    x = State(3, initial=(1.0, 1.0, 1.0))
    rho = Parameter(28.0)

    def output(self, t, x, u, p):
        """Return the states."""
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        """Return the rates of convection and of the two temperatures."""
        a, b, c = x.x
        return {
            "x": np.stack([10.0 * (b - a), a * (p.rho - c) - b, a * b - 8.0 / 3.0 * c])
        }


def swept():
    """Return the last states of all samples."""
    diagram = Diagram("lorenz")
    diagram.add(lorenz=Lorenz())
    settings = {"step": STEP, "executor": "serial", "progress": False}
    keep = {"end": ("lorenz.y", "final")}
    return sweep(diagram, STEPS * STEP, vary={"lorenz.rho": RHO}, keep=keep, **settings)


@numba.njit
def rates(a, b, c, rho):
    """Return the rates of the three states."""
    return 10.0 * (b - a), a * (rho - c) - b, a * b - 8.0 / 3.0 * c


@numba.njit
def by_hand(rhos=RHO, h=STEP, steps=STEPS):
    """Return the last states of all samples, by RK4."""
    ends = np.empty((rhos.size, 3))
    for i in range(rhos.size):
        r = rhos[i]
        x, y, z = 1.0, 1.0, 1.0
        for _ in range(steps):
            p, q, w = rates(x, y, z, r)
            P, Q, W = rates(x + h / 2 * p, y + h / 2 * q, z + h / 2 * w, r)
            p, q, w = p + 2.0 * P, q + 2.0 * Q, w + 2.0 * W
            P, Q, W = rates(x + h / 2 * P, y + h / 2 * Q, z + h / 2 * W, r)
            p, q, w = p + 2.0 * P, q + 2.0 * Q, w + 2.0 * W
            P, Q, W = rates(x + h * P, y + h * Q, z + h * W, r)
            x += h / 6 * (p + P)
            y += h / 6 * (q + Q)
            z += h / 6 * (w + W)
        ends[i, 0], ends[i, 1], ends[i, 2] = x, y, z
    return ends
