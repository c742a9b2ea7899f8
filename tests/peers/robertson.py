"""
Robertson's reaction (PathSim)
==============================

Three species, rates that differ by nine orders of magnitude. The state at 10¹¹ s is published with the
test set for initial value problems of Mazzia and Magherini. PathSim: ``example_robertson.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, as_block, simulate


@as_block
def reaction(x):
    """Return the rates of the three concentrations."""
    slow, fast = 0.04 * x[0] - 1e4 * x[1] * x[2], 3e7 * x[1] ** 2
    return np.stack([-slow, slow - fast, fast])


reactor = Diagram("reactor")
x = reactor.add(x=Integrator([1.0, 0.0, 0.0]))
reaction(x) >> x
end = simulate(reactor, 1e11, solver="Rodas5P", rtol=1e-9, atol=1e-18, log_step=1e11)[
    "x.y"
][-1].values
published = [0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050]
print("concentrations at 1e11 s", end, "relative error", abs(end / published - 1).max())
assert np.allclose(end, published, rtol=1e-6, atol=0.0)
