"""The scheduler: runs a diagram from start to end.

Between two instants the continuous blocks are integrated together, as one state vector
under one solver. At an instant, the sampled blocks whose clock ticks compute from the
signals of that instant, all at once; then the results are logged; then time goes on.
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
import time
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from trussflow.blocks.framework import compiler
from trussflow.blocks.framework.adaptive import IMPLICIT, METHODS
from trussflow.blocks.framework.clock import common_tick, exact, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import (
    DivergenceError,
    SimulationError,
    SimulationInterrupted,
    TrussflowError,
)
from trussflow.blocks.framework.executor import (
    CompiledExecutor,
    Executor,
    InterpretedExecutor,
    NumPyExecutor,
)
from trussflow.blocks.framework.plan import Plan, derivative, outputs, sample
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.program import Program
from trussflow.blocks.framework.progress import ProgressBar
from trussflow.blocks.framework.python_units import PythonUnits
from trussflow.blocks.framework.results import Log, StreamedLog, channels, provenance
from trussflow.blocks.framework.run import Prepared, Run
from trussflow.blocks.framework.schedule import Schedule
from trussflow.blocks.framework.system import System
from trussflow.blocks.framework.types import Vector

if TYPE_CHECKING:
    import xarray as xr

FIXED_STEP = ("rk4", "euler")
BACKENDS = ("auto", "compiled", "interpreted", "numpy")

Logged = Mapping[str, Port | str] | Sequence[Port | str] | None


def positive(**values: float) -> None:
    """Refuse times and tolerances that are zero, negative or not finite.

    Raises
    ------
    SimulationError
        Naming the argument and its value.
    """
    for name, value in values.items():
        try:
            good = math.isfinite(value) and value > 0
        except TypeError:
            good = False
        if not good:
            raise SimulationError(f"{name} = {value!r} must be a positive and finite number")


class Simulator:
    """A diagram made ready to run, any number of times.

    Runs with other parameters or initial states need no new tracing or compilation.

    Parameters
    ----------
    diagram : Diagram or System
        What to simulate.
    step : float, optional
        Step of a fixed-step solver [s]; not used by the others.
    solver : str
        ``"rk4"`` (classical Runge-Kutta) or ``"euler"`` with fixed steps; ``"RK45"``,
        ``"DOP853"``, ``"LSODA"``, ``"BDF"`` or ``"Radau"`` of SciPy with adaptive ones.
    log : mapping, sequence or None
        Ports to log, as ports or ``"block.port"``, optionally by the name wanted in the
        result; None logs every output.
    log_step : float, optional
        Time between logged instants [s]; by default every step, or a thousandth of the run.
    backend : str
        ``"compiled"``, ``"interpreted"`` (CasADi), ``"numpy"`` (for debugging), or
        ``"auto"``: compiled where there is a C compiler.
    rtol, atol : float
        Tolerances of adaptive solvers [-, unit of the state].

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
        step: float | None = None,
        solver: str = "rk4",
        log: Logged = None,
        log_step: float | None = None,
        backend: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
    ) -> None:
        positive(rtol=rtol, atol=atol)
        if step is not None:
            positive(step=step)
        if log_step is not None:
            positive(log_step=log_step)
        for what, name, allowed in (
            ("solver", solver, (*FIXED_STEP, *METHODS)),
            ("backend", backend, BACKENDS),
        ):
            if name not in allowed:
                raise SimulationError(f"unknown {what} {name!r}; choose from: {', '.join(allowed)}")
        if solver in FIXED_STEP and step is None:
            raise SimulationError(f"solver '{solver}' needs a step, such as step=1e-3")
        self.solver, self.backend, self.tolerances = solver, backend, (rtol, atol)
        self.plan = Plan(diagram)
        self.step = exact(step) if step is not None and solver in FIXED_STEP else None
        self.log_step = exact(log_step) if log_step is not None else self.step
        if self.step is not None and self.log_step is not None:
            ticks(self.log_step, self.step, "log_step")
        self.channels = channels(self._logged(log))
        self._clocks = self.plan.system.clocks
        tick = self.step or common_tick(
            [t for c in self._clocks for t in (c.period, c.offset)] or [Fraction(1)]
        )
        self._schedule = Schedule(self._clocks, tick)
        for active in self._schedule.sets:
            self.plan.order(active)  # finds algebraic loops, whatever is logged
        self._tick = tick
        self._units = PythonUnits(self.plan, self._schedule.sets)
        self._quantities = [
            derivative(),
            outputs([c.port for c in self.channels]),
            *(sample(i, s) for i, s in enumerate(self._schedule.sets) if s),
            *self._units.quantities(),
        ]
        self.executor = self._executor()
        exact_jacobian = self.solver in IMPLICIT and backend != "numpy"
        self._prepared = Prepared(
            plan=self.plan, executor=self.executor, schedule=self._schedule, units=self._units,
            solver=solver, tick=tick, log_step=self.log_step, tolerances=self.tolerances,
            jacobian=self._jacobian_values if exact_jacobian else None,
        )  # fmt: skip

    def _logged(self, log: Logged) -> dict[str, Port]:
        """Return the ports to log by their names in the result."""
        system = self.plan.system
        if log is None:
            found = [p for b in system.blocks.values() for p in b.outputs()]
            return {p.path: p for p in found}
        if isinstance(log, Mapping):
            return {name: system.port(reference) for name, reference in log.items()}
        names = [str(r) if isinstance(r, str) else r.full_path for r in log]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise SimulationError(f"ports are to be logged twice: {', '.join(twice)}")
        return dict(zip(names, map(system.port, log), strict=True))

    def _executor(self) -> Executor:
        """Return the executor of the backend asked for."""
        if self.backend == "numpy":
            return NumPyExecutor(self.plan, self._quantities)
        programs = self.programs
        compiled = self.backend == "compiled" or (self.backend == "auto" and compiler.available())
        return CompiledExecutor(programs) if compiled else InterpretedExecutor(programs)

    @functools.cached_property
    def programs(self) -> list[Program]:
        """The traced programs of (t, x, d, p)."""
        return self.plan.trace(self._quantities)

    @functools.cached_property
    def fingerprint(self) -> str:
        """A hash of traced equations and sample times; it does not cover code in Python blocks."""
        codes = [p.code for p in self.programs if p.name != "outputs"]
        codes += [
            f"{path} {self.plan.system.clock(b)}" for path, b in self.plan.system.blocks.items()
        ]
        return hashlib.sha256("\0".join(codes).encode()).hexdigest()[:16]

    @functools.cached_property
    def _jacobian(self) -> ca.Function:
        """The exact derivative of dx/dt by x."""
        rates = self.programs[0]
        written_out = rates.function.expand()  # five times faster to evaluate than kernel calls
        arguments = [ca.SX.sym(n, s.numel()) for n, s in zip("txdp", rates.inputs, strict=True)]
        jacobian = ca.jacobian(written_out(*arguments), arguments[1])
        return ca.Function("jacobian", arguments, [jacobian])

    def _jacobian_values(self, t: float, x: Vector, d: Vector, p: Vector) -> Vector:
        return np.asarray(self._jacobian(t, x, d, p).full())

    # -- running --------------------------------------------------------------------------

    def run(
        self,
        duration: float,
        *,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | None = None,
        progress: bool = True,
        stream_to: str | Path | None = None,
    ) -> xr.Dataset:
        """Simulate from time 0.

        Parameters
        ----------
        duration : float
            Time to simulate [s].
        parameters : mapping, optional
            Values of parameters by ``"block.parameter"`` [units as declared].
        initial : mapping, optional
            Initial values of states by ``"block.state"`` [units as declared].
        progress : bool
            Whether runs of more than a second show a progress bar.
        stream_to : path, optional
            netCDF file to log to while the run goes on, so that memory stays constant.

        Returns
        -------
        xarray.Dataset
            What was logged, with units, frames and provenance.

        Raises
        ------
        SimulationError
            If an argument makes no sense.
        DivergenceError
            If a signal stops being finite; what was logged is in its `result`.
        SimulationInterrupted
            On Ctrl-C; what was logged is in its `result`.
        """
        positive(duration=duration)
        if self.step is not None:
            ticks(exact(duration), self.step, "the duration")
        p = self.plan.parameters(parameters or {})
        x, d = self.plan.initial(p, initial or {})
        attributes = provenance() | {
            "diagram": self.plan.name, "diagram_hash": self.fingerprint,
            "solver": self.solver, "backend": self.executor.name,
            "duration": float(duration), "step": float(self.step or 0.0),
            "parameters": json.dumps(self.plan.p.listed(p)),
            "initial_states": json.dumps(self.plan.x.listed(x) | self.plan.memory.listed(d)),
        }  # fmt: skip
        log = (
            Log(self.channels, attributes)
            if stream_to is None
            else StreamedLog(self.channels, attributes, stream_to)
        )
        run = Run(self._prepared, x, d, p, log, exact(duration))
        started = time.perf_counter()
        try:
            with ProgressBar(self.plan.name, duration, progress) as bar:
                (run.fixed if self.solver in FIXED_STEP else run.adaptive)(bar)
        except TrussflowError as error:
            diverged = isinstance(error, DivergenceError)
            error.result = log.finish(status="diverged" if diverged else "failed")
            raise
        except KeyboardInterrupt:
            raise SimulationInterrupted(
                f"stopped at t = {run.time:g} s; the result of this exception holds the log",
                log.finish(status="interrupted"),
            ) from None
        except BaseException:
            log.finish(status="failed")
            raise
        return log.finish(status="complete", wall_time=time.perf_counter() - started)


def simulate(
    diagram: Diagram,
    duration: float,
    *,
    parameters: Mapping[str, Any] | None = None,
    initial: Mapping[str, Any] | None = None,
    progress: bool = True,
    stream_to: str | Path | None = None,
    **settings: Any,
) -> xr.Dataset:
    """Simulate a diagram once; see `Simulator` and `Simulator.run` for the arguments.

    Parameters
    ----------
    diagram : Diagram
        What to simulate.
    duration : float
        Time to simulate [s].
    parameters, initial, progress, stream_to
        As for `Simulator.run`.
    **settings
        As for `Simulator`: step, solver, log, log_step, backend, rtol, atol.

    Returns
    -------
    xarray.Dataset
        What was logged.
    """
    positive(duration=duration)
    return Simulator(diagram, **settings).run(
        duration, parameters=parameters, initial=initial, progress=progress, stream_to=stream_to
    )
