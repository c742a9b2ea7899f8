"""Preparing: from a diagram to what its runs share: plan, clocks, code."""

from __future__ import annotations

import copy
import functools
import hashlib
from collections.abc import Mapping, Sequence
from fractions import Fraction

import casadi as ca
import numpy as np

from trussflow.blocks.framework.clock import common_tick, exact, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import positive
from trussflow.blocks.simulation.adaptive import IMPLICIT, METHODS
from trussflow.blocks.simulation.executor import (
    CompiledExecutor,
    Executor,
    InterpretedExecutor,
    NumPyExecutor,
)
from trussflow.blocks.simulation.python_continuous import LiveBlocks, LiveExecutor
from trussflow.blocks.simulation.python_sampled import PythonUnits
from trussflow.blocks.simulation.results import channels
from trussflow.blocks.simulation.schedule import Schedule
from trussflow.blocks.tracing import compiler
from trussflow.blocks.tracing.plan import Plan, derivative, outputs, sample
from trussflow.blocks.tracing.program import Program

FIXED_STEP = ("rk4", "euler")
BACKENDS = ("auto", "compiled", "interpreted", "numpy")

Chosen = Mapping[str, Port | str] | Sequence[Port | str]
"""Ports, as ports or ``"block.port"``, optionally by the name wanted in results."""


def chosen_ports(system: System, chosen: Chosen | None) -> dict[str, Port]:
    """Return the ports that results hold, by their names there.

    Raises
    ------
    NameLookupError
        If there is no such port.
    SimulationError
        If a port is named twice, or there is text in place of a list.
    """
    if isinstance(chosen, str):
        raise SimulationError(f"the ports to log, {chosen!r}, must be a list: [{chosen!r}]")
    if chosen is None:
        found = [p for b in system.blocks.values() for p in b.outputs()]
        return {p.path: p for p in found}
    if isinstance(chosen, Mapping):
        return {name: system.port(reference) for name, reference in chosen.items()}
    names = [str(r) if isinstance(r, str) else r.full_path for r in chosen]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise SimulationError(f"ports are to be logged twice: {', '.join(twice)}")
    return dict(zip(names, map(system.port, chosen), strict=True))


class Prepared:
    """A diagram made ready to run: traced, and compiled where there is a compiler.

    Parameters
    ----------
    diagram : Diagram or System
        What is to run.
    step : float or None
        Step of a fixed-step solver [s].
    solver, backend : str
        As for `Simulator`.
    chosen : mapping, sequence or None
        The ports that results hold; None: every output.
    tolerances : tuple of float
        Relative and absolute tolerance of adaptive solvers [-, unit of the state].

    Raises
    ------
    SimulationError
        If an argument makes no sense.
    DiagramError
        If the diagram cannot be built: open inputs, algebraic loops.
    TracingError
        If the equations of a block cannot be traced.
    """

    def __init__(
        self,
        diagram: Diagram | System,
        *,
        step: float | None,
        solver: str,
        backend: str,
        chosen: Chosen | None,
        tolerances: tuple[float, float],
    ) -> None:
        positive(rtol=tolerances[0], atol=tolerances[1])
        if step is not None:
            positive(step=step)
        for what, name, allowed in (
            ("solver", solver, (*FIXED_STEP, *METHODS)),
            ("backend", backend, BACKENDS),
        ):
            if name not in allowed:
                raise SimulationError(f"unknown {what} {name!r}; choose from: {', '.join(allowed)}")
        if solver in FIXED_STEP and step is None:
            raise SimulationError(f"solver '{solver}' needs a step, such as step=1e-3")
        self.solver, self.backend, self.tolerances = solver, backend, tolerances
        self.plan = Plan(diagram)
        self.step = exact(step) if step is not None and solver in FIXED_STEP else None
        self.channels = channels(chosen_ports(self.plan.system, chosen))
        clocks = self.plan.system.clocks
        self.tick = self.step or common_tick(
            [t for c in clocks for t in (c.period, c.offset)] or [Fraction(1)]
        )
        self.schedule = Schedule(clocks, self.tick)
        for active in self.schedule.sets:
            self.plan.order(active)  # finds algebraic loops, whatever is logged
        self.units = PythonUnits(self.plan, self.schedule.sets)
        self._live = LiveBlocks(self.plan)
        self._quantities = [
            derivative(),
            outputs([c.port for c in self.channels]),
            *(sample(i, s) for i, s in enumerate(self.schedule.sets) if s),
            *self.units.quantities(),
            *self._live.quantities(),
        ]
        traced = self._executor()
        self.executor = LiveExecutor(traced, self._live) if self._live else traced

    def _executor(self) -> Executor:
        """Return the executor of the backend asked for, for what is traced."""
        if self.backend == "numpy":
            return NumPyExecutor(self.plan, self._quantities)
        programs = self.programs
        compiled = self.backend == "compiled" or (self.backend == "auto" and compiler.available())
        return CompiledExecutor(programs) if compiled else InterpretedExecutor(programs)

    def twin(self) -> Prepared:
        """Return another one with work space of its own, for runs that go on side by side.

        Raises
        ------
        SimulationError
            If there are Python blocks, which two runs cannot share.
        """
        if self.plan.python_blocks:
            raise SimulationError(
                f"'{self.plan.name}' has Python blocks ({self.plan.python_blocks[0].path}), which "
                "cannot serve two runs at once; build the diagram twice"
            )
        other = copy.copy(self)
        if isinstance(self.executor, CompiledExecutor):
            other.executor = self.executor.twin()
        return other

    @property
    def is_fixed(self) -> bool:
        """Whether the solver takes fixed steps."""
        return self.solver in FIXED_STEP

    @functools.cached_property
    def programs(self) -> list[Program]:
        """The traced programs of (t, x, d, p)."""
        return self.plan.trace(self._quantities)

    @functools.cached_property
    def fingerprint(self) -> str:
        """A hash of traced equations and sample times; it does not cover code in Python blocks."""
        codes = [p.code for p in self.programs if p.name != "outputs"]
        codes += [f"{path} {self.plan.system.clock(b)}" for path, b in self.plan.system.blocks.items()]
        return hashlib.sha256("\0".join(codes).encode()).hexdigest()[:16]

    @functools.cached_property
    def layout(self) -> str:
        """A hash of what x, d and p consist of, and of the sample times."""
        plan = self.plan
        arrays = [[(e.path, e.name, e.shape) for e in layout] for layout in plan.layouts]
        clocks = [(path, plan.system.clock(block)) for path, block in plan.system.blocks.items()]
        return hashlib.sha256(repr((arrays, clocks, self.tick)).encode()).hexdigest()[:16]

    @functools.cached_property
    def _jacobian(self) -> ca.Function:
        """The exact derivative of dx/dt by x."""
        rates = self.programs[0]
        written_out = rates.function.expand()  # five times faster to evaluate than kernel calls
        arguments = [ca.SX.sym(n, s.numel()) for n, s in zip("txdp", rates.inputs, strict=True)]
        jacobian = ca.jacobian(written_out(*arguments), arguments[1])
        return ca.Function("jacobian", arguments, [jacobian])

    def jacobian(self, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        """Return the exact derivative of dx/dt by x."""
        return np.asarray(self._jacobian(t, x, d, p).full())

    @property
    def has_jacobian(self) -> bool:
        """Whether the solver is given the exact derivative."""
        return self.solver in IMPLICIT and self.backend != "numpy" and not self._live

    def ticks(self, time: Fraction, what: str) -> int:
        """Return how many ticks a time is.

        Raises
        ------
        SimulationError
            If it is not a whole number.
        """
        return ticks(time, self.tick, what)
