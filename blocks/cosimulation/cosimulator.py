"""Orchestrator of a co-simulation: runs the members of a diagram together."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Collection, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Required, TypedDict, Unpack

import numpy as np

from trussflow.blocks.cosimulation.coupling import COUPLINGS, Coupled, loop_text
from trussflow.blocks.cosimulation.diagram_member import Settings
from trussflow.blocks.cosimulation.network import Network
from trussflow.blocks.cosimulation.partition import partition
from trussflow.blocks.cosimulation.step_control import FixedSteps, StepControl
from trussflow.blocks.errors import AlgebraicLoopError, SimulationError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact, on_grid, refuse_coarse_time, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.results.channels import Chosen, chosen_channels
from trussflow.blocks.results.dataset import provenance
from trussflow.blocks.results.streamed_log import opened
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.support.interrupts import interruptible
from trussflow.blocks.support.progress import RunBar
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.validation import (
    by_name,
    one_of,
    positive,
    positive_if_given,
    shown,
    yes_or_no,
)

if TYPE_CHECKING:
    import xarray as xr


class MemberSettings(TypedDict, total=False):
    """Settings of the `Solver` for blocks that are not FMUs, except its step."""

    solver: str
    backend: str
    rtol: float
    atol: float


class CoSimulatorSettings(MemberSettings, total=False):
    """Settings of a `CoSimulator`."""

    step: Required[float]
    members: Sequence[str | Block]
    coupling: str
    tolerance: float | None
    largest_step: float | None
    log: Chosen | None
    log_step: float | None
    solver_step: float | None
    parameters: Mapping[str, Any] | None
    initial: Mapping[str, Any] | None


DIVISOR_ADVICE = "use a step that divides it"


class CoSimulator(Described):
    """A diagram prepared for co-simulation, which can run any number of times.

    Each FMU is a member, which is a subsystem of the co-simulation. All other blocks form one more member,
    compiled and integrated as in a `Simulator`. Blocks and diagrams in `members` become separate members.
    Members exchange signals only at communication points.

    Parameters
    ----------
    diagram : Diagram
        Diagram to simulate.
    step : float
        Time between communication points [s]; with `tolerance`, the smallest step.
    members : sequence of str or Block
        Blocks and inner diagrams that become separate members, by path or as objects. They come first in
        the order of the members, then FMUs, then all other blocks, which may be named ``"the rest"``.
    coupling : str
        ``"jacobi"``: in each step, all members read the outputs of the others at the start of the step.
        ``"gauss-seidel"``: members are advanced in their order, and read the outputs of earlier members at the
        end of the step. ``"iterate"``: the step is repeated from snapshots until all members read the
        outputs of the others at the end of the step.
    tolerance : float, optional
        Tolerance for variable communication steps [-]: the errors of all steps, estimated by step
        doubling, add up to at most this value, relative to the largest magnitude of each signal. A
        thousandth of it is added as absolute tolerance for signals near zero [unit of the signal].
    largest_step : float, optional
        With `tolerance`, the largest time between communication points [s]; by default a tenth of
        the run.
    log : mapping, sequence or None
        Ports to log, as for `Simulator`; None logs every output.
    log_step : float, optional
        Time between logged instants [s], a multiple of `step`; by default every communication
        point. Not with `tolerance`.
    solver_step : float, optional
        Step of fixed-step solvers [s]; by default the smallest communication step.
    parameters, initial : mapping, optional
        Values of parameters and of initial states, by ``"block.name"`` [units as declared].
    **settings
        Settings of the `Solver` for blocks that are not FMUs: solver, backend, rtol, atol.

    Raises
    ------
    SimulationError
        If an argument is not allowed.
    AlgebraicLoopError
        If there is a loop through the direct feedthrough of members, unless iteration solves it.
    DiagramError
        If the diagram cannot be built.
    NameLookupError
        If there is no such block, port, parameter or state.

    Notes
    -----
    At a communication point all signals are consistent, as in a simulation of one diagram: direct
    feedthrough is followed from member to member. Between two points, members do not exchange signals, and
    inputs are held, so the error is proportional to the step H. Held inputs are on average half a step old,
    which reduces the phase of a loop at w [rad/s] by ``w H / 2`` radians. The outputs of an FMU that does
    not follow its inputs before the next step are those
    of the previous point: one more step of delay.
    """

    @interruptible()
    def __init__(
        self,
        diagram: Diagram,
        *,
        step: float,
        members: Sequence[str | Block] = (),
        coupling: str = "jacobi",
        tolerance: float | None = None,
        largest_step: float | None = None,
        log: Chosen | None = None,
        log_step: float | None = None,
        solver_step: float | None = None,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | None = None,
        **settings: Unpack[MemberSettings],
    ) -> None:
        positive(step=step)
        positive_if_given(
            tolerance=tolerance,
            log_step=log_step,
            solver_step=solver_step,
            largest_step=largest_step,
        )
        one_of("coupling", coupling, COUPLINGS)
        if isinstance(members, str) or not isinstance(members, Collection):
            raise SimulationError(
                f"members = {shown(members)} must be a list: members=[{shown(members)}]"
            )
        self._step = self._grid = exact(step)
        self._tolerance = tolerance
        if tolerance is not None:
            if log_step is not None:
                raise SimulationError(
                    "log_step and tolerance exclude each other: with a tolerance, the log contains "
                    "the communication points of the step control"
                )
            # Step doubling takes each step also as two halves, which
            # must be on the grid.
            self._grid = self._step / 2
        elif largest_step is not None:
            raise SimulationError(
                f"largest_step = {largest_step!r} has no meaning without tolerance=..., which enables the "
                "step control"
            )
        if largest_step is not None and largest_step < step:
            raise SimulationError(
                f"largest_step = {largest_step!r} must be at least step = {step!r}, the smallest step"
            )
        self._longest = (
            None if largest_step is None else int(exact(largest_step) / self._grid)
        )
        self._log_every = (
            1
            if log_step is None
            else ticks(exact(log_step), self._step, "log_step", DIVISOR_ADVICE)
        )
        # Members integrate whole steps between two points of the grid.
        inner = self._grid if solver_step is None else exact(solver_step)
        ticks(self._grid, inner, "the smallest communication step", DIVISOR_ADVICE)
        self._settings = Settings(
            solver=Solver.of(
                {**settings, "step": float(inner)}, *CoSimulatorSettings.__annotations__
            ),
            parameters=by_name("parameters", parameters),
            initial=by_name("initial states", initial),
        )
        system = flatten(diagram)
        self.name = diagram.name
        self.channels = chosen_channels(system, log)
        logged = [channel.port for channel in self.channels]
        self.network = Network(partition(system, members, logged, self._settings))
        self._coupling = coupling
        if self.network.loop and coupling != "iterate":
            raise AlgebraicLoopError(
                f'{loop_text(self.network)}solve it in every step with coupling="iterate", make one '
                "member of the blocks in it, or break it with a state or a UnitDelay"
            )
        places = map(self.network.places, logged)
        # Places of all logged numbers among the signals: one call of
        # take() fills a row.
        self._logged = np.fromiter(chain.from_iterable(places), np.int64)

    def _described(self) -> Description:
        facts = {
            "members": ", ".join(self.members),
            "coupling": f"{self._coupling}, step {float(self._step):g} s",
            "shows": ", ".join(channel.name for channel in self.channels),
        }
        return Description(f"CoSimulator of '{self.name}'", facts)

    @property
    def members(self) -> list[str]:
        """Names of the members."""
        return [member.name for member in self.network.members]

    # -- running --------------------------------------------------------------------------------

    def run(
        self,
        duration: float,
        *,
        progress: bool = True,
        stream_to: str | Path | None = None,
        not_finite: str = "warn",
    ) -> xr.Dataset:
        """Simulate from time 0.

        Parameters
        ----------
        duration : float
            Time to simulate [s].
        progress : bool
            Whether runs of more than a second show a progress bar.
        stream_to : path, optional
            netCDF file to log to during the run, for constant memory.
        not_finite : str
            Policy for a logged output that is not finite, as for `Simulator.run`.

        Returns
        -------
        xarray.Dataset
            Logged data, with members, frames and provenance.

        Raises
        ------
        SimulationError
            If an argument is not allowed, a member rejects a step, or an iteration does not converge.
        DivergenceError
            If a signal is not finite; its `result` has the logged data.
        SimulationInterrupted
            On Ctrl-C; its `result` has the logged data.
        """
        positive(duration=duration)
        yes_or_no("a run", "progress", progress)
        end = on_grid(exact(duration), self._step)
        refuse_coarse_time(float(end), self._grid)
        ticks(end, self._step, "the duration", DIVISOR_ADVICE)
        last = int(end / self._grid)
        attributes = self._attributes(duration)
        log = opened(self.channels, attributes, stream_to, not_finite)
        coupled = Coupled(self.network, self._coupling, self._grid)
        started = time.perf_counter()
        control = self._control(coupled, last)
        shown = 0.0

        def reached() -> None:
            """Log the present signals, if logging is due."""
            nonlocal shown
            if coupled.k % self._log_every == 0 or coupled.k == last:
                # With mode="raise", the default, NumPy would copy through a buffer.
                coupled.signals.take(self._logged, out=log.reserve(1)[0], mode="clip")
                log.keep(coupled.time)
            bar.update(coupled.time - shown)
            shown = coupled.time

        try:
            with interruptible(), RunBar(self.name, duration, progress) as bar:
                coupled.start()
                reached()
                control.run(last, reached)
            messages = coupled.messages  # FMUs discard them when they are closed
            coupled.close()
            counts = control.steps | {"iterations": coupled.iterations}
            return log.complete(
                messages, wall_time=time.perf_counter() - started, **counts
            )
        except BaseException as error:  # noqa: BLE001 - raised again with the log
            messages = coupled.messages
            with contextlib.suppress(Exception):  # the first error is reported
                coupled.close()
            counts = control.steps | {"iterations": coupled.iterations}
            return log.abandon(error, log.last, messages, **counts)

    def _control(self, coupled: Coupled, last: int) -> FixedSteps:
        """Return the step control: fixed steps, or steps by the tolerance."""
        if self._tolerance is None:
            return FixedSteps(coupled)
        # The shortest step of the control is two steps of the grid.
        longest = self._longest or max(2, last // 10)
        return StepControl(coupled, self._tolerance, longest)

    def _attributes(self, duration: float) -> dict[str, Any]:
        members = self.network.members
        parameters = {
            name: value
            for member in members
            for name, value in member.parameters.items()
        }
        return provenance() | {
            "diagram": self.name,
            "diagram_hash": " ".join(member.fingerprint for member in members),
            "members": json.dumps(self.members),
            "coupling": self._coupling,
            "communication_step": float(self._step),
            "tolerance": self._tolerance or 0.0,
            "solver": self._settings.solver.solver,
            "step": self._settings.solver.step,
            "duration": float(duration),
            "parameters": json.dumps(parameters),
            "initial_states": json.dumps(
                {k: np.asarray(v).tolist() for k, v in self._settings.initial.items()}
            ),
        }


def cosimulate(
    diagram: Diagram,
    duration: float,
    *,
    progress: bool = True,
    stream_to: str | Path | None = None,
    not_finite: str = "warn",
    **settings: Unpack[CoSimulatorSettings],
) -> xr.Dataset:
    """Run the members of a diagram together once; see `CoSimulator` for the settings.

    Parameters
    ----------
    diagram : Diagram
        Diagram to simulate.
    duration : float
        Time to simulate [s].
    progress, stream_to, not_finite
        As for `CoSimulator.run`.
    **settings
        As for `CoSimulator`: step, members, coupling, tolerance and others.

    Returns
    -------
    xarray.Dataset
        Logged data.

    Examples
    --------
    >>> from trussflow.blocks import Diagram, Gain, Integrator, cosimulate
    >>> loop = Diagram("decay")
    >>> lag, gain = loop.add(lag=Integrator(1.0), gain=Gain(-1.0))
    >>> _ = lag >> gain >> lag
    >>> result = cosimulate(loop, 1.0, step=0.5, members=["lag"])  # held for 0.5 s: (1 - 0.5)^2
    >>> float(result["lag.y"][-1].round(9))
    0.25
    """
    positive(duration=duration)
    return CoSimulator(diagram, **settings).run(
        duration, progress=progress, stream_to=stream_to, not_finite=not_finite
    )
