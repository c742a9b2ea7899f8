"""
Solvers and steps
=================

Fixed steps by Runge-Kutta (fourth order) or Euler (first order), or SciPy's adaptive solvers, on an
oscillator with an exact solution. Errors decrease with the order of the method, down to round-off.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Diagram, StateSpace, simulate

swing = Diagram("swing")
swing.add(mass=StateSpace([[0, 1], [-4, 0]], [[0], [1]], [[1, 0]], [[0]], initial_value=[1.0, 0.0]))
swing.ground(swing.mass.u)


def error_of(result):
    """Return the largest difference from cos 2t."""
    return float(abs(result["mass.y"][:, 0] - np.cos(2 * result["time"])).max())


steps = np.array([0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001])
for solver in ("euler", "rk4"):
    errors = [error_of(simulate(swing, 10.0, step=step, solver=solver)) for step in steps]
    plt.loglog(steps, errors, "o-", label=solver)
    print(f"{solver}: order {np.polyfit(np.log(steps[2:5]), np.log(errors[2:5]), 1)[0]:.2f}")
plt.gca().set(xlabel="step [s]", ylabel="largest error")
plt.legend()
plt.show()

# %%
# Adaptive solvers have tolerances instead of a step:

for solver in ("RK45", "DOP853", "LSODA", "Radau"):
    begun = time.perf_counter()
    result = simulate(swing, 10.0, solver=solver, rtol=1e-8, atol=1e-10, log_step=0.1)
    print(f"{solver:7} error {error_of(result):.1e} in {1e3 * (time.perf_counter() - begun):.0f} ms")
