"""
Model reference adaptive control (python-control)
=================================================

Two gains are adapted until the plant x' = -x + u / 2 follows the model x_m' = -2 x_m + 2 r. Lyapunov's
function e² / 2 + ((k_r - 4)² + (k_x + 2)²) / (4 γ) decreases at the rate 2 e².
python-control: ``mrac_siso_lyapunov.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, Pulse, simulate

gamma = 1.0
loop = Diagram("adaptive loop")
r, x, model = loop.add(
    r=Pulse(20.0, high=1.0, low=-1.0), x=Integrator(), model=Integrator()
)
k_r, k_x, lost = loop.add(k_r=Integrator(), k_x=Integrator(), lost=Integrator())
e = model.y - x.y
0.5 * (k_r.y * r.y + k_x.y * x.y) - x.y >> x
2.0 * r.y - 2.0 * model.y >> model
gamma * r.y * e >> k_r
gamma * x.y * e >> k_x
2.0 * e**2 >> lost
run = simulate(loop, 100.0, solver="DOP853", rtol=1e-10, atol=1e-10, log_step=0.1)
gains = 0.5 * ((run["k_r.y"] - 4) ** 2 + (run["k_x.y"] + 2) ** 2) / (2 * gamma)
kept = ((run["model.y"] - run["x.y"]) ** 2 / 2 + gains + run["lost.y"]).values
learnt = [round(float(run[gain][-1]), 3) for gain in ("k_r.y", "k_x.y")]
print(f"gains {learnt}; the sum varies by {np.ptp(kept):.1e}")
assert np.ptp(kept) < 1e-8
