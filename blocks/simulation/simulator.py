"""The simulator: runs a diagram from start to end.

Between two instants, the continuous blocks are integrated together, as one state vector
with one solver. At an instant, all sampled blocks whose clock ticks compute from the
signals of that instant. Then the results are logged, and the integration continues.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.clock import exact, on_grid, refuse_coarse_time, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.system import System
from trussflow.blocks.results.channels import Chosen
from trussflow.blocks.results.dataset import provenance
from trussflow.blocks.results.streamed_log import opened
from trussflow.blocks.simulation.prepared import Prepared, digest
from trussflow.blocks.simulation.run import Run
from trussflow.blocks.simulation.solver import (
    Solver,
    SolverSettings,
    refuse_unknown,
    spelled_out,
)
from trussflow.blocks.simulation.step_size_warnings import warn_of_missed_jumps
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import (
    finite_array,
    positive,
    positive_if_given,
    yes_or_no,
)

if TYPE_CHECKING:
    import xarray as xr


class SimulatorSettings(SolverSettings, total=False):
    """Settings of a `Simulator`: those of its `Solver`, and of its log."""

    log: Chosen | None
    log_step: float | None


class OpeningSettings(TypedDict, total=False):
    """Arguments of `Simulator.opened` besides the duration."""

    parameters: Mapping[str, Any] | None
    initial: Mapping[str, Any] | None
    start: float
    stream_to: str | Path | None
    checkpoint_every: float | None
    resume: bool
    not_finite: str


class Simulator(Described):
    """A prepared diagram, for any number of runs, also at the same time.

    Runs with other parameters or initial states need no new tracing or compilation.

    Parameters
    ----------
    diagram : Diagram or System
        Block or diagram to simulate; external inputs keep their start values.
    log : mapping, sequence or None
        Signals to log: ports, as ports or ``"block.port"``, and states, ``"block.state"``, optionally by
        the name wanted in the result; None logs every output.
    log_step : float, optional
        Time between logged instants [s]; by default every step, or a thousandth of the run.
    step, solver, backend, rtol, atol
        Of the `Solver` [s, -, -, -, unit of the state].

    Attributes
    ----------
    prepared : Prepared
        Data shared by its runs.

    Raises
    ------
    SimulationError
        If an argument is invalid.
    DiagramError
        If the diagram cannot be built: open inputs, algebraic loops.
    TracingError
        If the equations of a block cannot be traced.
    """

    @spelled_out(SolverSettings)
    def __init__(
        self,
        diagram: Diagram | System,
        *,
        log: Chosen | None = None,
        log_step: float | None = None,
        **settings: Unpack[SolverSettings],
    ) -> None:
        positive_if_given(log_step=log_step)
        self._rebuild = partial(
            Simulator, diagram, log=log, log_step=log_step, **settings
        )
        self.prepared = Prepared.of(
            diagram, Solver.of(settings, "log", "log_step"), log
        )
        # None for an adaptive solver: then `opened` takes a thousandth of the run.
        self.log_step = exact(log_step) if log_step is not None else self.prepared.step
        if self.prepared.step is not None and self.log_step is not None:
            ticks(self.log_step, self.prepared.tick, "log_step")

    def __reduce__(self) -> tuple[Callable[[], Simulator], tuple[()]]:
        """Pickle and copy the arguments of the constructor: compiled code belongs to one process."""
        return self._rebuild, ()

    def _described(self) -> Description:
        return self.prepared.described("Simulator")

    # -- running --------------------------------------------------------------------------

    @contextlib.contextmanager
    def opened(
        self,
        duration: float,
        *,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | None = None,
        start: float = 0.0,
        stream_to: str | Path | None = None,
        checkpoint_every: float | None = None,
        resume: bool = False,
        not_finite: str = "warn",
    ) -> Iterator[Run]:
        """Open a run at its initial time, for the duration of a ``with`` block.

        Parameters
        ----------
        duration, parameters, initial, start, stream_to, checkpoint_every, resume, not_finite
            As for `run` [duration, start, checkpoint_every: s].

        Yields
        ------
        Run
            The run, for `Run.to_end`.
        """
        positive(duration=duration)
        positive_if_given(checkpoint_every=checkpoint_every)
        yes_or_no("a run", "resume", resume)
        if (stream_to is None and checkpoint_every is not None) or (
            resume and checkpoint_every is None
        ):
            raise SimulationError(
                "a run is resumed from checkpoints, which are kept beside the file that it streams to: give "
                'stream_to="file.nc", and checkpoint_every=..., in seconds of simulated time'
            )
        prepared = self.prepared
        plan = prepared.plan
        length = exact(duration)
        begin = exact(finite_array("start", start, ()).item())
        every = None if checkpoint_every is None else exact(checkpoint_every)
        log_step = self.log_step or length / 1000
        shortest = min(
            log_step, prepared.tick if prepared.step or prepared.has_clocks else length
        )
        refuse_coarse_time(abs(float(begin)) + float(length), shortest)
        p = plan.parameters(parameters)
        # A time within 1e-6 steps of the grid counts as on it:
        # users add up times with round-off.
        if prepared.step is not None:
            begin = on_grid(begin, prepared.step)
            length = on_grid(length, prepared.step)
            ticks(begin, prepared.tick, "the start time")
            ticks(length, prepared.tick, "the duration")
            if every is not None:
                every = on_grid(every, prepared.step)
                ticks(every, prepared.tick, "checkpoint_every")
            # Fixed steps alone: an adaptive solver stops at each break point.
            warn_of_missed_jumps(plan, prepared.step, (begin, begin + length), p)
        with contextlib.closing(prepared.open(p)) as executor:
            x, d = plan.initial(
                p, initial, None, float(begin), executor.blocks.equations
            )
            identity, attributes = self.identified(
                duration, log_step, (x, d, p), begin, every
            )
            resumes = identity if resume else None
            yield Run(
                prepared,
                executor,
                x,
                d,
                p,
                log=opened(
                    prepared.channels, attributes, stream_to, not_finite, resumes
                ),
                log_step=log_step,
                origin=begin,
                end=begin + length,
                checkpoint_every=every,
                identity=identity,
            )

    def identified(
        self,
        duration: float,
        log_step: Fraction,
        point: tuple[Vector, Vector, Vector],
        begin: Fraction = Fraction(0),
        every: Fraction | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the identity of a run, and the attributes of its result.

        Parameters
        ----------
        duration : float
            Time to simulate [s].
        log_step, begin, every : Fraction
            Time between logged instants, initial time, and time between checkpoints [s].
        point : tuple of Vector
            States, discrete values and parameters at the initial time [as declared].
        """
        plan, known = self.prepared.plan, self.prepared.identity
        x, d, p = point
        values, states = plan.p.listed(p), plan.x.listed(x)
        # Not all of d: held outputs follow from the states, and
        # inputs keep their start values.
        for layout in (plan.memory, plan.modes, plan.guesses):
            states |= layout.listed(d)
        # Without the duration, since a run may be resumed with a longer one.
        identity = known | {
            "logged_hash": self.prepared.logged,
            "start": float(begin),
            "log": [channel.name for channel in self.prepared.channels],
            "log_step": float(log_step),
            "checkpoint_every": every and float(every),
            **{f"parameter '{name}'": value for name, value in values.items()},
            **{f"initial '{name}'": value for name, value in states.items()},
        }
        everything = json.dumps(identity | {"duration": float(duration)})
        attributes: dict[str, Any] = {
            **provenance(),
            **known,
            "duration": float(duration),
            "parameters": json.dumps(values),
            "initial_states": json.dumps(states),
            "run_hash": digest(everything),
        }
        return identity, attributes

    @spelled_out(OpeningSettings, opened)
    def run(
        self,
        duration: float,
        *,
        progress: bool = True,
        time_limit: float | None = None,
        pace: float | None = None,
        **settings: Unpack[OpeningSettings],
    ) -> xr.Dataset:
        """Simulate.

        Parameters
        ----------
        duration : float
            Time to simulate [s].
        parameters : mapping, optional
            Values of parameters by ``"block.parameter"`` [units as declared].
        initial : mapping, optional
            Initial values of states by ``"block.state"`` [units as declared].
        start : float
            Initial time [s]; sampled blocks and the log count their instants from here.
        progress : bool
            Whether runs of more than a second show a progress bar.
        stream_to : path, optional
            netCDF file to log to during the run, for constant memory.
        checkpoint_every : float, optional
            Simulated time between checkpoints [s], at which all rows and the state of the run are written to
            the disk, beside the file of the log. Adaptive solvers restart at each of them.
        resume : bool
            Whether to continue from the last checkpoint of the same run, if there is one, after a kill, Ctrl-C,
            a full disk or a time limit. The result is that of a run without a stop, bit for bit. A complete
            file of the same run is returned without a run. If there is neither, the run starts again.
        not_finite : str
            Reaction if a logged output becomes non-finite while the states do not: ``"warn"`` of the
            first one when the run is complete, ``"stop"``, or ``"ignore"``. Logged rows are
            checked about 1000 at a time: the run stops after that, and the rows after the fault are dropped.
        time_limit : float, optional
            Wall time limit of the run [s], checked between steps.
        pace : float, optional
            Simulated seconds in a second of wall time [-]; by default a run is as fast as possible. The run waits
            after each step, or after the steps of a millisecond if they are shorter. A delay is made up for. The
            attributes of the result have ``overruns``, the number of waits that came more than a millisecond too
            late, and ``largest_delay`` [s], of which a run warns above 0.1 s.

        Returns
        -------
        xarray.Dataset
            Logged data, with units, frames and provenance.

        Raises
        ------
        SimulationError
            If an argument is invalid.
        DivergenceError
            If a state stops being finite, or an output with ``not_finite="stop"``; the logged data
            are in its `result`.
        SimulationInterrupted
            On Ctrl-C; the logged data are in its `result`.
        TimeLimitError
            If the run exceeds its time limit; the logged data are in its `result`.
        """
        refuse_unknown(settings, RunSettings.__annotations__)
        positive_if_given(time_limit=time_limit, pace=pace)
        yes_or_no("a run", "progress", progress)
        with self.opened(duration, **settings) as run:
            return run.to_end(progress, time_limit, pace)


class RunSettings(OpeningSettings, total=False):
    """Arguments of `Simulator.run` besides the duration."""

    progress: bool
    time_limit: float | None
    pace: float | None


class SimulateSettings(RunSettings, SimulatorSettings, total=False):
    """Settings of `simulate`: those of the run, and of its `Simulator`."""


@spelled_out(SimulateSettings, Simulator.run)
def simulate(
    diagram: Diagram | System, duration: float, **settings: Unpack[SimulateSettings]
) -> xr.Dataset:
    """Simulate a diagram once; see `Simulator` and `Simulator.run` for the arguments.

    Parameters
    ----------
    diagram : Diagram or System
        Block or diagram to simulate.
    duration : float
        Time to simulate [s].
    parameters, initial, start, progress, stream_to, checkpoint_every, resume, not_finite, time_limit, pace
        As for `Simulator.run` [start, checkpoint_every, time_limit: s; pace: -].
    log, log_step
        As for `Simulator` [log_step: s].
    step, solver, backend, rtol, atol
        Of the `Solver` [s, -, -, -, unit of the state].

    Returns
    -------
    xarray.Dataset
        Logged data.
    """
    positive(duration=duration)
    refuse_unknown(
        settings, [*SimulatorSettings.__annotations__, *RunSettings.__annotations__]
    )
    others: dict[str, Any] = {**settings}
    of_run = {
        name: others.pop(name) for name in RunSettings.__annotations__ if name in others
    }
    return Simulator(diagram, **others).run(duration, **of_run)
