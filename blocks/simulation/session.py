"""Sessions: stepwise runs of a block or a diagram, with inputs from outside.

At each communication point the order is: read the outputs, set inputs, advance. Inputs are held
between two points. A sampled block whose clock ticks at a point computes when the session is
advanced from there, so it reads the inputs set at that point, not the earlier ones.

Outputs are those of the present time with the present inputs. Outputs with direct feedthrough follow
an input without delay, also those of sampled blocks that are due at this time. So they are equal to the
logged signals of a run. Therefore `output` of a Python block is called each time that outputs are read;
`update` is called once, when the session is advanced.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Unpack

import numpy as np

from trussflow.blocks.errors import SimulationError, TrussflowError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import (
    SNAP,
    exact,
    refuse_coarse_time,
    ticks,
    written,
)
from trussflow.blocks.framework.declarations import TIMED
from trussflow.blocks.framework.system import System, flatten
from trussflow.blocks.results.channels import Chosen
from trussflow.blocks.results.state_file import Snapshot, read_state, write_state
from trussflow.blocks.simulation.pacing import Pacer
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.run import Run
from trussflow.blocks.simulation.solver import Solver, SolverSettings, spelled_out
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import by_name, positive_if_given, shown

TICK_TOLERANCE = float(SNAP)
"""Distance from a tick below which a time is that of the tick [ticks]."""


class Session(Described):
    """A block or diagram that is advanced step by step, with inputs set in between.

    Parameters
    ----------
    item : Block or System
        A diagram, whose exposed inputs are then set from outside, or a single block; or a system.
    outputs : mapping or sequence, optional
        Ports to read, as for the log of a `Simulator`; by default the exposed outputs.
    step, solver, backend, rtol, atol
        Of the `Solver` [s, -, -, -, unit of the state]; adaptive solvers restart at each point.

    Attributes
    ----------
    prepared : Prepared
        Data shared with its twins: the plan, its layouts, the channels.
    fault : str
        Message of the exception of the last advance, if it failed.

    Raises
    ------
    SimulationError
        If an argument is invalid.
    DiagramError
        If the diagram cannot be built: open inputs that are not exposed, algebraic loops.
    TracingError
        If the equations of a block cannot be traced.

    Examples
    --------
    >>> from trussflow.blocks import Integrator, Session
    >>> with Session(Integrator(), step=0.1) as session:
    ...     session.set(u=2.0)
    ...     session.advance(0.5)
    ...     float(session.outputs["y"].round(12))
    1.0
    """

    @spelled_out(SolverSettings)
    def __init__(
        self,
        item: Block | System,
        *,
        outputs: Chosen | None = None,
        **settings: Unpack[SolverSettings],
    ) -> None:
        solver = Solver.of(settings, "outputs")
        self._rebuild = partial(Session, item, outputs=outputs, **settings)
        system = item if isinstance(item, System) else flatten(item, external=True)
        chosen = (
            [port.name for port in system.root.outputs()]
            if outputs is None
            else outputs
        )
        self._share(Prepared.of(system, solver, chosen))

    def _share(self, prepared: Prepared) -> None:
        self.prepared = prepared
        self._is_fixed = prepared.solver.is_fixed
        self._has_grid = self._is_fixed or prepared.has_clocks
        self._u_start = prepared.plan.u_start
        self._run: Run | None = None
        self.fault = ""

    @classmethod
    def of(cls, prepared: Prepared) -> Session:
        """Return a session of a diagram that is `prepared`."""
        # No run changes `prepared`.
        found = cls.__new__(cls)
        found._rebuild = partial(cls.of, prepared)
        found._share(prepared)
        return found

    def twin(self) -> Session:
        """Return another session of the same diagram, not started, without preparing it again."""
        other = Session.of(self.prepared)
        other._rebuild = self._rebuild
        return other

    def __reduce__(self) -> tuple[Callable[[], Session], tuple[()]]:
        """Pickle and copy the arguments of the constructor: compiled code belongs to one process."""
        if self.started:
            raise SimulationError(
                f"cannot pickle or copy the session of '{self.prepared.plan.name}': it is started; pickle "
                "what save() returns, or use twin() for another session here"
            )
        return self._rebuild, ()

    def _described(self) -> Description:
        return self.prepared.described(
            "Session", f" at {self.time:g} s" if self.started else ", not started"
        )

    @property
    def started(self) -> bool:
        """Whether `start` was called, and `stop` was not."""
        return self._run is not None

    @property
    def time(self) -> float:
        """The present time [s]."""
        return self._running().time

    @property
    def pacer(self) -> Pacer | None:
        """Pacer of a session in real time, with the number of `overruns` and the `largest_delay` [s]."""
        return self._running().pacer

    @property
    def restores(self) -> bool:
        """Whether `save` works, since all Python blocks can save their state."""
        return not self._running().executor.blocks.unrestorable

    @property
    def messages(self) -> dict[str, list[str]]:
        """Messages of Python blocks in this run, such as the log of an FMU, keyed by path."""
        return self._running().executor.blocks.messages

    # -- running ----------------------------------------------------------------------------

    def start(
        self,
        *,
        parameters: Mapping[str, Any] | None = None,
        initial: Mapping[str, Any] | None = None,
        inputs: Mapping[str, Any] | None = None,
        time: float = 0.0,
        pace: float | None = None,
    ) -> None:
        """Start, or restart.

        Parameters
        ----------
        parameters : mapping, optional
            Values of parameters by ``"block.parameter"`` [units as declared].
        initial : mapping, optional
            Initial values of states by ``"block.state"`` [units as declared].
        inputs : mapping, optional
            Values of inputs by name [units as declared]; initial states may depend on them.
        time : float
            Time at which to begin [s]; sampled blocks count their instants from here.
        pace : float, optional
            Simulated seconds in a second of wall time [-], from now on, as for `Simulator.run`; see `pacer`.

        Raises
        ------
        NameLookupError
            If there is no such parameter, state or input.
        ParameterError
            If a value is not finite, of the wrong shape or not allowed.
        SimulationError
            If a Python block fails.
        """
        positive_if_given(pace=pace)
        self.stop()
        prepared = self.prepared
        begin = self._instant(time)
        if prepared.solver.is_fixed:
            ticks(begin, prepared.tick, "the start time")
        p = prepared.plan.parameters(parameters)
        executor = prepared.open(p)
        try:
            x, d = prepared.plan.initial(
                p, initial, inputs, float(begin), executor.blocks.equations
            )
        except BaseException:
            with contextlib.suppress(TrussflowError):
                # The first error is reported.
                executor.close()
            raise
        # Assigned last: if anything above fails, the session is not started.
        self._run = Run(prepared, executor, x, d, p, origin=begin)
        if pace is not None:
            self._run.pacer = Pacer(pace, float(begin))

    def stop(self) -> None:
        """Stop; Python blocks release their resources. A session that is not started does not change."""
        run = self._run
        # Before closing, which may raise: the session is not started in any case.
        self._run = None
        self.fault = ""
        if run is not None:
            run.executor.close()

    def __del__(self) -> None:
        with contextlib.suppress(BaseException):  # Python may be ending
            self.stop()

    def __enter__(self) -> Session:
        if self._run is None:
            self.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with contextlib.suppress(*([] if error is None else [TrussflowError])):
            # Without a second error, which would hide the first one.
            self.stop()

    def set(self, values: Mapping[str, Any] | None = None, /, **inputs: Any) -> None:
        """Set inputs, from the present time on; those that are not named keep their values.

        Parameters
        ----------
        values : mapping, optional
            Values by name of the input, for names that are no keywords [units as declared].
        **inputs : array_like
            Name and value.

        Raises
        ------
        NameLookupError
            If there is no such input; nothing is set then.
        ParameterError
            If a value is not finite or of the wrong shape; nothing is set then.
        """
        run = self._running()
        self.prepared.plan.set_inputs(run.d, {**by_name("inputs", values), **inputs})

    def set_row(self, values: Vector) -> None:
        """Set the first inputs from a flat vector of `values` [as declared], without checks.

        They are in the order of ``prepared.plan.u``.
        """
        run = self._running()
        start = self._u_start
        run.d[start : start + values.size] = values

    def latch(self) -> None:
        """Evaluate the sampled blocks due at the present time, with the present inputs."""
        self._running().sample()

    def tune(self, parameters: Mapping[str, Any]) -> None:
        """Change parameters, from the present time on.

        Initial values that were taken from a parameter do not change. `Running.tuned` of Python blocks is
        called.

        Parameters
        ----------
        parameters : mapping
            Values by ``"block.parameter"`` [units as declared].

        Raises
        ------
        NameLookupError
            If there is no such parameter; nothing is changed then.
        ParameterError
            If a value is not allowed; nothing is changed then.
        """
        run = self._running()
        plan = self.prepared.plan
        # In place, after all values were checked: the blocks hold views of `p`.
        run.p[:] = plan.parameters(parameters, run.p)
        run.executor.blocks.call_each("tuned")

    def advance(self, until: float) -> None:
        """Advance to a time, with the inputs held.

        Parameters
        ----------
        until : float
            Time to reach [s]. A fixed-step solver keeps to its grid: it takes a shorter step to a
            time in between, and another one from there to the next point of the grid.

        Raises
        ------
        SimulationError
            If the time is invalid, a Python block fails, or the session failed before: it
            must then be started again, or restored.
        DivergenceError
            If a signal stops being finite.
        """
        run = self._running()
        if self.fault:
            raise SimulationError(
                f"cannot advance '{self.prepared.plan.name}' from t = {run.time:g} s, because it "
                f"failed there: {self.fault}. Restore a snapshot, or start again"
            )
        # None: an adaptive solver, or a start or end between two ticks.
        tick = self._tick_at(until) if self._is_fixed and not run.beyond else None
        if tick is None:
            end = self._instant(until)
            past = end < run.now
            go_on = partial(run.advance, end)
        else:
            # Integers: arithmetic with fractions may take longer than the step itself.
            past = tick - run.first < run.k
            go_on = partial(run.step_to, tick - run.first)
        if past:
            raise SimulationError(
                f"cannot advance '{self.prepared.plan.name}' to t = {written(until)} s: it is at "
                f"{written(run.time)} s already; restore a snapshot to go back"
            )
        try:
            go_on()
        except BaseException as error:
            self.fault = str(error) or type(error).__name__
            raise

    def _tick_at(self, time: float) -> int | None:
        """Return the tick of a time, counted from time 0; None if the time lies between two ticks."""
        try:
            tick = round(number := time / self.prepared.tick_seconds)
        except (TypeError, ValueError, OverflowError):
            raise SimulationError(
                f"cannot advance to {shown(time)}: a time must be a finite number"
            ) from None
        # Without fixed steps and clocks, the tick is a default
        # of 1 s that limits nothing.
        if self._has_grid:
            refuse_coarse_time(time, self.prepared.tick_seconds)
        return tick if abs(number - tick) <= TICK_TOLERANCE else None

    def _instant(self, time: float) -> Fraction:
        """Return the exact time of a float."""
        tick = self._tick_at(time)
        if tick is not None and self._has_grid:
            return tick * self.prepared.tick
        return exact(time)

    @property
    def outputs(self) -> dict[str, Vector]:
        """The outputs at the present time, by name [units as declared]."""
        row = self.row().reshape(1, -1)
        return {c.name: c.values(row)[0] for c in self.prepared.channels}

    def row(self) -> Vector:
        """Return all outputs in one vector, in the order of ``prepared.channels``."""
        return self._computed("outputs")

    def states(self) -> Vector:
        """Return the continuous states in one vector, in the order of ``prepared.plan.x``."""
        return self._running().x.copy()

    def rates(self) -> Vector:
        """Return the time derivatives of `states`."""
        return self._computed("derivative")

    def events(self) -> Vector:
        """Return all modes, then the indicators of all events except time events."""
        plan = self.prepared.plan
        found = (
            self._computed("indicators")[plan.kinds != TIMED] if plan.kinds.size else []
        )
        return np.concatenate([self._running().d[plan.modes.span], found])

    def _computed(self, quantity: str) -> Vector:
        run = self._running()
        d = run.d
        if number := run.due():
            # The outputs after this instant, if no input changes any more. A copy, since
            # reading outputs must not change the state.
            d = run.executor.instant(
                number, run.time, run.x, d.copy(), run.p, update=False
            )
        return run.executor.call(quantity, run.time, run.x, d, run.p)

    # -- going back ---------------------------------------------------------------------------

    def save(self, path: str | Path | None = None) -> Snapshot:
        """Return a snapshot of the present time, and write it to a file if there is a `path`.

        An equal session in another process continues from there: ``session.restore(path)``.

        Parameters
        ----------
        path : path, optional
            File to write, atomically. It contains only numbers and text, so that reading it runs no code.

        Raises
        ------
        SimulationError
            If a Python block cannot save its state, the session failed, or the file cannot be written.
        """
        run = self._running()
        if self.fault:
            raise SimulationError(f"cannot save a session that failed: {self.fault}")
        snapshot = run.save()
        if path is not None:
            write_state(path, snapshot, self.prepared.identity)
        return snapshot

    def restore(self, snapshot: Snapshot | str | Path) -> None:
        """Go to the time of a snapshot, of this session or of another of an equal diagram.

        The session continues from there as the saved one, bit by bit.

        Parameters
        ----------
        snapshot : Snapshot or path
            Result of `save`, or the file that it wrote.

        Raises
        ------
        SimulationError
            If it is not a snapshot, or the saved diagram has other states, inputs or parameters. A file
            must also be of the same diagram, solver, backend and version.
        """
        run = self._running()
        is_file = isinstance(snapshot, str | Path)
        if isinstance(snapshot, str | Path):
            snapshot = read_state(snapshot, self.prepared.identity)
        if (
            not isinstance(snapshot, Snapshot)
            or snapshot.layout != self.prepared.layout
        ):
            raise SimulationError(
                f"cannot restore '{self.prepared.plan.name}': the snapshot is of a diagram with other "
                "blocks, states, inputs or parameters, or it is none; give what save() returned"
            )
        if is_file:
            run.check(snapshot)
        try:
            run.restore(snapshot)
        except BaseException as error:  # some blocks have gone back, others have not
            self.fault = str(error) or type(error).__name__
            raise
        self.fault = ""

    def _running(self) -> Run:
        if self._run is None:
            raise SimulationError(
                f"the session of '{self.prepared.plan.name}' is not started; call start() first"
            )
        return self._run
