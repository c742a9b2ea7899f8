"""
A genetic toggle switch (python-control)
========================================

Two genes that suppress each other: u' = μ / (1 + v²) - u, v' = μ / (1 + u²) - v. With μ = 4 the
equilibria are u, v = 2 ± √3 in either order. python-control: ``genswitch.py``.
"""

import numpy as np

from trussflow.blocks import Diagram, Integrator, simulate

cell = Diagram("cell")
u, v = cell.add(u=Integrator(1.0), v=Integrator(5.0))
4.0 / (1.0 + v.y**2) - u.y >> u
4.0 / (1.0 + u.y**2) - v.y >> v
for start, sign in (([1.0, 5.0], -1), ([5.0, 1.0], 1)):
    run = simulate(
        cell, 60.0, step=0.01, initial={"u.integral": start[0], "v.integral": start[1]}
    )
    end = [float(run["u.y"][-1]), float(run["v.y"][-1])]
    print(end)
    assert np.allclose(
        end, [2 + sign * np.sqrt(3), 2 - sign * np.sqrt(3)], rtol=0.0, atol=1e-10
    )
