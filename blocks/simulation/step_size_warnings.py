"""Warnings of fixed steps that are too long: missed jumps and numerically unstable results."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.support.call_site import warn
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.plan import Plan

if TYPE_CHECKING:
    from trussflow.blocks.simulation.run import Run

MAX_CHECKED_BREAKPOINTS = 100
"""Break points of one block that are checked for a jump of its output; tables have many [-]."""

MIN_CHECKED_SIZE = 1e12
"""Modulus of a state above which the step size is checked as its cause [as declared]."""

MAX_RELATIVE_CHANGE = 2.0
"""Largest change of the largest state within a step, by its rate, relative to its size [-]: at the limit
of stability of RK4 it is 2.8, of Euler's method 2. An accurately integrated unstable mode changes far less."""


def warn_of_missed_jumps(
    plan: Plan, step: Fraction, span: tuple[Fraction, Fraction], p: Vector
) -> None:
    """Warn if a source of a `plan` with parameters `p` jumps between two steps of a fixed-step solver.

    Parameters
    ----------
    plan : Plan
        Prepared diagram.
    step : Fraction
        Length of a step [s].
    span : tuple of Fraction
        Initial and final time of the run [s].
    p : Vector
        Parameters [as declared].
    """
    if not plan.x.size:
        return
    sources = [d.source for drivers in plan.system.drivers.values() for d in drivers]
    read = {
        (source.block.path, source.name) for source in sources if source is not None
    }
    for path, block in plan.system.blocks.items():
        if (
            block.inputs()
            or block.states()
            or not block.traced
            or block.sample_time is not None
        ):
            continue
        off = [
            b
            for b in breakpoints_of(block)
            if span[0] < b < span[1] and (b / step).denominator != 1
        ]
        # A jump at a whole number of steps is exact: the last stage
        # is just before the step's end.
        for time in off[:MAX_CHECKED_BREAKPOINTS]:
            name = _jumping(block, float(time), plan.p.signals(path, p))
            if (path, name) in read:
                warn(
                    f"'{path}.{name}' jumps at t = {float(time):g} s, within a step of {float(step):g} s: "
                    "the states it drives are as if it jumped earlier or later. Take a step that divides "
                    "this time, or an adaptive solver"
                )
                break


def _jumping(block: Block, time: float, p: Signals) -> str:
    """Return the first output of a source that jumps at a time; empty if none does."""
    nothing = Signals(p.owner, {})
    before, after = (
        block.output(np.asarray(t), nothing, nothing, p)
        for t in (math.nextafter(time, -math.inf), time)
    )
    for name, value in after.items():
        scale = max(
            np.abs(value).max(initial=0.0), np.abs(before[name]).max(initial=0.0)
        )
        # Round-off between the two sides of a break point is no jump.
        if not np.allclose(
            before[name], value, rtol=0.0, atol=1e-9 * scale, equal_nan=True
        ):
            return name
    return ""


def breakpoints_of(block: Block) -> list[Fraction]:
    """Return the break points of a block.

    Raises
    ------
    SimulationError
        If they are no times.
    """
    points = block.breakpoints()
    try:
        return [exact(point) for point in points]
    except (TypeError, ValueError, OverflowError):
        raise SimulationError(
            f"breakpoints() of block '{block.path}' returned {points}; times must be finite numbers"
        ) from None


def warn_of_coarse_steps(run: Run) -> None:
    """Warn if the largest state at the end of a `run` is huge, and would change by more than itself."""
    step = run.prepared.step
    sizes = np.abs(run.x)
    if (
        step is None
        or not sizes.size
        or (size := float(sizes.max())) < MIN_CHECKED_SIZE
    ):
        return
    worst = int(sizes.argmax())
    rate = run.executor.call("derivative", run.time, run.x, run.d, run.p)[worst]
    if abs(rate) * float(step) > MAX_RELATIVE_CHANGE * size:
        warn(
            f"{run.prepared.plan.x.describe(worst)} ends at {run.x[worst]:.3g}, and would change by more "
            f"than itself within one step of {float(step):g} s: steps are too long for these equations, and "
            "the result is no solution of them. Take a smaller step, or an adaptive or stiff solver"
        )
