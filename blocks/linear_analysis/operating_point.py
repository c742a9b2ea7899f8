"""Operating points: where a diagram is linearized."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.fixed_point import settle
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import System
from trussflow.blocks.library.transport_delay import TransportDelay
from trussflow.blocks.simulation.executor import Executor
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.python_blocks import PythonExecutor
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.simulation.solver import (
    Solver,
    SolverSettings,
    refuse_unknown,
    spelled_out,
)
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, positive, shown
from trussflow.blocks.tracing.plan import Plan

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, repr=False)
class OperatingPoint(Described):
    """States, inputs and parameters at which a diagram is linearized.

    Attributes
    ----------
    time : float
        Time [s].
    states : dict of array
        Continuous and discrete states by ``"block.state"`` [units as declared].
    held : dict of array
        Outputs that sampled blocks hold, by ``"block.port"`` [units as declared].
    loops : dict of array
        Signals of iterated algebraic loops, by ``"block.port"``: initial guesses, which select one of several
        solutions [units as declared].
    inputs : dict of array
        Inputs from outside, by name [units as declared].
    outputs : dict of array
        Exposed outputs, by name, for information only [units as declared].
    parameters : dict
        Parameters that differ from the blocks' own, by ``"block.parameter"``.
    residual : float
        Largest violation of an equation of `trim` [SI units of the equation].
    report : pandas.DataFrame or None
        Report of `trim`, with a row for each element of a state, input and output: kind, value, unit, role
        (free, fixed, at a bound, wanted), bounds, rate of change, and residual of its condition (NaN without
        one). None for any other point, also for one made by ``dataclasses.replace``.

    Raises
    ------
    ParameterError
        If the time is no finite number.
    """

    time: float = 0.0
    states: Mapping[str, Array] = field(default_factory=dict)
    held: Mapping[str, Array] = field(default_factory=dict)
    loops: Mapping[str, Array] = field(default_factory=dict)
    inputs: Mapping[str, Array] = field(default_factory=dict)
    outputs: Mapping[str, Array] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    residual: float = 0.0
    report: pd.DataFrame | None = field(default=None, init=False, compare=False)

    def __post_init__(self) -> None:
        time = finite_array("the time of an operating point", self.time, ())
        object.__setattr__(self, "time", float(time))

    def _described(self) -> Description:
        kinds = {
            "state": self.states,
            "held": self.held,
            "input": self.inputs,
            "output": self.outputs,
            "parameter": self.parameters,
        }
        facts = {
            f"{kind} {name}": np.array2string(
                np.asarray(value), precision=6, threshold=20, legacy=False
            ).replace("\n", "")
            for kind, values in kinds.items()
            for name, value in values.items()
        }
        return Description(f"operating point at {self.time:g} s", facts)

    @classmethod
    def of(cls, session: Session) -> OperatingPoint:
        """Return the operating point of a session, before sampled blocks compute at its present time.

        Parameters
        ----------
        session : Session
            A session of the diagram or block.

        Raises
        ------
        SimulationError
            If the session is not started, has failed, or a Python block in it cannot save its state.
        """
        plan = session.prepared.plan
        now = session.save()
        own, given = plan.p.named(plan.parameters({})), plan.p.named(now.p)
        found: dict[str, Any] = as_named(plan, now.x, now.d)
        # Only changes, so that other parameters follow the blocks.
        changed = {k: v for k, v in given.items() if not np.array_equal(v, own[k])}
        # In a run, the approximants of delays follow at events only.
        delays = [
            b for b in plan.system.blocks.values() if isinstance(b, TransportDelay)
        ]
        if delays:
            signals = plan.evaluate(float(now.now), now.x, now.d, now.p)
        for delay in delays:
            y = signals.output(delay.port("y"))
            found["states"][f"{delay.path}.z"] = delay.steady(y)
        return cls(time=float(now.now), parameters=changed, **found)

    def vectors(
        self, plan: Plan, opened: Mapping[str, Equations] | None = None
    ) -> tuple[Vector, Vector, Vector]:
        """Return x, d and p of a plan; missing values are the initial ones.

        Parameters
        ----------
        plan : Plan
            The plan.
        opened : mapping, optional
            Equation objects of the Python blocks, keyed by path.

        Raises
        ------
        NameLookupError
            If the point names a state, held output, input or parameter that is not there.
        ParameterError
            If a value is not finite or has the wrong shape.
        """
        p = plan.parameters(self.parameters)
        x, d = plan.initial(p, self.states, self.inputs, self.time, opened)
        self.hold(plan, d)
        return x, d, p

    def hold(self, plan: Plan, d: Vector) -> None:
        """Write the held outputs and the loop signals of this point into d.

        Parameters
        ----------
        plan : Plan
            The plan.
        d : Vector
            Discrete values in the order of the plan [units as declared].

        Raises
        ------
        NameLookupError
            If there is no such output.
        ParameterError
            If a value is not finite or has the wrong shape.
        """
        for reference, value in self.held.items():
            e = plan.held.find(reference, "held output")
            plan.held.put(
                d,
                e.path,
                e.name,
                finite_array(f"held output '{reference}'", value, e.shape),
            )
        for reference, value in self.loops.items():
            path, _, name = reference.rpartition(".")
            if found := plan.guesses.entries.get((path, name)):  # a loop may be cut
                plan.guesses.put(
                    d,
                    path,
                    name,
                    finite_array(f"loop signal '{reference}'", value, found.shape),
                )


def as_wired(system: System) -> Prepared:
    """Return a flat `system` with its external inputs, evaluated in plain NumPy."""
    plan = Plan(system)
    return Prepared(plan, [], Solver(solver="RK45", backend="numpy"))


def completed(
    assembly: Prepared,
    at: OperatingPoint | None,
    ports: Sequence[Port],
    outputs: Mapping[str, Port],
) -> tuple[OperatingPoint, list[Vector]]:
    """Return a complete point, and the values of ports there.

    Held outputs that the point does not give are computed from its states.

    Parameters
    ----------
    assembly : Prepared
        The diagram; each set of clocks has its own program.
    at : OperatingPoint, optional
        Operating point; missing values are the initial ones.
    ports : sequence of Port
        Inputs or outputs of leaf blocks, whole or sliced.
    outputs : mapping
        Ports to keep in the point, by name.
    """
    at = given_point(at)
    plan = assembly.plan
    for reference in at.loops:
        plan.guesses.find(reference, "loop signal")
    p = plan.parameters(at.parameters)
    with contextlib.closing(assembly.open(p)) as executor:
        x, d, _ = at.vectors(plan, executor.blocks.equations)
        if len(at.held) < len(plan.held.entries):
            _settle_held(assembly, executor, at.time, x, d, p)
            # What the point itself says precedes the values that have settled.
            at.hold(plan, d)
        if isinstance(executor, PythonExecutor):
            executor.refresh(at.time, x, d, p)
    d = plan.loops.put(at.time, x, d, p, frozenset())
    evaluation = plan.evaluate(at.time, x, d, p)

    def value(port: Port) -> Vector:
        return np.asarray(
            np.ravel(evaluation.value(port))[port.elements()], dtype=float
        )

    found: dict[str, Any] = as_named(plan, x, d)
    found["outputs"] = {name: value(port) for name, port in outputs.items()}
    return replace(at, **found), [value(port) for port in ports]


def _settle_held(
    assembly: Prepared, executor: Executor, t: float, x: Vector, d: Vector, p: Vector
) -> None:
    """Compute the held outputs in d; discrete states stay as they are."""
    memory = d[assembly.plan.memory.span].copy()

    def sweep() -> Vector:
        for number, active in enumerate(assembly.schedule.sets):
            if active:
                d[:] = executor.instant(number, t, x, d, p, update=False)
                d[assembly.plan.memory.span] = memory
        return d.copy()

    fault = (
        "the outputs that sampled blocks hold at this operating point do not settle: they depend "
        "on each other in a circle; give their values in the point, with held={...}"
    )
    # A held output may depend on other held outputs, so that several sweeps are needed.
    settle(sweep, len(assembly.plan.held.entries), fault)


def as_named(plan: Plan, x: Vector, d: Vector) -> dict[str, dict[str, Array]]:
    """Return states, held outputs and inputs by name, as an operating point has them.

    Parameters
    ----------
    plan : Plan
        The plan.
    x, d : Vector
        Its vectors [units as declared].
    """
    system = plan.system
    names = {e.path: n for n, e in zip(system.external, plan.u, strict=True)}
    inputs = {names[k.rpartition(".")[0]]: v for k, v in plan.u.named(d).items()}
    return {
        "states": plan.x.named(x) | plan.modes.named(d) | plan.memory.named(d),
        "held": plan.held.named(d),
        "loops": plan.guesses.named(d),
        # An input of the user; an injected one is no port.
        "inputs": {n: v for n, v in inputs.items() if n in system.root.ports},
    }


def given_point(at: Any) -> OperatingPoint:
    """Return the operating point of the user; None is the initial point.

    Raises
    ------
    LinearAnalysisError
        If the value is not an `OperatingPoint`.
    """
    if at is not None and not isinstance(at, OperatingPoint):
        raise LinearAnalysisError(
            f"an operating point must be an OperatingPoint(states={{...}}), as trim returns, not {shown(at)}"
        )
    return at or OperatingPoint()


@spelled_out(SolverSettings)
def operating_point_after(
    item: Block,
    duration: float,
    *,
    at: OperatingPoint | None = None,
    **settings: Unpack[SolverSettings],
) -> OperatingPoint:
    """Simulate, and return the operating point at the end, to linearize there.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    duration : float
        Time to simulate [s].
    at : OperatingPoint, optional
        Time, states, inputs and parameters to start from; inputs stay as they are.
    step, solver, backend, rtol, atol
        Of the `Solver` [s, -, -, -, unit of the state].

    Returns
    -------
    OperatingPoint
        The states just before sampled blocks compute at that time. Its time continues from
        that of `at`, which is also the origin of the sample instants.

    Raises
    ------
    SimulationError
        If an argument is invalid, or a Python block cannot save its state.
    DivergenceError
        If a signal stops being finite.
    """
    positive(duration=duration)
    begin = given_point(at)
    refuse_unknown(settings, SolverSettings.__annotations__)
    (point,) = points_during(Session(item, **settings), begin, [begin.time + duration])
    return point


def points_during(
    session: Session, begin: OperatingPoint, times: Sequence[float]
) -> list[OperatingPoint]:
    """Return the operating points of a run at some times.

    Parameters
    ----------
    session : Session
        Session of the run, which is started here and stopped at the end.
    begin : OperatingPoint
        Time, states, inputs and parameters to start from.
    times : sequence of float
        Increasing [s].
    """
    initial = {**begin.states, **begin.loops}
    session.start(
        parameters=begin.parameters,
        initial=initial,
        inputs=begin.inputs,
        time=begin.time,
    )
    points = []
    with session:
        for time in times:
            # The first time may be the start.
            if time != session.time:
                session.advance(time)
            points.append(OperatingPoint.of(session))
    return points
