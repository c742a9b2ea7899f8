"""Base of both kinds of FMU: from the file to an initialized instance."""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import PYTHON_LOGGER, FmuError
from trussflow.fmu.runtime.archive import remove, unpack
from trussflow.fmu.runtime.description import Kind
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.library import Library, Update
from trussflow.fmu.runtime.library2 import Library2
from trussflow.fmu.runtime.library3 import Library3
from trussflow.fmu.runtime.start_values import apply
from trussflow.fmu.runtime.variable_buffers import VariableBuffers

MAX_UPDATES = 100
"""Maximum number of updates of the discrete states at one event."""


class KnownFmu:
    """Properties of an FMU in use that do not need its binary, for this or a child process.

    Parameters
    ----------
    kind : str
        ``"cs"`` or ``"me"``.
    file : FmuFile, str or pathlib.Path
        The FMU.

    Raises
    ------
    FmuError
        If the FMU is refused.

    Attributes
    ----------
    description : FmuDescription
        The model description.
    capabilities : object
        Capability flags of the kind in use.
    inputs, outputs : tuple of FmuVariable
        The numeric inputs and outputs, in the order of the input and output vectors.
    """

    def __init__(self, kind: Kind, file: FmuFile | str | Path) -> None:
        self.file = file if isinstance(file, FmuFile) else FmuFile.read(file)
        self.file.kind(kind)
        self.description = self.file.description
        self.capabilities = self.description.kinds[kind]
        self.inputs = self.description.numbers("input")
        self.outputs = self.description.numbers("output")

    def close(self) -> None:
        """Release the FMU and delete its temporary files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class LoadedFmu(KnownFmu):
    """An unpacked and loaded FMU and its instance; base class of both kinds.

    Parameters
    ----------
    file : FmuFile, str or pathlib.Path
        The FMU.
    name : str, optional
        Name of the instance, used in its log; by default the name of the model.
    logging : bool
        Whether the FMU logs all its messages instead of errors only.
    folder : pathlib.Path, optional
        Folder with the FMU already unpacked; `close` deletes it.

    Raises
    ------
    FmuError
        If the FMU is refused. The temporary files are deleted.

    Attributes
    ----------
    input_values : Vector
        Buffer of the inputs; the caller may write in place [units as the FMU states].
    """

    kind: ClassVar[Kind]

    generation: int = 0
    """Number of instances created so far; a saved state belongs to one of them."""

    def __init__(
        self,
        file: FmuFile | str | Path,
        *,
        name: str | None = None,
        logging: bool = False,
        folder: Path | None = None,
    ) -> None:
        super().__init__(self.kind, file)
        self._name = name or self.description.name
        self._logging = logging
        folder = folder or unpack(self.file.path)
        self._finalizer = weakref.finalize(self, remove, folder)
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
    def log(self) -> tuple[str, ...]:
        """The latest log messages: ``"[status] text"``."""
        return tuple(line for _, line in self._library.log.messages)

    def log_text(self) -> str:
        """Return the latest log messages for an error message."""
        return self._library.log.text()

    # -- setup ------------------------------------------------------------------------------

    def setup(
        self,
        start_time: float = 0.0,
        *,
        tolerance: float | None = None,
        inputs: Vector | None = None,
        start: Mapping[str, Any] | None = None,
    ) -> None:
        """Create a new instance and initialize it; an existing instance is freed first.

        Parameters
        ----------
        start_time : float
            Start time of the run [s].
        tolerance : float, optional
            Relative tolerance of the FMU's own solver [-]; by default that of its default experiment.
        inputs : Vector, optional
            Inputs at the start [units as the FMU states]; by default the FMU's start values.
        start : mapping of str to object, optional
            Parameters and start values, as `resolve` returns them [units as the FMU states].

        Raises
        ------
        FmuCallError
            If a call fails; the message includes the FMU's log.
        FmuError
            If a call failed fatally before: FMI forbids further instances then.
        """
        library = self._library
        if library.dead:
            raise FmuError(
                f"FMU '{self.description.name}' failed fatally before; close it and load it again"
            )
        library.free()
        self.generation += 1
        library.broken = False
        library.log.messages.clear()
        library.check_alone()
        # While it is created, the instance may log errors without its name.
        library.log.instance = ""
        # With logging on, the FMU's own log has these errors already.
        if not self._logging:
            PYTHON_LOGGER.addHandler(library.log)
        library.instantiate(self._name, logging=self._logging)
        library.log.instance = self._name
        starts = dict(start or {})
        known = self.description.variables
        structure = {n: starts.pop(n) for n in list(starts) if known[n].is_structural}
        if structure:  # array sizes can be set in configuration mode only
            library.call("EnterConfigurationMode")
            apply(library, structure)
            library.call("ExitConfigurationMode")
        apply(library, starts)
        if tolerance is None:
            tolerance = self.description.tolerance
        library.enter_initialization(start_time, tolerance)
        # Bound calls contain the instance, so each instance needs new ones.
        self._input.bind()
        self._output.bind()
        if inputs is not None:
            self._input.values[:] = inputs
            self._input.write()
        library.call("ExitInitializationMode")
        self._started(start_time)

    def _started(self, time: float) -> None:
        """Prepare the subclass after initialization."""
        raise NotImplementedError

    def tune(self, values: Mapping[str, Any]) -> None:
        """Change parameters between steps.

        Parameters
        ----------
        values : mapping of str to object
            Values, as `resolve` returns them [units as the FMU states].

        Raises
        ------
        FmuError
            If a value does not fit its type, or the FMU rejects it.
        """
        apply(self._library, values)

    def close(self) -> None:
        """Free the instance, unload the binary and delete the unpacked files."""
        if self._finalizer.alive:
            try:
                self._library.close()
            finally:
                self._finalizer()

    def _settle(self) -> Update:
        """Iterate the discrete states in event mode to convergence; return the combined update."""
        states_changed = False
        for _ in range(MAX_UPDATES):
            update = self._library.update_discrete()
            # The last update may report no change although an earlier one changed them.
            states_changed = states_changed or update.states_changed
            if update.terminate or not update.again:
                return update._replace(states_changed=states_changed)
        raise FmuError(
            f"FMU '{self.description.name}': its discrete states did not converge within "
            f"{MAX_UPDATES} updates at one event"
        )

    # -- values -----------------------------------------------------------------------------

    def set_inputs(self, values: Vector | None = None) -> None:
        """Set all inputs.

        Parameters
        ----------
        values : Vector, optional
            The inputs [units as the FMU states]; by default the content of `input_values`.

        Raises
        ------
        FmuError
            If a value does not fit the type of the input, or the FMU rejects it.
        """
        if values is not None:
            self._input.values[:] = values
        self._input.write()

    def get_outputs(self) -> Vector:
        """Return all outputs, in a vector that the next call overwrites.

        Raises
        ------
        FmuCallError
            If the FMU cannot compute the outputs.
        """
        self._output.read()
        return self._output.values

    # -- saved states -----------------------------------------------------------------------

    def save_state(self) -> int:
        """Return the handle of a copy of the state; free it with `free_state`.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        if not self.capabilities.canGetAndSetFMUstate:
            raise FmuError(
                f"FMU '{self.description.name}' cannot save its state (canGetAndSetFMUState is "
                "not set in its model description)"
            )
        handle = ctypes.c_void_p()
        self._library.call(f"Get{self._library.state_word}", ctypes.byref(handle))
        return handle.value or 0

    def restore_state(self, state: int) -> None:
        """Restore a saved state, which stays valid.

        Parameters
        ----------
        state : int
            Handle from `save_state` [-].
        """
        self._library.call(f"Set{self._library.state_word}", ctypes.c_void_p(state))

    def free_state(self, state: int) -> None:
        """Free a saved state.

        Parameters
        ----------
        state : int
            Handle from `save_state` [-].
        """
        library = self._library
        if library.component and not library.dead:
            library.call(
                f"Free{library.state_word}", ctypes.byref(ctypes.c_void_p(state))
            )

    def state_to_bytes(self) -> bytes:
        """Return the current state as bytes."""
        library = self._library
        word = library.state_word
        state = self.save_state()
        handle = ctypes.c_void_p(state)
        size = ctypes.c_size_t()
        try:
            library.call(f"Serialized{word}Size", handle, ctypes.byref(size))
            buffer = ctypes.create_string_buffer(size.value)
            library.call(f"Serialize{word}", handle, buffer, size.value)
        finally:
            self.free_state(state)
        return buffer.raw

    def state_from_bytes(self, content: bytes) -> None:
        """Restore a state.

        Parameters
        ----------
        content : bytes
            Result of `state_to_bytes` of this or another instance of the same FMU.
        """
        library = self._library
        handle = ctypes.c_void_p()
        # With its size, because ctypes appends a null byte otherwise.
        buffer = ctypes.create_string_buffer(content, len(content))
        library.call(
            library.deserialize_name, buffer, len(content), ctypes.byref(handle)
        )
        state = handle.value or 0
        try:
            self.restore_state(state)
        finally:
            self.free_state(state)
