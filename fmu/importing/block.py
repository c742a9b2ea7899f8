"""Block that runs an FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Event, Signals, State
from trussflow.blocks.support.summary import Description
from trussflow.blocks.support.validation import by_name, positive, yes_or_no
from trussflow.fmu.errors import FmuError
from trussflow.fmu.importing.co_simulation_run import CoSimulationRun
from trussflow.fmu.importing.fmu_run import FmuRun
from trussflow.fmu.importing.import_interface import ImportInterface
from trussflow.fmu.importing.model_exchange_run import (
    PLACEHOLDER_STATE,
    STATE_EVENT,
    TIME_EVENT,
    DifferentiableRun,
    ModelExchangeRun,
)
from trussflow.fmu.runtime.description import FmuDescription, Kind
from trussflow.fmu.runtime.file import FmuFile


class Fmu(Block):
    """An FMU as a block: FMI 2.0 or 3.0, for co-simulation or model exchange.

    An FMU is native code that runs with the rights of the user: use trusted FMUs only. The README
    lists the checks, and the faults that a child process protects from.

    **Names.** Numeric inputs and outputs become ports. Scalars ``u[1]``, ``u[2]``… become one port
    ``u``; arrays of FMI 3 remain arrays. Characters that are illegal in Python names become
    underscores: ``arm.q[1]``… becomes the port ``arm_q``. `variables` maps the names of the block to
    the names of the FMU. Numeric parameters become parameters of the block, which can be changed
    between runs; tunable parameters also during a run. `start` sets text, structural parameters and
    start values of other variables.

    **Co-simulation** is a sampled block. At each sample instant the FMU first steps from the
    previous instant with the inputs held since then. Feedback therefore has a delay of one step.
    Outputs with direct feedthrough are computed with the inputs of the current instant; outputs
    without stated dependencies count as such. If the FMU discards a step and allows variable steps,
    the step is halved. A step that returns early is completed.

    **Model exchange** is a continuous block. The solver of the diagram integrates its states and
    locates its events. At an instant, events are handled first; sampled blocks and the log see the
    outputs after them. Events caused by sampled blocks are handled last: a discrete input driven by
    a sampled block takes effect in the next row of the log. Linear models use the directional
    derivatives of the FMU if it has them and has no discrete inputs, else finite differences.

    Parameters
    ----------
    path : str or pathlib.Path
        The FMU.
    kind : str, optional
        ``"cs"`` (co-simulation) or ``"me"`` (model exchange); by default co-simulation, if the
        FMU offers it.
    step : float, optional
        Communication step size of co-simulation [s]; by default the FMU's suggestion.
    parameters, start : mapping of str to object, optional
        Values of parameters, and start values, by the names of the FMU or the block [units as the
        FMU states]. An input with a start value may stay unconnected.
    declared_starts : bool
        Whether unconnected inputs keep the start values that the FMU declares. A vector whose
        elements have different start values must be connected.
    units : mapping of str to (str or None), optional
        Trussflow's name of a unit by the FMU's name, for unknown units; None disables the check.
    delayed : bool
        Whether co-simulation outputs use the inputs of the previous instant, even if the FMU
        declares direct feedthrough or states no dependencies; this breaks algebraic loops.
    tolerance : float, optional
        Relative tolerance of the FMU's own solver [-].
    time_limit : float, optional
        Maximum time of each call of the FMU, and of loading [s]. The FMU then runs in a child
        process, which is ended after that time, and whose crash does not affect this process.
    memory_limit : float, optional
        Maximum memory of the FMU in the child process [B].
    logging : bool
        Whether the FMU logs all its messages; see ``messages`` of a result or session.

    Raises
    ------
    FmuError
        If the FMU, a name, a value or a unit is refused.
    NameLookupError
        If an argument that must be a mapping by name is not.
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
    ) -> None:
        self.file = FmuFile.read(path)
        self.kind = self.file.kind(kind)
        limits = {"time_limit": time_limit, "memory_limit": memory_limit}
        numbers = {"tolerance": tolerance, **limits}
        positive(
            FmuError,
            **{name: value for name, value in numbers.items() if value is not None},
        )
        if memory_limit is not None and time_limit is None:
            raise FmuError(
                "Fmu: memory_limit needs a child process; give time_limit too"
            )
        yes_or_no("Fmu", "declared_starts", declared_starts)
        yes_or_no("Fmu", "delayed", delayed)
        yes_or_no("Fmu", "logging", logging)
        parameters = by_name("parameters", parameters)
        start = by_name("start values", start)
        given = {**parameters, **start}
        if twice := parameters.keys() & start.keys():
            raise FmuError(
                f"'{min(twice)}' is given both as a parameter and as a start value"
            )
        if self.kind == "me" and (step is not None or delayed):
            raise FmuError(
                f"FMU '{self.file.description.name}' is used for model exchange, where the diagram's solver sets "
                "the step and inputs are not held; leave out step and delayed, or set kind='cs'"
            )
        self.options = {**limits, "logging": logging}
        self.units = dict(by_name("units", units))
        self.delayed = delayed
        self.tolerance = tolerance
        reserved = {
            *dir(Fmu),
            *Block.__annotations__,
            *Fmu.__annotations__,
            STATE_EVENT,
            TIME_EVENT,
        }
        self.interface = ImportInterface(
            self.file.description,
            given,
            self.units,
            reserved,
            with_states=self.kind == "me",
            declared_starts=declared_starts,
        )
        description = self.interface.description  # with the given array sizes
        self.file = replace(self.file, description=description)
        self._declared = dict(self.interface.declarations)
        if self.kind == "me":
            if not self.interface.states.size:
                state = State(meaning="always zero: the FMU has no states")
                state.name = PLACEHOLDER_STATE
                self._declared[PLACEHOLDER_STATE] = state
            self._declared |= {
                STATE_EVENT: Event(shape=(description.event_indicators,)),
                TIME_EVENT: Event("time"),
            }
        super().__init__()
        if self.kind == "cs":
            step = description.step if step is None else step
            if step is None:
                raise FmuError(
                    f"FMU '{description.name}' suggests no step size; give step, the communication step size [s]"
                )
            self.sampled(step)

    def _described(self) -> Description:
        own = super()._described()
        description = self.description
        fmu = {
            "fmu": f"{description.name}, FMI {description.version}, {self.kind}, {self.file.path}"
        }
        return replace(own, facts={**fmu, **own.facts})

    # -- properties ---------------------------------------------------------------------------

    @property
    def description(self) -> FmuDescription:
        """The model description of the FMU."""
        return self.interface.description

    @property
    def variables(self) -> dict[str, tuple[str, ...]]:
        """Names of the FMU variables of each port, parameter and state."""
        return self.interface.variables()

    @property
    def continuous(self) -> bool:
        """Whether the solver of the diagram integrates the states."""
        return self.kind == "me"

    @property
    def steps_itself(self) -> bool:
        """Whether the FMU integrates its states itself."""
        return self.kind == "cs"

    @property
    def fingerprint(self) -> str:
        """GUID or instantiation token of the FMU."""
        return self.description.token

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return the inputs with direct feedthrough to each output."""
        found = self.interface.feedthrough()
        return dict.fromkeys(found, ()) if self.delayed else found

    def open(self, p: Signals) -> FmuRun:
        """Unpack and load the FMU for one run, with parameters `p` [units as the FMU states]."""
        if self.kind == "cs":
            return CoSimulationRun(self, p)
        # FMI has no derivatives with respect to discrete inputs.
        offers = self.description.differentiable and all(
            v.is_continuous for v in self.interface.inputs.order
        )
        return (DifferentiableRun if offers else ModelExchangeRun)(self, p)
