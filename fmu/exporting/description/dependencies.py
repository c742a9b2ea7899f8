"""Dependencies between the scalars of an FMU: exact sparsity of the traced programs.

The columns of each pattern are the known variables in the order of their value references: time,
inputs, parameters, continuous states.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.sparsity import Pattern, product, sparsity


@dataclass(frozen=True, slots=True, eq=False)
class Dependencies:
    """Dependencies after and during initialization.

    Attributes
    ----------
    derivatives, outputs : Pattern
        Patterns after initialization: one row per scalar, one column per known variable. Outputs at
        sample instants are included.
    initial_states, initial_derivatives, initial_outputs : Pattern
        Patterns during initialization. Columns of calculated states are empty: their own
        dependencies are substituted.
    tunable : Pattern
        Whether each element of the parameters has an effect after initialization.
    """

    derivatives: Pattern
    outputs: Pattern
    initial_states: Pattern
    initial_derivatives: Pattern
    initial_outputs: Pattern
    tunable: Pattern


def dependencies(plan: Plan, programs: Mapping[str, Program]) -> Dependencies:
    """Return the dependencies of a plan.

    Parameters
    ----------
    plan : Plan
        The plan.
    programs : mapping of Program
        Programs by name: ``derivative`` returns dx/dt, ``outputs`` all outputs, ``initialization`` the
        initialized (x, modes, memory). ``indicators`` and ``on_event`` exist with events, ``guesses``
        with algebraic loops, ``stored`` with histories. Further programs return d after a set of clocks has ticked.
    """
    patterns = {
        name: np.hstack(sparsity(program)) for name, program in programs.items()
    }
    start = patterns.pop("initialization")
    # No outputs or derivatives: these only decide which parameters are tunable.
    events = [
        patterns.pop(name)
        for name in ("indicators", "on_event", "guesses", "stored")
        if name in patterns
    ]
    # Columns are the concatenated arguments t, x, d, p: starts of d and p, and the known columns.
    d = 1 + plan.x.size
    p = 1 + plan.x.size + plan.d_size
    known = np.r_[0, d + plan.u_start : p, p : p + plan.p.size, 1:d]
    unknown = _of_python_blocks(plan, *plan.layouts[1:-1])

    def with_python_blocks(pattern: Pattern, computed: Pattern) -> Pattern:
        """Let values computed by Python blocks depend on all knowns, as their code is not traced."""
        return pattern | (computed | pattern[:, d:p][:, unknown].any(axis=1))[:, None]

    rate = with_python_blocks(
        patterns.pop("derivative"), _of_python_blocks(plan, plan.x)
    )
    output = with_python_blocks(patterns.pop("outputs"), np.zeros(1, dtype=bool))
    sampled = [with_python_blocks(pattern, unknown) for pattern in patterns.values()]
    # Outputs at a sample instant are computed from d after the tick.
    changing = slice(d, d + plan.u_start)
    rest = output.copy()
    rest[:, changing] = False
    running = np.any(
        [
            output,
            *(rest | product(output[:, changing], s[: plan.u_start]) for s in sampled),
        ],
        axis=0,
    )
    x, memory = np.split(start[:, known], [plan.x.size])
    # Initial d: constants, or values from the initialization or the first sample.
    first = np.zeros((plan.d_size, len(known)), dtype=bool)
    first[: len(memory)] = memory
    # Inputs are the last part of d and follow the time in the known variables.
    first[plan.u_start :, 1 : 1 + plan.u.size] = np.eye(plan.u.size, dtype=bool)

    def initially(pattern: Pattern) -> Pattern:
        """Substitute the dependencies of the initial x and d for x and d."""
        direct = pattern[:, known]
        # The states are the last known columns; their own dependencies replace them.
        direct[:, len(known) - plan.x.size :] = False
        return direct | product(pattern[:, 1:d], x) | product(pattern[:, d:p], first)

    return Dependencies(
        derivatives=rate[:, known],
        outputs=running[:, known],
        initial_states=x,
        initial_derivatives=initially(rate),
        initial_outputs=initially(running),
        tunable=np.any(np.vstack([rate, output, *sampled, *events])[:, p:], axis=0),
    )


def _of_python_blocks(plan: Plan, *layouts: Layout) -> Pattern:
    """Return a mask of the elements of concatenated layouts that belong to Python blocks."""
    paths = {block.path for block in plan.python_blocks}
    marks = [
        e.path in paths
        for layout in layouts
        for e in layout
        for _ in range(e.start, e.stop)
    ]
    return np.array(marks, dtype=bool)
