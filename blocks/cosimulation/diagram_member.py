"""A part of a diagram as a slave: compiled, integrated, and saved by the framework."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trussflow.blocks.cosimulation.input_line import with_lines
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.executor import Span
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.run import Run


@dataclass(frozen=True, slots=True)
class Settings:
    """How the parts of a diagram that are no FMUs are integrated; as for `Simulator`.

    Attributes
    ----------
    step : float
        Step of fixed-step solvers [s].
    solver, backend : str
        The solver and what evaluates the equations.
    tolerances : tuple of float
        Relative and absolute tolerance of adaptive solvers [-, unit of the state].
    lines : bool
        Whether inputs may change linearly.
    parameters, initial : mapping
        Values of parameters and initial states by ``"block.name"`` [units as declared].
    """

    step: float
    solver: str = "rk4"
    backend: str = "auto"
    tolerances: tuple[float, float] = (1e-8, 1e-10)
    lines: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict)
    initial: Mapping[str, Any] = field(default_factory=dict)


class DiagramSlave:
    """A part of a diagram, with inputs from outside, that the framework integrates.

    It does what `Session` does, with less around each step: times are counted in ticks, and
    inputs and outputs are plain vectors.

    Parameters
    ----------
    system : System
        The part; its inputs from outside are those of the slave.
    outputs : sequence of Port
        The ports to read.
    settings : Settings
        How it is integrated.

    Raises
    ------
    SimulationError
        If a setting makes no sense.
    DiagramError
        If there is an algebraic loop within the part.
    TracingError
        If the equations of a block cannot be traced.
    """

    varies = True
    refreshes = True

    def __init__(self, system: System, outputs: Sequence[Port], settings: Settings) -> None:
        self.ramps = settings.lines
        self.prepared = Prepared(
            with_lines(system) if settings.lines else system,
            step=settings.step,
            solver=settings.solver,
            backend=settings.backend,
            chosen={port.path: port for port in outputs},
            tolerances=settings.tolerances,
        )
        plan = self.prepared.plan
        self.restores = all(block.restorable for block in plan.python_blocks)
        self._sources = list(system.external.values())
        self._size = sum(source.y.size for source in self._sources)
        self._settings = settings
        self._run: Run | None = None
        self._x = self._d = self._p = np.zeros(0)
        self._u = np.zeros(0)
        self._k, self._latched = 0, False
        # The short way through a step, where nothing needs Python between two ticks.
        self._direct = self.prepared.is_fixed and not plan.python_blocks
        self._tick = float(self.prepared.tick)
        self._no_log = np.empty((0, 0))

    @property
    def parameters(self) -> dict[str, list[float]]:
        """Values of its parameters, by ``"block.parameter"``."""
        plan = self.prepared.plan
        return plan.p.listed(plan.parameters(self._settings.parameters))

    # -- start and end ------------------------------------------------------------------------

    def start(self, inputs: Vector) -> None:
        """Begin at time 0; initial states may depend on the inputs."""
        self.stop()
        prepared, settings = self.prepared, self._settings
        p = prepared.plan.parameters(settings.parameters)
        prepared.units.start(p)
        try:
            x, d = prepared.plan.initial(p, settings.initial, self._named(inputs))
        except BaseException:
            with contextlib.suppress(TrussflowError):  # the first error is the one to see
                prepared.units.stop()
            raise
        self._run = Run(prepared, x, d, p)
        self._x, self._d, self._p = x, d, p
        self._k, self._latched = 0, False
        self._u = d[prepared.plan.u_start :]

    def stop(self) -> None:
        """End; Python blocks release what they took."""
        if self._run is not None:
            self._run = None
            self.prepared.units.stop()

    def _named(self, inputs: Vector) -> dict[str, Vector]:
        found, start = {}, 0
        for source in self._sources:
            found[source.name] = inputs[start : start + source.y.size].reshape(source.extent)
            start += source.y.size
        return found

    def _running(self) -> Run:
        assert self._run is not None, "the master starts its slaves"
        return self._run

    # -- steps --------------------------------------------------------------------------------

    def set(self, inputs: Vector, rates: Vector | None = None) -> None:
        """Set all inputs, and how fast they change."""
        u, size = self._u, self._size
        if not self._direct:
            self._running().before_jump()
        u[:size] = inputs
        if self.ramps and size:
            u[size:-1] = 0.0 if rates is None else rates
            u[-1] = self._running().time

    def latch(self, inputs: Vector) -> None:
        """Let sampled blocks whose clock ticks now compute with these inputs, not with later ones.

        Raises
        ------
        DivergenceError
            If what they compute is not finite.
        """
        if not self.prepared.plan.system.clocks:
            return
        run = self._running()
        self.set(inputs)
        if not self._direct:
            run.sample()
        elif number := self._due(run):
            self._d[:] = self.prepared.executor.call(f"sample_{number}", run.time, self._x, self._d, self._p)
        self._latched = True

    def advance(self, now: float, until: float) -> None:
        """Take one communication step; with a fixed-step solver a whole number of its steps."""
        run = self._running()
        if not self._direct:
            run.advance(exact(until))
            return
        prepared, first = self.prepared, self._k
        number = round(until / self._tick) - first
        due = prepared.schedule.due(first, number)
        if self._latched:
            due[0], self._latched = 0, False
        logged = np.zeros(number, dtype=np.uint8)
        span = Span(prepared.solver, prepared.tick, first, due, logged)
        progress = prepared.executor.advance(span, self._x, self._d, self._p, self._no_log)
        if progress.fault:
            run.stop_if_diverged(progress, first, logged, self._no_log)
        self._k = first + number
        run.time = until

    def outputs(self) -> Vector:
        """Return all outputs; what is sampled at this very time is sampled already."""
        run, executor, d = self._running(), self.prepared.executor, self._d
        if self.prepared.plan.system.clocks and (number := self._due(run)):
            d = executor.call(f"sample_{number}", run.time, self._x, d, self._p)
        return executor.call("outputs", run.time, self._x, d, self._p)

    def _due(self, run: Run) -> int:
        if not self._direct:
            return run.due()
        return 0 if self._latched else int(self.prepared.schedule.due(self._k, 1)[0])

    # -- going back ---------------------------------------------------------------------------

    def save(self) -> tuple[Any, ...]:
        """Return a snapshot."""
        run = self._running()
        hidden = {} if self._direct else self.prepared.units.save()
        place = self._k, self._latched, run.now, run.time, run.sampled
        return place, self._x.copy(), self._d.copy(), hidden

    def restore(self, saved: tuple[Any, ...]) -> None:
        """Go back to a snapshot."""
        run = self._running()
        place, self._x[:], self._d[:], hidden = saved
        self._k, self._latched, run.now, run.time, run.sampled = place
        if hidden:
            self.prepared.units.restore(hidden)
