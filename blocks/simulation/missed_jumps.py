"""Break points: where outputs are not smooth, and jumps there that fixed steps would miss."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.call_site import warn
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.tracing.plan import Plan

MOST_LOOKED_AT = 100
"""Break points of one block of which it is looked up whether the output jumps: tables have many."""


def warn_of_missed_jumps(plan: Plan, step: Fraction, span: tuple[Fraction, Fraction], p: Vector) -> None:
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
    read = {(source.block.path, source.name) for source in sources if source is not None}
    for path, block in plan.system.blocks.items():
        if block.inputs() or block.states() or not block.traced or block.sample_time is not None:
            continue
        off = [b for b in breakpoints_of(block) if span[0] < b < span[1] and (b / step).denominator != 1]
        for time in off[:MOST_LOOKED_AT]:
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
        block.output(np.asarray(t), nothing, nothing, p) for t in (math.nextafter(time, -math.inf), time)
    )
    for name, value in after.items():
        scale = max(np.abs(value).max(initial=0.0), np.abs(before[name]).max(initial=0.0))
        if not np.allclose(before[name], value, rtol=0.0, atol=1e-9 * scale, equal_nan=True):
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
