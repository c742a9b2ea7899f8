"""What both kinds of FMU have in common: from the file to an initialized instance."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Self

from trussflow.blocks.framework.errors import TrussflowError
from trussflow.blocks.framework.types import Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.runtime.archive import remove, unpack
from trussflow.fmu.runtime.description import NUMERIC, FmuDescription, FmuVariable, Kind
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.library import Library, Update
from trussflow.fmu.runtime.library2 import Library2
from trussflow.fmu.runtime.library3 import Library3
from trussflow.fmu.runtime.start_values import apply, resized, resolve
from trussflow.fmu.runtime.variable_buffers import VariableBuffers

MAX_UPDATES = 100
"""Updates of discrete states at one event above which an FMU is taken to never settle."""


class KnownFmu:
    """What is known of an FMU in use before it runs, wherever it runs.

    Parameters
    ----------
    kind : str
        ``"cs"`` or ``"me"``.
    file : FmuFile, str or pathlib.Path
        The FMU.
    start : mapping of str to object
        Start values by the FMU's names [units as the FMU states]; structural parameters decide sizes.

    Raises
    ------
    FmuError
        If the FMU is refused.

    Attributes
    ----------
    description : FmuDescription
        The model description.
    capabilities : Capabilities
        What the FMU can do.
    inputs, outputs : tuple of FmuVariable
        The inputs and outputs that are numbers, in the order of their places in the vectors.
    """

    def __init__(self, kind: Kind, file: FmuFile | str | Path, start: Mapping[str, Any]) -> None:
        self.file = file if isinstance(file, FmuFile) else FmuFile.read(file)
        self.file.kind(kind)
        self.description = resized(self.file.description, start)
        self.capabilities = self.description.kinds[kind]
        self.inputs, self.outputs = (numbers(self.description, c) for c in ("input", "output"))

    def close(self) -> None:
        """End its use; nothing is left on disk."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class LoadedFmu(KnownFmu):
    """An FMU, unpacked and loaded, and its instance; the base of both kinds.

    Parameters
    ----------
    file : FmuFile, str or pathlib.Path
        The FMU.
    start : mapping of str to object, optional
        Parameters and start values by the FMU's names [units as the FMU states].
    name : str, optional
        Name of the instance, in its log; by default that of the model.
    logging : bool
        Whether the FMU should log all it can, rather than faults only.
    folder : pathlib.Path, optional
        Where it is unpacked already; it is deleted at the end.

    Raises
    ------
    FmuError
        If the FMU is refused, or a name or value in `start` is wrong; nothing is left on disk.

    Attributes
    ----------
    input_values : Vector
        The buffer of the inputs, which may be written in place [units as the FMU states].
    """

    kind: ClassVar[Kind]

    generation: int = 0
    """How many instances there were; saved states belong to one."""

    def __init__(
        self,
        file: FmuFile | str | Path,
        *,
        start: Mapping[str, Any] | None = None,
        name: str | None = None,
        logging: bool = False,
        folder: Path | None = None,
    ) -> None:
        super().__init__(self.kind, file, start or {})
        self._starts = resolve(self.description, start or {})
        self._name, self._logging = name or self.description.name, logging
        folder = folder or unpack(self.file.path, self.file.max_bytes)
        self._finalizer: Any = weakref.finalize(self, remove, folder)
        try:
            self.file.check_unchanged(folder)
            library = Library2 if self.description.version == 2 else Library3
            self._library: Library = library(folder, self.description, self.kind)
        except BaseException:
            self._finalizer()
            raise
        self._input = VariableBuffers(self.inputs, self._library, writes=True)
        self._output = VariableBuffers(self.outputs, self._library, writes=False)
        self.input_values = self._input.values

    @property
    def initialized(self) -> bool:
        """Whether there is an instance."""
        return self._library.component is not None

    @property
    def log(self) -> tuple[tuple[int, str, str], ...]:
        """The latest log messages: status, category and text."""
        return tuple(self._library.log.messages)

    def log_text(self) -> str:
        """Return the latest log messages for an error message."""
        return self._library.log.text()

    # -- life -------------------------------------------------------------------------------

    def setup(
        self,
        start_time: float = 0.0,
        *,
        tolerance: float | None = None,
        inputs: Vector | None = None,
        start: Mapping[str, Any] | None = None,
    ) -> None:
        """Make a new instance and initialize it; an instance that was there is freed.

        Parameters
        ----------
        start_time : float
            Time at which the run begins [s].
        tolerance : float, optional
            Relative tolerance of the FMU's own solver [-]; by default what the FMU suggests.
        inputs : Vector, optional
            Inputs at the start [units as the FMU states]; by default the FMU's start values.
        start : mapping of str to object, optional
            Start values besides those given to the constructor [units as the FMU states].

        Raises
        ------
        FmuCallError
            If the FMU refuses; its own log is part of the message.
        FmuError
            If it failed fatally before: by the standards no instance may be made any more.
        """
        library = self._library
        if library.dead:
            raise FmuError(f"FMU '{self.description.name}' failed fatally before; close it and load it anew")
        self._free()
        self.generation += 1
        library.broken = False
        library.log.messages.clear()
        library.check_alone()
        library.instantiate(self._name, logging=self._logging)
        starts = {**self._starts, **resolve(self.description, start or {})}
        known = self.description.variables
        structure = {n: starts.pop(n) for n in list(starts) if known[n].is_structural}
        if structure:  # sizes of arrays can be set in a mode of their own only
            library.call("EnterConfigurationMode")
            apply(library, structure)
            library.call("ExitConfigurationMode")
        apply(library, starts)
        tolerance = self.description.tolerance if tolerance is None else tolerance
        library.enter_initialization(float(start_time), tolerance)
        self._input.bind()
        self._output.bind()
        if inputs is not None:
            self._input.values[:] = inputs
            self._input.write()
        library.call("ExitInitializationMode")
        self._started(float(start_time))

    def _started(self, time: float) -> None:
        """Prepare what needs an instance that is initialized."""
        raise NotImplementedError

    def tune(self, values: Mapping[str, Any]) -> None:
        """Change parameters between steps.

        Parameters
        ----------
        values : mapping of str to object
            Values by the FMU's names [units as the FMU states].

        Raises
        ------
        FmuError
            If a name or value is wrong, or the FMU refuses.
        """
        apply(self._library, resolve(self.description, values))

    def read(self, names: tuple[str, ...]) -> Vector:
        """Return the present values of variables, whatever their causality.

        Parameters
        ----------
        names : tuple of str
            The FMU's names of numbers [units as the FMU states].

        Raises
        ------
        FmuError
            If there is no such number.
        """
        known = self.description.variables
        for name in names:
            if name not in known or known[name].type not in NUMERIC:
                raise FmuError(f"FMU '{self.description.name}' has no number '{name}'")
        bank = VariableBuffers([known[name] for name in names], self._library, writes=False)
        bank.bind()
        bank.read()
        return bank.values

    def _free(self) -> None:
        """End and free the instance, if there is one."""
        library = self._library
        if library.component and not library.broken:
            with suppress(TrussflowError):  # it is freed in any case
                library.call("Terminate")
        library.free()

    def close(self) -> None:
        """Free the instance, unload the binary and delete the unpacked files."""
        if self._finalizer.alive:
            try:
                self._free()
                self._library.close()
            finally:
                self._finalizer()

    def _settle(self) -> Update:
        """Update discrete states, in event mode, until they settle; return what that did in all."""
        states_changed = False
        for _ in range(MAX_UPDATES):
            update = self._library.update_discrete()
            states_changed = states_changed or update.states_changed
            if update.terminate or not update.again:
                return update._replace(states_changed=states_changed)
        raise FmuError(
            f"FMU '{self.description.name}': its discrete states did not settle after "
            f"{MAX_UPDATES} updates at one event"
        )

    # -- values -----------------------------------------------------------------------------

    def set_inputs(self, values: Vector | None = None) -> None:
        """Set all inputs.

        Parameters
        ----------
        values : Vector, optional
            The inputs [units as the FMU states]; by default what stands in `input_values`.

        Raises
        ------
        FmuError
            If a value is none of the input's type, or the FMU refuses it.
        """
        if values is not None:
            self._input.values[:] = values
        self._input.write()

    def get_outputs(self) -> Vector:
        """Return all outputs, in a vector that the next call overwrites.

        Raises
        ------
        FmuCallError
            If the FMU cannot compute them.
        """
        self._output.read()
        return self._output.values

    # -- going back -------------------------------------------------------------------------

    def save_state(self) -> int:
        """Return the handle of a copy of the state; free it with `free_state`.

        Raises
        ------
        FmuError
            If the FMU cannot do that.
        """
        if not self.capabilities.saves_state:
            raise FmuError(
                f"FMU '{self.description.name}' cannot save its state (canGetAndSetFMUState is "
                "not set in its model description)"
            )
        handle = ctypes.c_void_p()
        self._library.call(f"Get{self._library.state_word}", ctypes.byref(handle))
        return handle.value or 0

    def restore_state(self, state: int) -> None:
        """Go back to a saved state, which stays valid.

        Parameters
        ----------
        state : int
            What `save_state` returned [-].
        """
        self._library.call(f"Set{self._library.state_word}", ctypes.c_void_p(state))

    def free_state(self, state: int) -> None:
        """Free a saved state.

        Parameters
        ----------
        state : int
            What `save_state` returned [-].
        """
        library = self._library
        if library.component and not library.dead:
            library.call(f"Free{library.state_word}", ctypes.byref(ctypes.c_void_p(state)))

    def serialize_state(self, state: int) -> bytes:
        """Return a saved state as bytes.

        Parameters
        ----------
        state : int
            What `save_state` returned [-].

        Raises
        ------
        FmuError
            If the FMU cannot do that.
        """
        if not self.capabilities.serializes_state:
            raise FmuError(
                f"FMU '{self.description.name}' cannot turn its state into bytes "
                "(canSerializeFMUState is not set in its model description)"
            )
        word, handle, size = self._library.state_word, ctypes.c_void_p(state), ctypes.c_size_t()
        self._library.call(f"Serialized{word}Size", handle, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self._library.call(f"Serialize{word}", handle, buffer, size.value)
        return buffer.raw

    def deserialize_state(self, content: bytes) -> int:
        """Return the handle of a state that was turned into bytes.

        Parameters
        ----------
        content : bytes
            What `serialize_state` returned, of this or another instance of the same FMU.
        """
        handle = ctypes.c_void_p()
        buffer = ctypes.create_string_buffer(content, len(content))
        self._library.call(self._library.deserialize_name, buffer, len(content), ctypes.byref(handle))
        return handle.value or 0


def numbers(description: FmuDescription, causality: str) -> tuple[FmuVariable, ...]:
    """Return the variables of one causality that are numbers.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    causality : str
        As FMI defines it.
    """
    return tuple(v for v in description.having(causality) if v.type in NUMERIC)
