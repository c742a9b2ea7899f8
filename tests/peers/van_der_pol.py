"""
Van der Pol's oscillator (bdsim)
================================

x'' = μ (1 - x²) x' - x. For μ = 1 amplitude and period of the limit cycle are known to many digits:
begun on it, the oscillator is back after one period. bdsim: ``vanderpol.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, simulate

amplitude, period = 2.0086198608748431, 6.6632868593231302
oscillator = Diagram("oscillator")
v, x = oscillator.add(v=Integrator(), x=Integrator(amplitude))
((1.0 - x.y**2) * v.y - x.y) >> v >> x
back = simulate(
    oscillator, period, solver="DOP853", rtol=1e-12, atol=1e-12, log_step=period
)
end = [float(back["x.y"][-1]), float(back["v.y"][-1])]
print("after one period", end)
assert np.allclose(end, [amplitude, 0.0], rtol=0.0, atol=1e-9)
