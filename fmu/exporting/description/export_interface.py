"""Interface of an exported block or diagram, common to all kinds of FMU."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import exact
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.system import flatten, resolved
from trussflow.blocks.simulation.schedule import Schedule
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import by_name, one_of, positive
from trussflow.blocks.tracing.initialization import InitialCycleError, initialization
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import (
    after_events,
    derivative,
    guesses,
    indicators,
    outputs,
    sample,
    stored,
)
from trussflow.fmu.errors import ExportError
from trussflow.fmu.exporting.description.dependencies import Dependencies, dependencies
from trussflow.fmu.exporting.description.groups import input_starts, name_of, variables
from trussflow.fmu.exporting.description.variables import Variables

DEFAULT_TOLERANCE = 1e-8
"""Default relative tolerance of the default experiment [-]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExportInterface:
    """Variables, start values and programs of an exported item.

    Value references count scalars from 1 in the order time, inputs, parameters, states, derivatives,
    outputs, modes, state event indicators. ``references`` of a variable minus the first reference of
    its group are indices into the vector of that group: u, p or x of the plan, dx/dt, and so on.

    Attributes
    ----------
    name, identifier : str
        Name of the model, and the name as a C identifier.
    meaning : str
        First line of the block's docstring.
    plan : Plan
        The plan, with external inputs.
    schedule : Schedule
        Ticks of the sampled blocks, in steps.
    variables : Variables
        All variables.
    x, d, p : Vector
        Values before initialization of the states, the discrete values and the parameters
        [as declared].
    dependencies : Dependencies
        Dependencies between the variables.
    programs : dict of Program
        Programs by name: derivative, outputs, initialization, sample_1 and so on; with events also
        indicators and on_event; with algebraic loops also guesses, with histories also stored.
    step, stop_time, tolerance : float
        Step size of fixed-step solvers [s], stop time [s] and tolerance [-] of the default experiment.
    solver : str
        Solver of co-simulation.
    token : str
        Hash of the equations and the interface, 32 hexadecimal digits.
    about : mapping of str to str
        Further attributes of the model description, such as the author.

    Notes
    -----
    Time grid of all kinds of export: fixed step k ends at ``start + k step``, for any communication
    points; with variable steps, only ticks are on the grid. Inputs are held during a step. Sample
    instants count from the start of the run. Blocks that tick at the current instant are computed
    from the inputs set so far. Outputs read now show the result, which becomes final when time
    advances. The importer may set a state whose `initial` is ``"exact"``; other states follow from
    parameters and inputs at the end of initialization.
    """

    name: str
    identifier: str
    meaning: str
    plan: Plan
    schedule: Schedule
    variables: Variables
    x: Vector
    d: Vector
    p: Vector
    dependencies: Dependencies
    programs: dict[str, Program]
    step: float
    stop_time: float
    tolerance: float
    solver: str
    token: str
    about: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        item: Block,
        *,
        step: float = 1e-3,
        stop_time: float = 10.0,
        tolerance: float = DEFAULT_TOLERANCE,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
        solver: str = "rk4",
    ) -> ExportInterface:
        """Return the interface of a block or diagram.

        Parameters
        ----------
        item : Block
            A block, whose ports become variables, or a diagram, whose exposed ports become variables.
        step : float
            Fixed step of the solver [s]; sample times must be multiples of it.
        stop_time, tolerance : float
            Stop time [s] and relative tolerance [-] of the default experiment.
        parameters, start : mapping, optional
            Values of parameters by name, and start values of inputs by name [units as declared].
        solver : str
            Solver of co-simulation.

        Raises
        ------
        ExportError
            If there is no output, a name is unknown or a start value is missing. Also if a block
            initializes itself by code that cannot be traced.
        DiagramError
            If the diagram cannot be built.
        TracingError
            If the equations of a block cannot be traced.
        """
        _check(item, step=step, stop_time=stop_time, tolerance=tolerance)
        plan = Plan(flatten(item, external=True), step, solver not in FIXED_STEP)
        _check_initialization(item, plan)
        ports = [resolved(port) for port in item.outputs()]
        try:
            schedule = Schedule(plan.system.clocks, exact(step))
        except SimulationError as error:
            raise ExportError(
                f"cannot export '{item.name}' with step={step}: {error}"
            ) from error
        samples = [
            sample(i, clocks) for i, clocks in enumerate(schedule.sets) if clocks
        ]
        events = [indicators(), after_events()] if plan.has_events else []
        events += [guesses()] if plan.guesses.size else []
        events += [stored()] if plan.histories.size else []
        try:
            traced = plan.trace(
                [derivative(), outputs(ports), initialization(), *events, *samples]
            )
        except InitialCycleError as error:
            raise ExportError(f"cannot export '{item.name}': {error}") from error
        programs = {program.name: program for program in traced}
        needs = dependencies(plan, programs)
        p = _parameter_values(item, plan, by_name("parameters", parameters))
        starts = input_starts(item, plan, by_name("start values", start))
        x, d = plan.initial(p, {}, starts)
        shown = variables(item, plan, p, x, d, starts, needs.tunable)
        # Here, where the message can name the variable; an importer shows NaN only.
        _check_start(plan, programs, shown, x, d, p)
        # Equal items give equal tokens, so an export can be reproduced bit by bit.
        made_from = [
            repr((item.name, step, stop_time, tolerance, solver)),
            *(program.code for program in traced),
            *(repr((v.name, v.shape, v.units, v.meaning, v.start)) for v in shown),
        ]
        return cls(
            name=item.name,
            identifier=_identifier(item.name),
            meaning=""
            if isinstance(item, Diagram)
            else (type(item).__doc__ or "").strip().split("\n")[0],
            plan=plan,
            schedule=schedule,
            variables=shown,
            x=x,
            d=d,
            p=p,
            dependencies=needs,
            programs=programs,
            step=float(step),
            stop_time=float(stop_time),
            tolerance=float(tolerance),
            solver=solver,
            token=hashlib.sha256("\0".join(made_from).encode()).hexdigest()[:32],
        )


def _check(item: Block, **times: float) -> None:
    """Raise an error for an item or times that cannot be exported.

    Raises
    ------
    ExportError
        If the item is not a block with outputs, or a time is not positive.
    """
    given: object = item
    if not isinstance(given, Block):
        raise ExportError(
            f"cannot export {given!r}: it is neither a block nor a diagram"
        )
    positive(ExportError, **times)
    if not item.outputs():
        raise ExportError(
            f"cannot export '{item.name}': it has no output; diagram.expose(name=block.port) exposes one"
        )


def _check_initialization(item: Block, plan: Plan) -> None:
    """Raise an error for Python blocks that set initial states, because these cannot be traced.

    Raises
    ------
    ExportError
        If there is such a block.
    """
    for block in plan.python_blocks:
        # as imported FMUs do
        loads = block.hides and (block.continuous or block.steps_itself)
        if loads or block.states_own("initial_state"):
            raise ExportError(
                f"cannot export '{item.name}': '{block.path}' ({type(block).__name__}) runs or initializes "
                "itself by code that cannot be traced; leave that block out. For diagrams of FMUs there is "
                "trussflow.fmu.ssp.export_ssp"
            )


def _parameter_values(item: Block, plan: Plan, chosen: Mapping[str, Any]) -> Vector:
    """Return all parameters; those of a single block may be given without the block's name.

    Raises
    ------
    ExportError
        If a name is unknown.
    ParameterError
        If a value is not allowed.
    """
    # A single block has short names; `Plan.parameters` takes those with a path.
    known = {name_of(item, e): f"{e.path}.{e.name}" for e in plan.p}
    for name in chosen:
        if name not in known.values():
            one_of(f"parameter of '{item.name}'", name, [*known], ExportError)
    return plan.parameters(
        {known.get(name, name): value for name, value in chosen.items()}
    )


def _check_start(
    plan: Plan,
    programs: dict[str, Program],
    shown: Variables,
    x: Vector,
    d: Vector,
    p: Vector,
) -> None:
    """Raise an error if a derivative or output is not finite at the start.

    Raises
    ------
    ExportError
        If there is such a variable; the message names the first one.
    """
    t = np.zeros(1)
    d = d.copy()
    x, d[: plan.memory.span.stop] = np.split(
        programs["initialization"].function(t, x, d, p).full().ravel(), [plan.x.size]
    )
    scalars = shown.scalarized()
    for group, name in (
        (scalars.derivatives, "derivative"),
        (scalars.outputs, "outputs"),
    ):
        finite = np.isfinite(programs[name].function(t, x, d, p).full().ravel())
        if not finite.all():
            raise ExportError(
                f"'{group[int(np.argmin(finite))].name}' has no start value: with the inputs and parameters at "
                "their start values it is not finite; set other values with start={...} or parameters={...}"
            )


def _identifier(name: str) -> str:
    """Convert a name to a C identifier."""
    plain = re.sub(r"\W", "_", name, flags=re.ASCII)
    return plain if re.match(r"[A-Za-z_]", plain) else f"model_{plain}"
