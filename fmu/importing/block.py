"""FMUs as blocks: what co-simulation and model exchange have in common."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.importing.import_interface import ImportInterface
from trussflow.fmu.runtime.archive import MAX_BYTES
from trussflow.fmu.runtime.child_process import open_instance
from trussflow.fmu.runtime.description import FmuDescription, Kind
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.start_values import Starts


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
    sampled and logged there sees the outputs after them.

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
    units : mapping of str to (str or None), optional
        Our name of a unit by the FMU's, where it is not understood; None leaves it unchecked.
    delayed : bool
        Whether outputs of co-simulation shall not see the inputs of the same instant, although
        the FMU says (or leaves open) that they depend on them: this breaks algebraic loops.
    tolerance : float, optional
        Relative tolerance of the FMU's own solver [-].
    time_limit : float, optional
        Time that each call of the FMU may take [s]. It then runs in a process of its own, which
        is ended when it takes longer, and which may crash without harm.
    logging : bool
        Whether the FMU shall log all it can; `log` has it.
    max_bytes : float
        Unpacked size allowed [B].

    Raises
    ------
    FmuError
        If the FMU, a name, a value or a unit is refused; its subclasses tell which.

    Examples
    --------
    ::

        plant = Fmu("plant.fmu", step=1e-3, parameters={"mass": 2.0})
        controller.force >> plant.force
    """

    traced: ClassVar[bool] = False

    _kind: ClassVar[Kind]
    _opens: ClassVar[type[LoadedCoSimulation | LoadedModelExchange]]

    def __new__(cls, *arguments: Any, **named: Any) -> Any:
        """Return a block of the kind wanted."""
        if cls is not Fmu:
            return super().__new__(cls)
        from trussflow.fmu.importing.co_simulation import CoSimulationFmu
        from trussflow.fmu.importing.model_exchange import ModelExchangeFmu

        path = arguments[0] if arguments else named.get("path")
        if not isinstance(path, str | Path):
            raise FmuError(f"Fmu needs the path of an FMU first, not {path!r}")
        file = FmuFile.read(path, named.get("max_bytes", MAX_BYTES))
        kinds: dict[Kind, type[Fmu]] = {"cs": CoSimulationFmu, "me": ModelExchangeFmu}
        block = super().__new__(kinds[file.kind(named.get("kind"))])
        block.__dict__["_file"] = file
        return block

    def __init__(
        self,
        path: str | Path,
        *,
        kind: str | None = None,
        step: float | None = None,
        parameters: Mapping[str, Any] | None = None,
        start: Mapping[str, Any] | None = None,
        units: Mapping[str, str | None] | None = None,
        delayed: bool = False,
        tolerance: float | None = None,
        time_limit: float | None = None,
        logging: bool = False,
        max_bytes: float = MAX_BYTES,
    ) -> None:
        file: FmuFile = self.__dict__.get("_file") or FmuFile.read(path, max_bytes)
        file.kind(kind or self._kind)
        for option, value in (("tolerance", tolerance), ("time_limit", time_limit)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise FmuError(f"Fmu: {option} = {value!r} must be positive and finite")
        given = {**(parameters or {}), **(start or {})}
        if twice := (parameters or {}).keys() & (start or {}).keys():
            raise FmuError(f"'{min(twice)}' is given both as a parameter and as a start value")
        reserved = set(dir(type(self))) | set(Block.__annotations__)
        interface = ImportInterface(
            file.description, given, units or {}, reserved, with_states=self._kind == "me"
        )
        self.__dict__.update(
            _file=file,
            _interface=interface,
            _declared=self._all_declared(interface),
            _options={"time_limit": time_limit, "logging": logging},
            _tolerance=tolerance,
            _delayed=delayed,
            _live={},
            _units=dict(units or {}),
        )
        super().__init__()
        self._finish(step)

    def _all_declared(self, interface: ImportInterface) -> dict[str, Any]:
        return interface.declarations

    def _finish(self, step: float | None) -> None:
        """Set what is left when the block is constructed."""

    # -- what there is ------------------------------------------------------------------------

    @property
    def description(self) -> FmuDescription:
        """The model description of the FMU."""
        found: FmuDescription = self.__dict__["_interface"].description
        return found

    @property
    def variables(self) -> dict[str, tuple[str, ...]]:
        """The FMU's names of the variables behind each port, parameter and state."""
        found: dict[str, tuple[str, ...]] = self.__dict__["_interface"].variables()
        return found

    @property
    def log(self) -> tuple[tuple[int, str, str], ...]:
        """What the FMU logged in the present or last run: status, category and text."""
        live = self.__dict__["_live"]
        if "fmu" in live:
            live["log"] = tuple(live["fmu"].log)
        return tuple(live.get("log", ()))

    # -- running ------------------------------------------------------------------------------

    def on_start(self, p: Signals) -> None:
        """Unpack and load the FMU.

        Parameters
        ----------
        p : Signals
            Parameters by name [units as the FMU states].
        """
        self.on_stop()
        own, interface = self.__dict__, self.__dict__["_interface"]
        self._live.update(
            fmu=open_instance(
                self._opens, own["_file"], start=interface.fixed_starts(), name=self.name, **own["_options"]
            ),
            starts=interface.changed(p),
            tuned=interface.tunable(p),
            u=interface.initial_inputs(),
            time=None,
        )

    def on_stop(self) -> None:
        """Free and unload the FMU, and delete what was unpacked."""
        fmu = self._live.get("fmu")
        try:
            if fmu is not None:
                self._live["log"] = _log_of(fmu)
                fmu.close()
        finally:
            for name in [n for n in self._live if n != "log"]:
                del self._live[name]

    def _set_up(self, t: float, u: Vector) -> None:
        """Initialize the FMU anew."""
        self._live["fmu"].setup(
            t, tolerance=self.__dict__["_tolerance"], inputs=u if u.size else None, start=self._live["starts"]
        )

    def _retuned(self, p: Signals) -> Starts:
        """Return the tunable parameters that changed since they were last looked at."""
        interface, live = self.__dict__["_interface"], self._live
        now, before = interface.tunable(p), live["tuned"]
        if np.array_equal(now, before):
            return {}
        live["tuned"] = now
        found: Starts = interface.retuned(p, before)
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy gets: nothing of the run."""
        return {**super().__getstate__(), "_live": {}}


def _without_self(function: Any) -> inspect.Signature:
    signature = inspect.signature(function)
    return signature.replace(parameters=list(signature.parameters.values())[1:])


# What editors and documentation show, instead of the signature of __new__.
setattr(Fmu, "__signature__", _without_self(Fmu.__init__))  # noqa: B010 - no type declares it


def _log_of(fmu: Any) -> tuple[tuple[int, str, str], ...]:
    """Return what an FMU logged; nothing if its process has ended."""
    try:
        return tuple(fmu.log)
    except FmuError:
        return ()
