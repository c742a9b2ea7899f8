"""FMUs as blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Event, Signals, State
from trussflow.blocks.framework.described import Description
from trussflow.blocks.framework.validation import by_name, yes_or_no
from trussflow.fmu.errors import FmuError, check_positive
from trussflow.fmu.importing.co_simulation_run import CoSimulationRun
from trussflow.fmu.importing.fmu_run import FmuRun
from trussflow.fmu.importing.import_interface import ImportInterface
from trussflow.fmu.importing.model_exchange_run import (
    PLACEHOLDER,
    STATE_EVENT,
    TIME_EVENT,
    DifferentiableRun,
    ModelExchangeRun,
)
from trussflow.fmu.runtime.archive import MAX_BYTES
from trussflow.fmu.runtime.description import FmuDescription, Kind
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.split_inputs import is_smooth

MOST = {"time_limit": 1e6, "memory_limit": 1e15}
"""What operating systems can still wait for [s] and count [B]."""


class Fmu(Block):
    """An FMU as a block: FMI 2.0 or 3.0, for co-simulation or model exchange.

    An FMU is native code, which runs with your rights: use only what you trust. See the README
    for what is checked, and for what a child process protects from.

    **Names.** Inputs and outputs that are numbers become ports; scalars ``u[1]``, ``u[2]``…
    become one port ``u``, arrays of FMI 3 stay arrays. Characters that no Python name has become
    underscores: ``arm.q[1]``… is the port ``arm_q``. `variables` tells which is which.
    Parameters that are numbers become parameters of the block, so that they can be changed from
    run to run without building it anew; tunable ones also during a run. Text, structural
    parameters and start values of other variables are set by `start`.

    **Co-simulation** is a sampled block. At each instant it first lets the FMU step from the
    instant before, with the inputs of that instant held: what it feeds back arrives one step
    later. Outputs that depend on inputs directly, as the FMU's description says (or does not
    say), are computed with the inputs of the present instant. Steps that the FMU discards are
    halved where it allows that; steps that return early are completed.

    **Model exchange** is a continuous block; its states stand beside all others under the solver
    of the diagram, which also locates the FMU's events. At an instant events come first: what is
    sampled and logged there sees the outputs after them. Events that what is sampled causes come last:
    inputs that may change at events only, wired to a sampled block, show in the next row.
    Linear models take the FMU's own directional derivatives if it has them, and no inputs that change
    at events only; else differences.

    Parameters
    ----------
    path : str or pathlib.Path
        The FMU.
    kind : str, optional
        ``"cs"`` (co-simulation) or ``"me"`` (model exchange); by default co-simulation, if the
        FMU offers it.
    step : float, optional
        Time between the instants of co-simulation [s]; by default what the FMU suggests.
    parameters, start : mapping of str to object, optional
        Values of parameters, and start values, by the FMU's names or the block's [units as the
        FMU states]. An input that is given a start value need not be wired.
    declared_starts : bool
        Whether inputs that are not wired keep the start values that the FMU declares; a vector that
        declares different ones must be wired.
    units : mapping of str to (str or None), optional
        Our name of a unit by the FMU's, where it is not understood; None leaves it unchecked.
    delayed : bool
        Whether outputs of co-simulation shall not see the inputs of the same instant, although
        the FMU says (or leaves open) that they depend on them: this breaks algebraic loops.
    tolerance : float, optional
        Relative tolerance of the FMU's own solver [-].
    time_limit : float, optional
        Time that each call of the FMU may take, and loading it [s]. It then runs in a process of
        its own, which is ended when it takes longer, and which may crash without harm.
    memory_limit : float, optional
        Memory that it may take in that process [B].
    logging : bool
        Whether the FMU shall log all it can; the ``messages`` of a result or session have it.
    max_bytes : float
        Unpacked size allowed [B].

    Raises
    ------
    FmuError
        If the FMU, a name, a value or a unit is refused; its subclasses tell which.
    NameLookupError
        If what is to be given by name is not.
    BlockError
        If `declared_starts`, `delayed` or `logging` is neither True nor False.

    Examples
    --------
    ::

        plant = Fmu("plant.fmu", step=1e-3, parameters={"mass": 2.0})
        controller.force >> plant.force
    """

    traced: ClassVar[bool] = False

    kind: Kind
    file: FmuFile
    interface: ImportInterface
    options: dict[str, Any]
    delayed: bool
    tolerance: float | None

    def __init__(
        self,
        path: str | Path,
        *,
        kind: str | None = None,
        step: float | None = None,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
        declared_starts: bool = False,
        units: Mapping[str, str | None] | None = None,
        delayed: bool = False,
        tolerance: float | None = None,
        time_limit: float | None = None,
        memory_limit: float | None = None,
        logging: bool = False,
        max_bytes: float = MAX_BYTES,
    ) -> None:
        self.file = FmuFile.read(path, max_bytes)
        self.kind = self.file.kind(kind)
        limits = {"time_limit": time_limit, "memory_limit": memory_limit}
        check_positive(FmuError, "Fmu", tolerance=tolerance, **limits)
        if memory_limit is not None and time_limit is None:
            raise FmuError("Fmu: memory_limit holds in a process of its own; give time_limit too")
        for name, most in MOST.items():
            if (limit := limits[name]) is not None and limit > most:
                raise FmuError(f"Fmu: {name} = {limit:g} is more than {most:g}; leave it out for no limit")
        yes_or_no("Fmu", "declared_starts", declared_starts)
        yes_or_no("Fmu", "delayed", delayed)
        yes_or_no("Fmu", "logging", logging)
        parameters, start = by_name("parameters", parameters), by_name("start values", start)
        given = {**parameters, **start}
        if twice := parameters.keys() & start.keys():
            raise FmuError(f"'{min(twice)}' is given both as a parameter and as a start value")
        if self.kind == "me":
            self._refuse("step", step is not None, "the diagram's solver has the step")
            self._refuse("delayed", delayed, "nothing is held from instant to instant")
        self.options = {**limits, "logging": logging}
        self.units, self.delayed, self.tolerance = dict(by_name("units", units)), delayed, tolerance
        reserved = {*dir(Fmu), *Block.__annotations__, *Fmu.__annotations__, STATE_EVENT, TIME_EVENT}
        self.interface = ImportInterface(
            self.file.description,
            given,
            self.units,
            reserved,
            with_states=self.kind == "me",
            declared_starts=declared_starts,
        )
        self._declared = dict(self.interface.declarations)
        if self.kind == "me" and not self.interface.states.size:
            state = State(meaning="always zero: the FMU has no states")
            state.name = PLACEHOLDER
            self._declared[PLACEHOLDER] = state
        if self.kind == "me":
            number = self.file.description.event_indicators
            self._declared |= {STATE_EVENT: Event(shape=(number,)), TIME_EVENT: Event("time")}
        super().__init__()
        if self.kind == "cs":
            self.sampled(self._suggested_step() if step is None else step)

    def _refuse(self, option: str, given: bool, reason: str) -> None:
        """Refuse an option that makes no sense for model exchange."""
        if given:
            raise FmuError(
                f"FMU '{self.file.description.name}' is used for model exchange, where {reason}; leave "
                f"out {option}, or say kind='cs'"
            )

    def _suggested_step(self) -> float:
        description = self.description
        suggested = description.step or description.kinds["cs"].fixed_step
        if suggested is None:
            raise FmuError(
                f"FMU '{description.name}' does not say which step suits it; give step, the time "
                "between two exchanges of inputs and outputs [s]"
            )
        return suggested

    def _described(self) -> Description:
        own, description = super()._described(), self.description
        fmu = {"fmu": f"{description.name}, FMI {description.version}, {self.kind}, {self.file.path}"}
        return replace(own, facts=fmu | own.facts)

    # -- what there is ------------------------------------------------------------------------

    @property
    def description(self) -> FmuDescription:
        """The model description of the FMU."""
        return self.interface.description

    @property
    def variables(self) -> dict[str, tuple[str, ...]]:
        """The FMU's names of the variables behind each port, parameter and state."""
        return self.interface.variables()

    @property
    def continuous(self) -> bool:
        """Whether our solver integrates its states."""
        return self.kind == "me"

    @property
    def steps_itself(self) -> bool:
        """Whether it integrates its states itself."""
        return self.kind == "cs"

    @property
    def fingerprint(self) -> str:
        """What tells the FMU from others."""
        return self.description.token

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return the inputs that each output depends on within an instant."""
        found = self.interface.feedthrough()
        return dict.fromkeys(found, ()) if self.delayed else found

    def open(self, p: Signals) -> FmuRun:
        """Unpack and load the FMU for one run, with parameters `p` [units as the FMU states]."""
        if self.kind == "cs":
            return CoSimulationRun(self, p)
        offers = self.description.kinds["me"].derivatives and all(map(is_smooth, self.interface.inputs.order))
        return (DifferentiableRun if offers else ModelExchangeRun)(self, p)
