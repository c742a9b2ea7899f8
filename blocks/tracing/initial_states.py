"""Initial states that blocks compute from their inputs, in the order of the signal flow."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import NameLookupError
from trussflow.blocks.framework.declarations import State
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.fixed_point import settle
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import shown
from trussflow.blocks.tracing.call_checks import checked, running_errors
from trussflow.blocks.tracing.sorted_order import Active, in_order, reached_from

if TYPE_CHECKING:
    from trussflow.blocks.tracing.evaluation import Evaluation
    from trussflow.blocks.tracing.plan import Plan


def set_from_inputs(
    plan: Plan,
    t: float,
    x: Vector,
    d: Vector,
    p: Vector,
    overrides: Mapping[str, Any],
    opened: Mapping[str, Equations],
) -> None:
    """Set the initial states that blocks compute from their inputs; overrides take precedence.

    Python blocks on the signal path to such an input compute their first outputs here.

    Parameters
    ----------
    plan : Plan
        The plan.
    t : float
        Initial time [s].
    x, d, p : Vector
        Continuous states, discrete data, and parameters; x and d are changed [as declared].
    overrides : mapping
        Initial states from the user, by ``"block.name"``.
    opened : mapping
        Equation objects of the Python blocks for this run, by block path.

    Raises
    ------
    NameLookupError
        If a block returns a name that is none of its states.
    ParameterError
        If a value is not finite or has the wrong shape.
    SimulationError
        If initial states depend on each other, and their fixed-point iteration does not converge.
    """
    blocks = plan.system.blocks
    equations = {path: opened.get(path, block) for path, block in blocks.items()}
    stored = {path: block.declared(State) for path, block in blocks.items()}
    stating = [
        path
        for path, own in equations.items()
        if own.states_own("initial_state")
        # A block with internal state sets it in initial_state(), even if the user gave all states.
        and (
            blocks[path].hides
            or any(f"{path}.{name}" not in overrides for name in stored[path])
        )
    ]
    active = frozenset(c for c in plan.system.clocks if c.offset == 0)
    showing = {
        block.path
        for block in plan.python_blocks
        if plan.system.clock_of[block.path] in (None, *active)
        and (block.path in opened or not block.hides)
    }
    if not stating and not showing:
        return

    @lru_cache(maxsize=1)  # one evaluation serves all blocks until a state changes
    def evaluated(_: bytes) -> Evaluation:
        return plan.evaluate(t, x, d, p, active)

    def ask(path: str, kind: str) -> Any:
        # By content, as x and d are changed in place.
        evaluation = evaluated(x.tobytes() + d.tobytes())
        own = plan.p.signals(path, p)
        first = (
            [np.float64(t), evaluation.leaves.states[path]] if kind == "output" else []
        )
        with running_errors(blocks[path], kind, t):
            return getattr(equations[path], kind)(
                *first, evaluation.inputs(blocks[path]), own
            )

    def sweep(showing: Collection[str] = ()) -> Vector:
        for path in order:
            if path in stating:
                values = ask(path, "initial_state")
                wrong = [values]
                if isinstance(values, dict):
                    wrong = [name for name in values if name not in stored[path]]
                if wrong:
                    raise NameLookupError(
                        f"initial_state() of block '{path}' returned {shown(wrong[0])}; its states are: "
                        f"{', '.join(stored[path]) or 'none'}"
                    )
                found = {f"{path}.{name}": value for name, value in values.items()}
                # The user's values last: they take precedence over those of the block.
                plan.override(x, d, {**found, **overrides})
            if path in showing:
                outputs = checked(blocks[path], "output", ask(path, "output"))
                for name, value in outputs.items():
                    plan.held.put(d, path, name, value)
        return np.concatenate([x, d])

    def settle_circle() -> None:
        names = " and ".join(f"'{path}'" for path in stating)
        settle(
            sweep,
            len(stating),
            f"the initial states of '{plan.name}' do not settle: those that initial_state() of {names} "
            "returns depend on each other in a circle; set some of them by initial=, or remove "
            "initial_state()",
        )

    # Python code may count its calls: output() is called once, also if initial states form a cycle.
    order, circular = _in_order(plan, stating, showing, active)
    # Of a cycle, first without outputs of Python blocks, which need settled states.
    if circular:
        settle_circle()
    sweep(showing)
    if circular:
        settle_circle()


def _in_order(
    plan: Plan, stating: Collection[str], showing: Collection[str], active: Active
) -> tuple[list[str], bool]:
    """Return the blocks in the order of evaluation, and whether their initial states form a cycle."""
    graph: dict[str, list[str]] = {}
    holding = plan.system.holding(active)
    waiting = [*stating]
    while waiting:
        path = waiting.pop()
        if path in graph:
            continue
        block = plan.system.blocks[path]
        needed = frozenset().union(*plan.feedthrough[path].values())
        names = [
            port.name
            for port in block.inputs()
            if path in stating or port.name in needed
        ]
        graph[path] = reached_from(
            plan.system, plan.feedthrough, path, names, holding, {*stating, *showing}
        )
        waiting += graph[path]
    order, cycle = in_order(graph)
    # A cycle has no order: any fixed order serves the fixed-point iteration.
    return order or [path for path in plan.system.blocks if path in graph], bool(cycle)
