"""A prepared diagram: plan, schedule and compiled code, which all its runs share and do not change."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Self

import numpy as np

from trussflow.blocks.framework.clock import common_tick, exact, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.system import System
from trussflow.blocks.results.channels import Channel, Chosen, chosen_channels
from trussflow.blocks.results.dataset import own_version
from trussflow.blocks.simulation.adaptive import IMPLICIT
from trussflow.blocks.simulation.block_instances import OpenBlocks
from trussflow.blocks.simulation.executor import (
    CompiledExecutor,
    Executor,
    InterpretedExecutor,
    NumPyExecutor,
)
from trussflow.blocks.simulation.python_blocks import PythonBlocks, PythonExecutor
from trussflow.blocks.simulation.schedule import Schedule
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.support.call_site import warn_once
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.summary import Description
from trussflow.blocks.support.types import Vector
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import (
    Quantity,
    after_events,
    derivative,
    guesses,
    indicators,
    outputs,
    sample,
    stored,
)
from trussflow.blocks.tracing.variable_step import SparseJacobian


def _numbers(value: Any) -> Any:
    """Return the numbers and text in a `value`, in any container; other objects become None."""
    # With the dtype: float32 and float64 arrays may hold equal numbers.
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.str, _numbers(value.tolist())
    if isinstance(value, list | tuple):
        return [_numbers(v) for v in value]
    if isinstance(value, dict):
        return [(_numbers(k), _numbers(v)) for k, v in value.items()]
    return (
        value
        if isinstance(value, bool | int | float | complex | str | bytes | Fraction)
        else None
    )


def digest(text: str) -> str:
    """Return a hash of a `text` as 16 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class Prepared:
    """A plan with its clocks, Python blocks and compiled equations, shared by all its runs.

    Parameters
    ----------
    plan : Plan
        The plan.
    quantities : sequence of Quantity
        Quantities to compute besides those that sampled and Python blocks need.
    solver : Solver
        Solver and backend of the runs. Instants are counted in the steps of a fixed-step solver.
    channels : sequence of Channel
        Logged ports, whose values are the quantity "outputs".

    Attributes
    ----------
    schedule, has_clocks : Schedule, bool
        Schedule of the sampled blocks, and whether there are any.
    python : PythonBlocks
        The Python blocks.
    step : Fraction or None
        Step of a fixed-step solver [s].
    tick, tick_seconds : Fraction, float
        Time unit of the integer ticks [s].

    Raises
    ------
    AlgebraicLoopError
        If there is an algebraic loop at some instant.
    """

    def __init__(
        self,
        plan: Plan,
        quantities: Sequence[Quantity],
        solver: Solver,
        channels: Sequence[Channel] = (),
    ) -> None:
        self.plan = plan
        self.solver = solver
        self.channels = channels
        clocks = plan.system.clocks
        self.step = (
            exact(solver.step) if solver.step is not None and solver.is_fixed else None
        )
        # With an adaptive solver, ticks are those of the clocks; 1 s if there are none.
        self.tick = self.step or common_tick(
            [t for c in clocks for t in (c.period, c.offset)] or [Fraction(1)]
        )
        self.tick_seconds = float(self.tick)
        for path, clock in plan.system.clock_of.items():
            if clock:
                ticks(clock.period, self.tick, f"the sample time of block '{path}'")
        self.schedule = Schedule(clocks, self.tick)
        self.has_clocks = bool(clocks)
        for active in self.schedule.sets:
            plan.order(active)  # finds algebraic loops, whatever is logged
        self.python = PythonBlocks(plan, self.schedule.sets)
        self.quantities = [
            *quantities,
            *(sample(i, s) for i, s in enumerate(self.schedule.sets) if s),
            *self.python.quantities(),
            *([indicators(), after_events()] if plan.has_events else []),
            *([guesses()] if plan.guesses.size else []),
            *([stored()] if plan.histories.size else []),
        ]

    @classmethod
    @interruptible()
    def of(
        cls, diagram: Diagram | System, solver: Solver, chosen: Chosen | None
    ) -> Self:
        """Return the traced diagram, compiled if there is a compiler.

        Parameters
        ----------
        diagram : Diagram or System
            Diagram to simulate.
        solver : Solver
            Solver of the run.
        chosen : mapping, sequence or None
            The ports that results hold; None: every output.

        Raises
        ------
        SimulationError
            If an argument is invalid.
        DiagramError
            If the diagram cannot be built: open inputs, algebraic loops.
        TracingError
            If the equations of a block cannot be traced.
        """
        plan = Plan(diagram, (solver.is_fixed and solver.step) or math.inf)
        plan.loops.refuse_idle_starts()
        channels = chosen_channels(plan.system, chosen)
        prepared = cls(
            plan, [derivative(), outputs([c.port for c in channels])], solver, channels
        )
        prepared.traced  # noqa: B018 - compilation takes long, so it does not wait for the first run
        return prepared

    @functools.cached_property
    def programs(self) -> list[Program]:
        """The traced programs of (t, x, d, p), and the directional derivative for a stiff solver."""
        tangents = [self.jacobian.tangent] if self.jacobian else []
        return [*self._programs, *tangents]

    @functools.cached_property
    def _programs(self) -> list[Program]:
        return self.plan.trace(self.quantities)

    @functools.cached_property
    def jacobian(self) -> SparseJacobian | None:
        """The sparse Jacobian of dx/dt; None if the solver does not use it, or the equations have none."""
        # The derivatives of Python blocks are not in the traced program.
        if self.solver.solver not in IMPLICIT or self.python.continuous:
            return None
        if self.solver.backend == "numpy":
            return None
        return SparseJacobian.of(self._programs[0])

    @functools.cached_property
    def traced(self) -> Executor:
        """Executor of the traced equations, from which each run gets its own."""
        backend = self.solver.backend
        if backend == "numpy":
            return NumPyExecutor(self.plan, self.quantities)
        if backend != "interpreted":
            try:
                return self._with_jacobian(
                    CompiledExecutor(
                        self.programs, self.plan, variable=not self.solver.is_fixed
                    )
                )
            except CompilationError as error:
                if backend == "compiled":
                    raise
                slow = "simulations run in CasADi's interpreter, 20 times slower if large, 400 times if small"
                warn_once("compiler", f"{slow}: {error}")
        return self._with_jacobian(InterpretedExecutor(self.programs, self.plan))

    def _with_jacobian(self, executor: Executor) -> Executor:
        executor.jacobian = self.jacobian
        return executor

    def open(self, p: Vector) -> Executor:
        """Return the executor of one run with parameters `p` [as declared]; it must be closed.

        Raises
        ------
        SimulationError
            If a Python block cannot be opened.
        """
        traced = self.traced.fresh()
        if not self.plan.python_blocks:
            return traced
        blocks = OpenBlocks(
            [
                (block, self.plan.p.signals(block.path, p))
                for block in self.plan.python_blocks
            ]
        )
        return PythonExecutor(traced, self.python, blocks)

    def described(self, what: str, state: str = "") -> Description:
        """Return the solver, the sizes and the signals, for an object `what` in a `state`."""
        solver = self.solver
        plan = self.plan
        accuracy = (
            f"step {float(self.step):g} s"
            if self.step
            else f"rtol {solver.rtol:g}, atol {solver.atol:g}"
        )
        facts = {
            "solver": f"{solver.solver}, {accuracy}, backend {solver.backend}",
            "states": f"{plan.x.size} continuous, {plan.memory.size} discrete",
            "rates": ", ".join(
                f"{float(clock.period):g} s" for clock in plan.system.clocks
            ),
            "inputs": ", ".join(plan.system.external),
            "shows": ", ".join(channel.name for channel in self.channels),
        }
        return Description(f"{what} of '{plan.name}'{state}", facts)

    @property
    def identity(self) -> dict[str, str | float]:
        """Identity that a saved state must have so that a run continues bit by bit."""
        solver = self.solver
        return {
            "trussflow_version": own_version(),
            "diagram": self.plan.name,
            "diagram_hash": self.fingerprint,
            "solver": solver.solver,
            "step": float(self.step or 0.0),
            "rtol": solver.rtol,
            "atol": solver.atol,
            "backend": self.traced.name,
        }

    @functools.cached_property
    def fingerprint(self) -> str:
        """A hash of the traced equations, the sample times, and the numbers and text in Python blocks.

        It does not cover the code of Python blocks.
        """
        # Without the outputs: a state also fits a session that reads other outputs.
        codes = [p.code for p in self.programs if p.name != "outputs"]
        clocks = self.plan.system.clock_of.items()
        codes += [f"{path} {clock}" for path, clock in clocks]
        for block in self.plan.python_blocks:
            state: Any = object.__getstate__(block)
            # If a class has __slots__, the state is a pair of dictionary and slots.
            own, slots = state if isinstance(state, tuple) else (state, {})
            made = (own or {}) | slots | {"parameters": None}  # each run has its own
            codes += [type(block).__name__, block.fingerprint, repr(_numbers(made))]
        return digest("\0".join(codes))

    @functools.cached_property
    def logged(self) -> str:
        """A hash of the traced equations of the logged signals, which no state depends on."""
        (code,) = (p.code for p in self.programs if p.name == "outputs")
        return digest(code)

    @functools.cached_property
    def layout(self) -> str:
        """A hash of the layouts of x, d and p, and of the sample times."""
        plan = self.plan
        arrays = [
            [(e.path, e.name, e.shape) for e in layout] for layout in plan.layouts
        ]
        return digest(repr((arrays, [*plan.system.clock_of.items()], self.tick)))
