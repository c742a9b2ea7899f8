"""The scheduler: runs a diagram from start to end.

Between two instants the continuous blocks are integrated together, as one state vector
under one solver. At an instant, the sampled blocks whose clock ticks compute from the
signals of that instant, all at once; then the results are logged; then time goes on.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trussflow.blocks.framework.clock import exact, on_grid
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.system import System
from trussflow.blocks.framework.validation import positive
from trussflow.blocks.simulation.prepared import Chosen, Prepared
from trussflow.blocks.simulation.progress import ProgressBar
from trussflow.blocks.simulation.results import Log, opened, provenance
from trussflow.blocks.simulation.run import Run

if TYPE_CHECKING:
    import xarray as xr


class Simulator(Prepared):
    """A diagram made ready to run, any number of times.

    Runs with other parameters or initial states need no new tracing or compilation.

    Parameters
    ----------
    diagram : Diagram or System
        What to simulate; inputs of a system from outside stay at their start values.
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
        log: Chosen | None = None,
        log_step: float | None = None,
        backend: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
    ) -> None:
        if log_step is not None:
            positive(log_step=log_step)
        super().__init__(
            diagram, step=step, solver=solver, backend=backend, chosen=log, tolerances=(rtol, atol)
        )
        self.log_step = exact(log_step) if log_step is not None else self.step
        if self.step is not None and self.log_step is not None:
            self.ticks(self.log_step, "log_step")

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
        end = exact(duration)
        if self.step is not None:
            end = on_grid(end, self.step)
            self.ticks(end, "the duration")
        p = self.plan.parameters(parameters or {})
        with self.units.running(p):
            x, d = self.plan.initial(p, initial or {})
            attributes = provenance() | {
                "diagram": self.plan.name,
                "diagram_hash": self.fingerprint,
                "solver": self.solver,
                "backend": self.executor.name,
                "duration": float(duration),
                "step": float(self.step or 0.0),
                "parameters": json.dumps(self.plan.p.listed(p)),
                "initial_states": json.dumps(self.plan.x.listed(x) | self.plan.memory.listed(d)),
            }
            log = opened(self.channels, attributes, stream_to)
            run = Run(self, x, d, p, log, self.log_step or end / 1000)
            return self._to_end(run, log, end, progress)

    def _to_end(self, run: Run, log: Log, end: Fraction, progress: bool) -> xr.Dataset:
        """Run from 0 to the end; whatever happens, finish the log."""
        started = time.perf_counter()
        try:
            with ProgressBar(self.plan.name, float(end), progress) as bar:
                run.advance(end, bar)
                run.finish()
        except BaseException as error:
            log.abandon(error, run.time)
            raise
        return log.finish(status="complete", wall_time=time.perf_counter() - started)


def simulate(
    diagram: Diagram | System,
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
    diagram : Diagram or System
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
