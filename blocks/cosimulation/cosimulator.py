"""The master: runs the units of a diagram together."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.cosimulation.coupling import COUPLINGS, Coupled, Scheme
from trussflow.blocks.cosimulation.diagram_member import Settings
from trussflow.blocks.cosimulation.network import Network
from trussflow.blocks.cosimulation.partition import ordered, partition
from trussflow.blocks.cosimulation.rows import Rows
from trussflow.blocks.cosimulation.slave import StepDiscardedError
from trussflow.blocks.cosimulation.step_control import StepControl
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact, on_grid, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.framework.validation import positive, positive_whole
from trussflow.blocks.simulation.prepared import Chosen, chosen_ports
from trussflow.blocks.simulation.progress import ProgressBar
from trussflow.blocks.simulation.results import channels, opened, provenance

if TYPE_CHECKING:
    import xarray as xr


DIVIDES = "take a step that divides it"


class CoSimulator:
    """The units of a diagram made ready to run together, any number of times.

    FMUs are units by themselves. All other blocks make up one more unit, compiled and integrated
    as in a `Simulator`, unless `units` names some that are to be units of their own. Units see
    each other at communication points only.

    Parameters
    ----------
    diagram : Diagram
        What to simulate.
    step : float
        Time between communication points [s]; with `tolerance`, the smallest that may be chosen.
    units : sequence of str or Block
        Blocks and inner diagrams that become units of their own, by path or as objects.
    coupling : str
        ``"jacobi"``: in each step all units read what the others showed at its start;
        ``"gauss-seidel"``: units are advanced in `order`, and read from those before them what
        these show at its end; ``"iterate"``: the step is repeated from snapshots until all read
        what the others show at its end.
    extrapolation : int
        0: inputs are held between communication points, and the error falls with the step; 1:
        inputs are straight lines, and it falls with the square of the step [-].
    order : sequence of str or Block, optional
        All units in the order in which Gauss-Seidel advances them; by default as in `units`, then
        FMUs, then ``"the rest"``.
    tolerance : float, optional
        Choose communication steps such that their errors, estimated by step doubling, add up to at
        most this, relative to the largest size that each signal had [-].
    absolute_tolerance : float, optional
        What is added to that for signals near zero [unit of the signal]; by default a thousandth
        of `tolerance`.
    largest_step : float, optional
        With `tolerance`, the largest time between communication points to choose [s]; by default
        a tenth of the run.
    iteration_tolerance : float
        Relative change of signals at which an iteration ends [-].
    most_iterations : int
        Rounds after which an iteration gives up [-].
    log : mapping, sequence or None
        Ports to log, as for `Simulator`; None logs every output.
    log_step : float, optional
        Time between logged instants [s], a multiple of `step`; by default every communication
        point. Not with `tolerance`.
    solver, backend : str
        As for `Simulator`, for what is no FMU.
    solver_step : float, optional
        Step of fixed-step solvers [s]; by default the smallest communication step.
    rtol, atol : float
        Tolerances of adaptive solvers [-, unit of the state].
    parameters, initial : mapping, optional
        Values of parameters and of initial states, by ``"block.name"`` [units as declared].

    Raises
    ------
    SimulationError
        If an argument makes no sense, or units cannot be restored but would have to be.
    AlgebraicLoopError
        If there is a loop through the direct feedthrough of units, unless iteration solves it.
    DiagramError
        If the diagram cannot be built.
    NameLookupError
        If there is no such block, port, parameter or state.

    Notes
    -----
    At a communication point all signals fit each other, as in a whole run: direct feedthrough is
    followed from unit to unit. Between two points a unit does not see what the others do; held
    inputs are on average half a step old, which takes ``w H / 2`` radians of phase from a loop at
    w [rad/s]. FMUs that do not follow their inputs before the next step show what they did at the
    point before: one more step of delay.
    """

    def __init__(
        self,
        diagram: Diagram,
        *,
        step: float,
        units: Sequence[str | Block] = (),
        coupling: str = "jacobi",
        extrapolation: int = 0,
        order: Sequence[str | Block] | None = None,
        tolerance: float | None = None,
        absolute_tolerance: float | None = None,
        largest_step: float | None = None,
        iteration_tolerance: float = 1e-10,
        most_iterations: int = 50,
        log: Chosen | None = None,
        log_step: float | None = None,
        solver: str = "rk4",
        solver_step: float | None = None,
        backend: str = "auto",
        rtol: float = 1e-8,
        atol: float = 1e-10,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | None = None,
    ) -> None:
        positive(step=step, iteration_tolerance=iteration_tolerance)
        positive_whole(most_iterations=most_iterations)
        for name, listed in (("units", units), ("order", order)):
            if isinstance(listed, str):
                raise SimulationError(f"{name} = {listed!r} must be a list: {name}=[{listed!r}]")
        for name, value in (("absolute_tolerance", absolute_tolerance), ("largest_step", largest_step)):
            if tolerance is None and value is not None:
                raise SimulationError(
                    f"{name} = {value!r} has no meaning without tolerance=..., which lets the steps be chosen"
                )
        if coupling not in COUPLINGS:
            raise SimulationError(f"unknown coupling {coupling!r}; choose from: {', '.join(COUPLINGS)}")
        if extrapolation not in (0, 1):
            raise SimulationError(f"extrapolation = {extrapolation!r} must be 0 or 1")
        self._tolerances = None
        if tolerance is not None:
            positive(tolerance=tolerance)
            absolute = 1e-3 * tolerance if absolute_tolerance is None else absolute_tolerance
            positive(absolute_tolerance=absolute)
            self._tolerances = float(tolerance), float(absolute)
        self._step = exact(step)
        self._grid = self._step if tolerance is None else self._step / 2
        self._longest = None
        if largest_step is not None:
            positive(largest_step=largest_step)
            self._longest = int(exact(largest_step) / self._grid)
        self._log_every = 1
        if log_step is not None:
            positive(log_step=log_step)
            if tolerance is not None:
                raise SimulationError(
                    "log_step and tolerance do not go together: with a tolerance, the log holds "
                    "the communication points that were chosen"
                )
            self._log_every = ticks(exact(log_step), self._step, "log_step", DIVIDES)
        inner = self._grid if solver_step is None else exact(solver_step)
        if solver_step is not None:
            positive(solver_step=solver_step)
            ticks(self._grid, inner, "the smallest communication step", DIVIDES)
        self._settings = Settings(
            step=float(inner),
            solver=solver,
            backend=backend,
            tolerances=(rtol, atol),
            lines=extrapolation == 1,
            parameters=parameters or {},
            initial=initial or {},
        )
        system = flatten(diagram)
        ports = chosen_ports(system, log)
        self.name = diagram.name
        self.channels = channels(ports)
        self.network = Network(partition(system, units, list(ports.values()), self._settings))
        names = [unit.name for unit in self.network.units]
        scheme = Scheme(coupling, extrapolation, ordered(names, order), iteration_tolerance, most_iterations)
        self._coupled = Coupled(self.network, scheme, self._grid)
        if tolerance is not None:
            self._check_free_steps()
        self._logged = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(self.network.places(p) for p in ports.values())]
        )

    def _check_free_steps(self) -> None:
        """Refuse units that cannot have steps chosen for them.

        Raises
        ------
        SimulationError
            Naming them.
        """
        same = [f"'{unit.name}'" for unit in self.network.units if not unit.slave.varies]
        for names, what in (
            (self._coupled.unrestorable(), "cannot go back to an earlier state"),
            (same, "take steps of one length only"),
        ):
            if names:
                raise SimulationError(
                    f"cannot choose steps by a tolerance: these units {what}: "
                    f"{', '.join(names)}; take a fixed step"
                )

    @property
    def units(self) -> list[str]:
        """Names of the units."""
        return [unit.name for unit in self.network.units]

    # -- running --------------------------------------------------------------------------------

    def run(
        self, duration: float, *, progress: bool = True, stream_to: str | Path | None = None
    ) -> xr.Dataset:
        """Simulate from time 0.

        Parameters
        ----------
        duration : float
            Time to simulate [s].
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
            If an argument makes no sense, a unit refuses a step, or an iteration does not converge.
        DivergenceError
            If a signal stops being finite; what was logged is in its `result`.
        SimulationInterrupted
            On Ctrl-C; what was logged is in its `result`.
        """
        positive(duration=duration)
        end = on_grid(exact(duration), self._step)
        last = ticks(end, self._step, "the duration", DIVIDES)
        attributes = self._attributes(duration)
        log = opened(self.channels, attributes, stream_to)
        coupled, started = self._coupled, time.perf_counter()
        steps = {"communication_steps": 0, "rejected_steps": 0, "discarded_steps": 0}
        rows = Rows(log, self._logged, coupled)
        try:
            with ProgressBar(self.name, duration, progress) as bar:
                coupled.start()
                rows.take()
                (self._fixed if self._tolerances is None else self._controlled)(last, rows, bar, steps)
            rows.flush()
            coupled.stop()
        except BaseException as error:
            rows.flush()
            self._stop_quietly()
            log.abandon(error, rows.time, **steps, iterations=coupled.iterations)
            raise
        elapsed = time.perf_counter() - started
        return log.finish(status="complete", **steps, iterations=coupled.iterations, wall_time=elapsed)

    def _fixed(self, last: int, rows: Rows, bar: ProgressBar, steps: dict[str, int]) -> None:
        """Take steps of equal length."""
        coupled, every, length = self._coupled, self._log_every, float(self._step)
        while coupled.k < last:
            try:
                coupled.step(1)
            except StepDiscardedError as error:
                raise SimulationError(
                    f"{error}; steps are fixed here: take a smaller one, or let them be chosen "
                    "with tolerance=..."
                ) from error
            steps["communication_steps"] += 1
            if coupled.k % every == 0 or coupled.k == last:
                rows.take()
            bar.update(length)

    def _controlled(self, last: int, rows: Rows, bar: ProgressBar, steps: dict[str, int]) -> None:
        """Choose the steps."""
        assert self._tolerances is not None
        control = StepControl(
            self._coupled, *self._tolerances, longest=self._longest or max(2, 2 * last // 10)
        )

        def reached() -> None:
            before = rows.time
            rows.take()
            bar.update(rows.time - before)

        try:
            control.run(2 * last, reached)
        finally:
            steps["communication_steps"] = 2 * control.accepted
            steps["rejected_steps"] = control.rejected
            steps["discarded_steps"] = control.discarded

    def _stop_quietly(self) -> None:
        """End all units after an error, which is the one to see."""
        with contextlib.suppress(Exception):
            self._coupled.stop()

    def _attributes(self, duration: float) -> dict[str, Any]:
        scheme = self._coupled.scheme
        units = self.network.units
        parameters = {name: value for unit in units for name, value in unit.parameters.items()}
        return provenance() | {
            "diagram": self.name,
            "diagram_hash": " ".join(unit.fingerprint for unit in units),
            "units": json.dumps(self.units),
            "coupling": scheme.coupling,
            "extrapolation": scheme.extrapolation,
            "order": json.dumps([self.units[i] for i in scheme.order]),
            "communication_step": float(self._step),
            "tolerance": 0.0 if self._tolerances is None else self._tolerances[0],
            "solver": self._settings.solver,
            "step": self._settings.step,
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
    **settings: Any,
) -> xr.Dataset:
    """Run the units of a diagram together once; see `CoSimulator` for the settings.

    Parameters
    ----------
    diagram : Diagram
        What to simulate.
    duration : float
        Time to simulate [s].
    progress, stream_to
        As for `CoSimulator.run`.
    **settings
        As for `CoSimulator`: step, units, coupling, extrapolation, order, tolerance and others.

    Returns
    -------
    xarray.Dataset
        What was logged.

    Examples
    --------
    >>> from trussflow.blocks import Diagram, Gain, Integrator, cosimulate
    >>> loop = Diagram("decay")
    >>> lag, gain = loop.add(lag=Integrator(1.0), gain=Gain(-1.0))
    >>> _ = lag >> gain >> lag
    >>> result = cosimulate(loop, 1.0, step=0.5, units=["lag"])  # held for 0.5 s: (1 - 0.5)^2
    >>> float(result["lag.y"][-1].round(9))
    0.25
    """
    positive(duration=duration)
    return CoSimulator(diagram, **settings).run(duration, progress=progress, stream_to=stream_to)
