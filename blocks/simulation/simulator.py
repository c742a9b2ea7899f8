"""The scheduler: runs a diagram from start to end.

Between two instants the continuous blocks are integrated together, as one state vector
under one solver. At an instant, the sampled blocks whose clock ticks compute from the
signals of that instant, all at once; then the results are logged; then time goes on.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from trussflow.blocks.framework.clock import exact, on_grid
from trussflow.blocks.framework.described import Described, Description
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.interrupts import interruptible
from trussflow.blocks.framework.system import System
from trussflow.blocks.framework.validation import positive, positive_if_given, yes_or_no
from trussflow.blocks.simulation.channels import Chosen
from trussflow.blocks.simulation.log import Log
from trussflow.blocks.simulation.missed_jumps import warn_of_missed_jumps
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.progress import ProgressBar
from trussflow.blocks.simulation.results import provenance
from trussflow.blocks.simulation.run import Run
from trussflow.blocks.simulation.solver import Solver, SolverSettings, refuse_unknown
from trussflow.blocks.simulation.streamed_log import opened

if TYPE_CHECKING:
    import xarray as xr


class SimulatorSettings(SolverSettings, total=False):
    """The settings of a `Simulator`: those of its `Solver`, and what it logs."""

    log: Chosen | None
    log_step: float | None


class Simulator(Described):
    """A diagram made ready to run, any number of times, also at once.

    Runs with other parameters or initial states need no new tracing or compilation.

    Parameters
    ----------
    diagram : Diagram or System
        What to simulate; inputs of a system from outside stay at their start values.
    log : mapping, sequence or None
        Ports to log, as ports or ``"block.port"``, optionally by the name wanted in the
        result; None logs every output.
    log_step : float, optional
        Time between logged instants [s]; by default every step, or a thousandth of the run.
    **settings
        Of the `Solver`: step, solver, backend, rtol, atol.

    Attributes
    ----------
    prepared : Prepared
        What its runs have in common.

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
        log: Chosen | None = None,
        log_step: float | None = None,
        **settings: Unpack[SolverSettings],
    ) -> None:
        positive_if_given(log_step=log_step)
        self._rebuild = partial(Simulator, diagram, log=log, log_step=log_step, **settings)
        self.prepared = Prepared(diagram, Solver.of(settings, "log", "log_step"), log)
        self.log_step = exact(log_step) if log_step is not None else self.prepared.step
        if self.prepared.step is not None and self.log_step is not None:
            self.prepared.ticks(self.log_step, "log_step")

    def __reduce__(self) -> tuple[Callable[[], Simulator], tuple[()]]:
        """Pickle and copy as what it was made of: compiled code belongs to one process."""
        return self._rebuild, ()

    def _described(self) -> Description:
        return self.prepared.described("Simulator")

    # -- running --------------------------------------------------------------------------

    def run(
        self,
        duration: float,
        *,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | None = None,
        progress: bool = True,
        stream_to: str | Path | None = None,
        not_finite: str = "warn",
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
        not_finite : str
            What to do if a logged output stops being finite while the states do not: ``"warn"`` of the
            first one when the run is complete, ``"stop"``, or ``"ignore"``. Logged rows are looked at
            some 1000 at a time: a run goes on that long, and the rows after the fault are dropped.

        Returns
        -------
        xarray.Dataset
            What was logged, with units, frames and provenance.

        Raises
        ------
        SimulationError
            If an argument makes no sense.
        DivergenceError
            If a state stops being finite, or an output with ``not_finite="stop"``; what was logged is
            in its `result`.
        SimulationInterrupted
            On Ctrl-C; what was logged is in its `result`.
        """
        positive(duration=duration)
        yes_or_no("a run", "progress", progress)
        prepared = self.prepared
        plan, end = prepared.plan, exact(duration)
        p = plan.parameters(parameters)
        if prepared.step is not None:
            end = on_grid(end, prepared.step)
            prepared.ticks(end, "the duration")
            warn_of_missed_jumps(plan, prepared.step, end, p)
        with contextlib.closing(prepared.open(p)) as executor:
            x, d = plan.initial(p, initial, opened=executor.blocks.equations)
            attributes = provenance() | {
                "diagram": plan.name,
                "diagram_hash": prepared.fingerprint,
                "solver": prepared.solver.solver,
                "backend": executor.name,
                "duration": float(duration),
                "step": float(prepared.step or 0.0),
                "parameters": json.dumps(plan.p.listed(p)),
                "initial_states": json.dumps(plan.x.listed(x) | plan.memory.listed(d)),
            }
            log = opened(prepared.channels, attributes, stream_to, not_finite)
            run = Run(prepared, executor, x, d, p, log, self.log_step or end / 1000)
            return _to_end(run, log, end, progress)


def _to_end(run: Run, log: Log, end: Fraction, progress: bool) -> xr.Dataset:
    """Run from 0 to the end; whatever happens, finish the log."""
    started = time.perf_counter()
    try:
        with interruptible(), ProgressBar(run.prepared.plan.name, float(end), progress) as bar:
            run.advance(end, bar)
            run.finish()
        wall_time = time.perf_counter() - started
        return log.complete(run.executor.blocks.messages, wall_time=wall_time)
    except BaseException as error:
        log.abandon(error, run.time, run.executor.blocks.messages)
        raise


def simulate(
    diagram: Diagram | System,
    duration: float,
    *,
    parameters: Mapping[str, Any] | None = None,
    initial: Mapping[str, Any] | None = None,
    progress: bool = True,
    stream_to: str | Path | None = None,
    not_finite: str = "warn",
    **settings: Unpack[SimulatorSettings],
) -> xr.Dataset:
    """Simulate a diagram once; see `Simulator` and `Simulator.run` for the arguments.

    Parameters
    ----------
    diagram : Diagram or System
        What to simulate.
    duration : float
        Time to simulate [s].
    parameters, initial, progress, stream_to, not_finite
        As for `Simulator.run`.
    **settings
        As for `Simulator`: log, log_step, and those of the `Solver`: step, solver, backend, rtol,
        atol.

    Returns
    -------
    xarray.Dataset
        What was logged.
    """
    positive(duration=duration)
    own = ("parameters", "initial", "progress", "stream_to", "not_finite")
    refuse_unknown(settings, [*SimulatorSettings.__annotations__, *own])
    return Simulator(diagram, **settings).run(
        duration,
        parameters=parameters,
        initial=initial,
        progress=progress,
        stream_to=stream_to,
        not_finite=not_finite,
    )
