"""Algebraic loops of a plan: the torn outputs and their numeric solutions."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import numpy as np

from trussflow.blocks.errors import DiagramError, DivergenceError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import resolved
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array
from trussflow.blocks.tracing.evaluation import Evaluation
from trussflow.blocks.tracing.kernels import from_expression, tracing
from trussflow.blocks.tracing.newton import residual_left
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import outputs
from trussflow.blocks.tracing.sorted_order import (
    Active,
    Stage,
    by_port,
    graph_of,
    torn_ports,
)

if TYPE_CHECKING:
    from trussflow.blocks.tracing.plan import Plan


class AlgebraicLoops:
    """The algebraic loops of a `plan` that are solved; false if there are none.

    Attributes
    ----------
    torn : frozenset of Port
        The outputs that are the unknowns.
    starts : dict
        Initial guesses that are not zero [as declared].
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._everything: Active = frozenset(plan.system.clocks)
        self._programs: dict[Active, Program] = {}
        self.torn = frozenset[Port]()
        self.starts: dict[Port, Array] = {}
        diagrams = plan.system.diagrams.values()
        for diagram in diagrams:
            for (name, output), value in diagram.loop_starts.items():
                if name in diagram.blocks:
                    port = resolved(diagram.blocks[name].port(output))
                    self.starts[port] = finite_array(
                        f"the guess of '{port.path}'", value, port.whole_shape or ()
                    )
        if any(diagram.loop_policy == "solve" for diagram in diagrams):
            self.torn = torn_ports(
                graph_of(plan.system, plan.feedthrough, self._everything), self.starts
            )

    def __bool__(self) -> bool:
        return bool(self.torn)

    def refuse_idle_starts(self) -> None:
        """Check that every initial guess belongs to a loop that is solved.

        Raises
        ------
        DiagramError
            If there is a guess for a port outside such loops.
        """
        if not self.starts:
            return
        stages = self._plan.order(self._everything, refuse=False)
        inside = {port for stage in stages if stage.torn for port in stage.ports}
        for port in self.starts.keys() - inside:
            raise DiagramError(
                f"'{port.path}' is in no algebraic loop that is solved, so it needs no guess: remove "
                'its diagram.guess(), or enable the solution of loops by Diagram(..., loops="solve")'
            )

    def iterated(self) -> list[Port]:
        """Return the torn outputs that need an iteration; the plan must have guesses for all torn outputs."""
        plan = self._plan
        with tracing():
            leaves = plan.leaves(plan.symbols(), from_expression)
            evaluation = Evaluation(plan, leaves, self._everything)
            evaluation.compute(plan.order(self._everything, refuse=False))
        return evaluation.iterated

    def values(
        self, t: float, x: Vector, d: Vector, p: Vector, active: Active
    ) -> dict[Port, Array]:
        """Return the torn outputs while `active` clocks tick.

        The solutions are for time `t` [s] with `x`, `d` and `p` [as declared].

        Raises
        ------
        DivergenceError
            If a loop cannot be solved.
        """
        loops = [stage for stage in self._plan.order(active) if stage.torn]
        if not loops:
            return {}
        torn = [port for stage in loops for port in stage.torn]
        # Each set of clocks has its own loops, as other blocks hold their outputs.
        if active not in self._programs:
            (self._programs[active],) = self._plan.trace(
                [outputs(torn, "solutions", active)]
            )
        program = self._programs[active]
        flat = np.asarray(program.function(t, x, d, p).full()).ravel()
        found = by_port(torn, flat, np.reshape)
        for stage in loops:
            if not all(np.isfinite(found[port]).all() for port in stage.torn):
                raise self._unsolved(stage, program, t)
        return found

    def put(self, t: float, x: Vector, d: Vector, p: Vector, active: Active) -> Vector:
        """Return d with the loop solutions as guesses, as derivatives need it, while `active` clocks tick.

        The solutions are for time `t` [s] with `x`, `d` and `p` [as declared].

        Raises
        ------
        DivergenceError
            If a loop cannot be solved.
        """
        guesses = self._plan.guesses
        if guesses.size:
            d = d.copy()
            for port, value in self.values(t, x, d, p, active).items():
                key = port.block.path, port.name
                if key in guesses.entries:
                    guesses.put(d, *key, value)
        return d

    def blame(self, t: float, x: Vector, d: Vector, p: Vector) -> NoReturn:
        """Raise the error of the loop without a solution at time `t` [s] with `x`, `d` and `p` [as declared].

        Raises
        ------
        DivergenceError
            Always.
        """
        # The interpreter repeats the solution and names the loop, unless it succeeds.
        self.values(t, x, d, p, frozenset())
        raise DivergenceError(
            f"an algebraic loop is nearly singular at t = {t:g} s: the interpreter can solve it, compiled "
            "code cannot; break it with a state or a UnitDelay"
        )

    def _unsolved(self, stage: Stage, program: Program, t: float) -> DivergenceError:
        """Return the error of a loop without a solution at time `t` [s]."""
        places = self._plan.guesses.entries
        starts = [
            f"'{port.path}': ..."
            for port in stage.torn
            if (port.block.path, port.name) in places
        ]
        left = residual_left(program.calls)
        why = "its equations are singular, or one of its inputs is not finite"
        if starts and left == 0.0:
            why = "Newton's method converges to a singular solution, such as a double root"
        elif starts and np.isfinite(left):
            why = (
                f"Newton's method stops at a residual of {left:.3g}; there may be no solution, or none near "
                "the last one"
            )
        elif starts:
            why = "its signals are not finite at the initial guess of Newton's method"
        start = f"set another initial guess with diagram.guess() or initial={{{', '.join(starts)}}}, or "
        return DivergenceError(
            f"cannot solve the algebraic loop at t = {t:g} s: {why}\n{stage.cycle}\n"
            f"{start * bool(starts)}break it with a state (Integrator, TransferFunction), a UnitDelay, or "
            "other connections"
        )
