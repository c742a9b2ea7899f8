"""
Foxes and hares, until there are few (PathSim)
==============================================

Lotka and Volterra's x' = x (α - β y), y' = y (δ x - γ); the run ends where y rises through 4. All the
time δ x - γ ln x + β y - α ln y stays what it was. PathSim: ``example_volterralotka_event.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, StopWhen, simulate

alpha, beta, delta, gamma = 1.0, 0.1, 0.5, 1.2
island = Diagram("island")
hares, foxes, enough = island.add(
    hares=Integrator(5.0), foxes=Integrator(10.0), enough=StopWhen("again")
)
hares.y * (alpha - beta * foxes.y) >> hares
foxes.y * (delta * hares.y - gamma) >> foxes
foxes.y - 4.0 >> enough
result = simulate(island, 20.0, solver="DOP853", rtol=1e-10, atol=1e-10, log_step=0.01)
x, y = result["hares.y"], result["foxes.y"]
kept = (delta * x - gamma * np.log(x) + beta * y - alpha * np.log(y)).values
print(f"{result.attrs['ended']}; what is kept varies by {np.ptp(kept):.1e}")
assert np.ptp(kept) < 1e-8
assert abs(y[-1] - 4.0) < 0.01
