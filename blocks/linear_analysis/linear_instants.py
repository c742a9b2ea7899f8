"""Linearized update of sampled blocks, traced or Python, at one instant."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.system import Indices
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.jacobians import LocalJacobians
from trussflow.blocks.linear_analysis.lifting import Jump
from trussflow.blocks.linear_analysis.python_continuous_slopes import closed_outputs
from trussflow.blocks.tracing.plan import Plan


def linear_instant(local: LocalJacobians, number: int, x: Vector, d: Vector) -> Jump:
    """Return the derivatives of (x, memory, held) after an instant, by before and by u.

    The chain rule, walked as the run walks: at each stage `after` are the derivatives of (x, d) as
    it is then by (x, d) as it was before the instant, and a block that computes replaces its own rows.

    Parameters
    ----------
    local : LocalJacobians
        The plan, where it is linearized.
    number : int
        Number of the set of clocks.
    x, d : Vector
        States and what is sampled, before the instant [units as declared].
    """
    plan, d = local.plan, d.copy()
    after = np.eye(x.size + d.size)
    sequence = local.assembly.sampled.ordered[number]
    for call, quantity in sequence:
        # Outputs come one block after the other: each sees what those before it put into d.
        if call.block.outputs():
            after = _refreshed(local, x, d, after)
            values, slopes = local.python(call, "output", quantity.name, x, d)
            after[x.size + call.outputs.start : x.size + call.outputs.stop] = slopes @ after
            d[call.outputs] = values
    after = _refreshed(local, x, d, after)
    # Updates are simultaneous: all see the outputs just made and the states before.
    staged = [
        (call.states, local.python(call, "update", quantity.name, x, d)[1] @ after)
        for call, quantity in sequence
        if call.size
    ]
    result = after.copy()
    result[x.size :] = local.matrix(f"sample_{number}", x, d) @ after
    for states, rows in staged:
        result[x.size + states.start : x.size + states.stop] = rows
    inner = inner_places(plan)
    return result[np.ix_(inner, inner)], result[inner, x.size + plan.u_start :]


def inner_places(plan: Plan) -> Indices:
    """Return where (x, memory, held) of a `plan` are in (x, d): modes and events stay as they are."""
    size, sampled = plan.x.size, plan.sampled
    return np.array(np.r_[:size, size + sampled.start : size + sampled.stop], dtype=np.int64)


def _refreshed(local: LocalJacobians, x: Vector, d: Vector, so_far: Vector) -> Vector:
    """Let continuous Python blocks see what is there so far."""
    return closed_outputs(local, x, d).refresh(so_far) if local.assembly.continuous else so_far
