"""
A flame that ignites (PathSim)
==============================

The radius of a ball of flame, y' = y² - y³, waits for 1/δ seconds and then jumps to 1: stiff. Exactly,
y = 1 / (1 + ω(ln a + a - t)) with a = 1/δ - 1 and Wright's ω. PathSim: ``example_flame.py``.
"""

import numpy as np
from scipy.special import wrightomega

from trussflow.blocks import Diagram, Integrator, simulate

delta = 1e-4
flame = Diagram("flame")
y = flame.add(y=Integrator(delta)).y
(y**2 - y**3) >> flame.y.u
result = simulate(
    flame, 2 / delta, solver="Rodas5P", rtol=1e-8, atol=1e-12, log_step=10.0
)
a = 1 / delta - 1
error = float(
    abs(result["y.y"] - 1 / (1 + wrightomega(np.log(a) + a - result["time"]))).max()
)
print(f"largest error of the radius {error:.1e}")
assert error < 1e-4
