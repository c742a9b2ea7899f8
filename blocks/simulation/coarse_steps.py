"""Fixed steps that are too long by far: what they end with is finite, and huge, and no solution."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.call_site import warn
from trussflow.blocks.simulation.run import Run

MIN_CHECKED_SIZE = 1e12
"""Modulus of a state above which the step size is checked as its cause [as declared]."""

MAX_RELATIVE_CHANGE = 2.0
"""Largest change of the largest state within a step, by its rate, relative to its size [-]: at the limit
of stability of RK4 it is 2.8, of Euler's method 2. What grows by itself and is followed changes far less."""


def warn_of_coarse_steps(run: Run) -> None:
    """Warn if the largest state at the end of a `run` is huge, and would change by more than itself."""
    step, sizes = run.prepared.step, np.abs(run.x)
    if step is None or not sizes.size or (size := float(sizes.max())) < MIN_CHECKED_SIZE:
        return
    worst = int(sizes.argmax())
    rate = run.executor.call("derivative", run.time, run.x, run.d, run.p)[worst]
    if abs(rate) * float(step) > MAX_RELATIVE_CHANGE * size:
        entry = run.prepared.plan.x.at(worst)
        warn(
            f"{entry.describe(worst - entry.start)} ends at {run.x[worst]:.3g}, and would change by more "
            f"than itself within one step of {float(step):g} s: steps are too long for these equations, and "
            "the result is no solution of them. Take a smaller step, or an adaptive or stiff solver"
        )
