"""Which scalar of an FMU depends on which: exact sparsity of the traced programs.

The columns of every pattern are what an importer may know, in the order of the value references:
time, inputs, parameters, continuous states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.layout import Layout
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program

Pattern = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Dependencies:
    """Dependencies while time goes on, and during initialization.

    Attributes
    ----------
    derivatives, outputs : Pattern
        One row per scalar, one column per known. Outputs at sample instants are included.
    initial_states, initial_derivatives, initial_outputs : Pattern
        The same before time 0 has passed. Columns of states that are themselves calculated are
        empty: what they depend on is named instead.
    tunable : Pattern
        For each element of the parameters, whether it matters once time goes on.
    """

    derivatives: Pattern
    outputs: Pattern
    initial_states: Pattern
    initial_derivatives: Pattern
    initial_outputs: Pattern
    tunable: Pattern


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """The pattern of one program, by its arguments."""

    t: Pattern
    x: Pattern
    d: Pattern
    p: Pattern

    @classmethod
    def of(cls, program: Program) -> _Parts:
        return cls(*sparsity(program))

    def after(self, memory: Pattern, other: _Parts) -> _Parts:
        """Return the pattern of this program run on the d that another returned."""
        d = memory & self.d
        return _Parts(
            self.t | _product(d, other.t),
            self.x | _product(d, other.x),
            (self.d & ~memory) | _product(d, other.d),
            self.p | _product(d, other.p),
        )


def sparsity(program: Program) -> list[Pattern]:
    """Return which elements of the result depend on which ones of each argument of a program."""
    function = program.function.expand() if program.calls else program.function
    found = []
    for argument in range(len(program.inputs)):
        pattern = function.jac_sparsity(0, argument)
        found.append(np.zeros(pattern.shape, dtype=bool))
        found[-1][tuple(np.array(pattern.get_triplet(), dtype=int).reshape(2, -1))] = True
    return found


def dependencies(
    plan: Plan, derivative: Program, outputs: Program, samples: Sequence[Program], start: Program
) -> Dependencies:
    """Return the dependencies of a plan.

    Parameters
    ----------
    plan : Plan
        The plan.
    derivative, outputs : Program
        dx/dt, and all outputs.
    samples : sequence of Program
        d after each set of clocks has ticked.
    start : Program
        (x, memory) after initialization.
    """
    changing = np.arange(plan.d_size) < plan.u_start
    rate = _with_python_blocks(plan, _Parts.of(derivative), (plan.x,))
    output = _with_python_blocks(plan, _Parts.of(outputs), ())
    rows = (plan.memory, plan.held, plan.u)
    sampled = [_with_python_blocks(plan, _Parts.of(program), rows) for program in samples]
    seen = [output, *(output.after(changing, s) for s in sampled)]
    running = _Parts(*(np.any(parts, axis=0) for parts in zip(*map(_fields, seen), strict=True)))
    first = _Parts.of(start)
    # Memory and held outputs start as constants, or as what the first sample makes of them.
    x = _columns(plan, first, first.x)[: plan.x.size]
    memory = _columns(plan, first, first.x)[plan.x.size :]
    held = np.zeros((plan.held.size, x.shape[1]), dtype=bool)
    inputs = np.zeros((plan.u.size, x.shape[1]), dtype=bool)
    inputs[:, 1 : 1 + plan.u.size] = np.eye(plan.u.size, dtype=bool)
    d = np.vstack([memory, held, inputs])

    def initially(parts: _Parts) -> Pattern:
        own = _columns(plan, parts, np.zeros_like(parts.x))
        return own | _product(parts.x, x) | _product(parts.d, d)

    return Dependencies(
        derivatives=_columns(plan, rate, rate.x),
        outputs=_columns(plan, running, running.x),
        initial_states=x,
        initial_derivatives=initially(rate),
        initial_outputs=initially(running),
        tunable=np.any(np.vstack([part.p for part in (rate, output, *sampled)]), axis=0),
    )


def _fields(parts: _Parts) -> tuple[Pattern, ...]:
    return parts.t, parts.x, parts.d, parts.p


def _columns(plan: Plan, parts: _Parts, x: Pattern) -> Pattern:
    """Return a pattern over the knowns."""
    return np.hstack([parts.t, parts.d[:, plan.u_start :], parts.p, x])


def _with_python_blocks(plan: Plan, parts: _Parts, layouts: Sequence[Layout]) -> _Parts:
    """Let what comes from Python blocks depend on everything: nothing is known of their code.

    The rows of `parts` are those of the layouts.
    """
    held = _of_python_blocks(plan, (plan.memory, plan.held, plan.u))
    own = _of_python_blocks(plan, layouts) if layouts else np.zeros(len(parts.d), dtype=bool)
    reached = np.any(parts.d & held, axis=1) | own
    return _Parts(*(pattern | reached[:, None] for pattern in _fields(parts)))


def _of_python_blocks(plan: Plan, layouts: Sequence[Layout]) -> Pattern:
    """Mark the elements of layouts, one after the other, that belong to Python blocks."""
    names = {block.path for block in plan.python_blocks}
    marks = [e.path in names for layout in layouts for e in layout for _ in range(e.start, e.stop)]
    return np.array(marks, dtype=bool)


def _product(a: Pattern, b: Pattern) -> Pattern:
    return np.asarray(a.astype(np.float32) @ b.astype(np.float32) > 0)
