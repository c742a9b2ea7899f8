"""
Lorenz's convection, where it turns over (PathSim)
==================================================

Its steady rolls are stable until ρ = σ (σ + β + 3) / (σ - β - 1); there two poles cross the imaginary
axis, at ± i √(2 σ (σ + 1) / (σ - β - 1) β). For β = 2 σ, x² - 2 σ z decays as exp(-2 σ t). PathSim:
``example_lorenz.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Ground, Integrator, linearize, simulate


def lorenz(sigma, rho, beta, start):
    """Return the system."""
    air = Diagram("air")
    heat = air.add(heat=Ground())
    x, y, z = air.add(
        x=Integrator(start[0]), y=Integrator(start[1]), z=Integrator(start[2])
    )
    sigma * (y.y - x.y) + heat.y >> x
    x.y * (rho - z.y) - y.y >> y
    x.y * y.y - beta * z.y >> z
    return air


sigma, beta = 10.0, 8 / 3
rho = sigma * (sigma + beta + 3) / (sigma - beta - 1)
steady = np.sqrt(beta * (rho - 1))
rolls = lorenz(sigma, rho, beta, [steady, steady, rho - 1])
poles = linearize(rolls, "heat.y", "x.y").poles()
exact = np.sqrt(2 * sigma * (sigma + 1) * beta / (sigma - beta - 1))
print("poles", np.round(poles, 6), "and by the law", np.round(exact, 6))
assert np.allclose(sorted(poles.imag), [-exact, 0.0, exact], rtol=1e-9, atol=1e-9)
assert abs(sorted(poles.real)[1]) < 1e-9

run = simulate(
    lorenz(10.0, 28.0, 20.0, [1.0, 1.0, 1.0]),
    1.0,
    solver="DOP853",
    rtol=1e-11,
    atol=1e-11,
)
decays = run["x.y"] ** 2 - 20.0 * run["z.y"]
assert np.allclose(decays, -19.0 * np.exp(-20.0 * run["time"]), rtol=0.0, atol=1e-7)
