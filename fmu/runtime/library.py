"""Loaded binary of an FMU and one instance of it: calls with checked status."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.support.temporary_folders import not_loaded
from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import PYTHON_LOGGER, FmuBinaryError, FmuCallError, FmuError
from trussflow.fmu.runtime.description import FmuDescription, Kind
from trussflow.fmu.runtime.messages import (
    STATUS_ERROR,
    STATUS_FATAL,
    STATUS_WARNING,
    Messages,
    status_name,
)
from trussflow.fmu.runtime.signatures import (
    ARGUMENT_TYPES,
    FUNCTION_SIGNATURES,
    RESULT_TYPES,
)

_alone: set[str] = set()
"""Tokens of FMUs that allow one instance per process and have one in this process."""


class Call:
    """Function of the FMU with bound arguments, for the inner loop; a call raises an error if it fails.

    Parameters
    ----------
    library : Library
        Library of the instance.
    name : str
        Name without the prefix.
    *arguments : object
        Arguments after the instance.
    """

    def __init__(self, library: Library, name: str, *arguments: Any) -> None:
        self._library = library
        self._name = name
        self.function = library.function(name)
        # Keeps arrays of value references alive, whose address C gets.
        self.arguments = arguments
        self._status = partial(self.function, library.component, *arguments)

    def __call__(self) -> None:
        """Call the function."""
        self.check(self._status())

    def check(self, status: int) -> None:
        """Raise an error if the `status` of a call [-] is not good."""
        if status > STATUS_WARNING:
            self._library.fail(self._name, status)


def call_words(call: Call | None) -> list[int]:
    """Return the function of a call and its arguments after the instance: ``tf_call`` of ``driver.c``."""
    every = (call.function, *call.arguments) if call else ()
    words = [ctypes.cast(a, ctypes.c_void_p).value or 0 for a in every]
    return (words + [0] * 5)[:5]


class Step(NamedTuple):
    """Result of a co-simulation step.

    Attributes
    ----------
    time : float
        Time reached [s]; before the end of the step if it was discarded or returned early.
    discarded : bool
        Whether the FMU discarded the step after `time`.
    early : bool
        Whether the FMU returned early; the next step can start at `time`.
    event : bool
        Whether an event must be handled at `time`.
    terminate : bool
        Whether the FMU requests the end of the run.
    """

    time: float
    discarded: bool = False
    early: bool = False
    event: bool = False
    terminate: bool = False


class Update(NamedTuple):
    """Result of one update of the discrete states.

    Attributes
    ----------
    again : bool
        Whether the discrete states must be updated once more.
    terminate : bool
        Whether the FMU requests the end of the run.
    states_changed : bool
        Whether the continuous states changed.
    next_time : float
        Time of the next time event [s]; infinite if there is none.
    """

    again: bool
    terminate: bool
    states_changed: bool
    next_time: float


def binary_path(description: FmuDescription, kind: Kind) -> str:
    """Return the path of the binary for this machine inside an FMU.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    kind : str
        ``"cs"`` or ``"me"``.
    """
    from fmpy import platform, platform_tuple, sharedLibraryExtension

    # FMI 2: "linux64"; FMI 3: "x86_64-linux".
    folder = platform if description.version == 2 else platform_tuple
    identifier = description.kinds[kind].modelIdentifier
    return f"binaries/{folder}/{identifier}{sharedLibraryExtension}"


class Library:
    """Loaded binary and its instance; `Library2` and `Library3` implement the versions of FMI.

    Parameters
    ----------
    folder : pathlib.Path
        The unpacked FMU.
    description : FmuDescription
        Its model description.
    kind : str
        ``"cs"`` or ``"me"``.

    Raises
    ------
    FmuBinaryError
        If the FMU has no binary for this machine, or it cannot be loaded.
    """

    version: ClassVar[int]
    accessors: ClassVar[dict[str, tuple[str, Any]]]
    """Name of the access functions and C type of the elements, by FMI type."""

    state_word: ClassVar[str]
    """Word for the FMU state in the names of the state functions."""

    deserialize_name: ClassVar[str]
    """Name of the function that deserializes a state."""

    derivatives_name: ClassVar[str]
    """Name of the function that returns the state derivatives."""

    def __init__(self, folder: Path, description: FmuDescription, kind: Kind) -> None:
        self.folder = folder
        self.description = description
        self.kind = kind
        self.capabilities = description.kinds[kind]
        self.log = Messages()
        self.component: Any = None
        self.dead = False  # after a fatal error FMI forbids all calls
        self.broken = False  # after an error FMI only allows freeing the instance
        path = folder / binary_path(description, kind)
        try:
            self._library = ctypes.CDLL(str(path))
        except OSError as error:
            raise FmuBinaryError(
                f"the binary of FMU '{description.name}' cannot be loaded: {not_loaded(error)}"
            ) from error
        self._functions: dict[str, Any] = {}

    def function(self, name: str) -> Any:
        """Return a function of the binary.

        Parameters
        ----------
        name : str
            Name without the prefix.

        Raises
        ------
        FmuBinaryError
            If the binary does not contain the function.
        """
        if name not in self._functions:
            full = f"fmi{self.version}{name}"
            try:
                found = self._library[full]
            except AttributeError:
                raise FmuBinaryError(
                    f"the binary of the FMU has no function {full}; it was built incompletely"
                ) from None
            signature = FUNCTION_SIGNATURES[self.version, name]
            found.argtypes = [ARGUMENT_TYPES[letter] for letter in signature]
            found.restype = RESULT_TYPES.get(name, ctypes.c_int)
            self._functions[name] = found
        return self._functions[name]

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function with the instance.

        Parameters
        ----------
        name : str
            Name without the prefix.
        *arguments : object
            Arguments after the instance.

        Raises
        ------
        FmuCallError
            If the status is an error.
        """
        Call(self, name, *arguments)()

    def fail(self, name: str, status: int) -> NoReturn:
        """Raise the error of a call.

        Parameters
        ----------
        name : str
            Name of the function without the prefix.
        status : int
            Status that the function returned [-].
        """
        # Permanent: FMI forbids even a new instance after a fatal error.
        self.dead = self.dead or status == STATUS_FATAL
        self.broken = self.broken or status >= STATUS_ERROR
        error = FmuCallError(
            f"FMU '{self.description.name}': fmi{self.version}{name} returned status "
            f"'{status_name(status)}'{self.log.text()}"
        )
        error.status = status
        raise error

    def vector_call(self, name: str, vector: Vector) -> Call:
        """Return a call that passes a vector of floats, such as the continuous states.

        Parameters
        ----------
        name : str
            Name without the prefix.
        vector : Vector
            Buffer of the values [units as the FMU states]; it must not be reallocated.
        """
        return Call(self, name, vector.ctypes.data, vector.size)

    def accessor(
        self, get: bool, kind: str, references: Sequence[int], buffer: Any, count: int
    ) -> Call:
        """Return the call that reads or writes variables of one type.

        Parameters
        ----------
        get : bool
            Whether to read.
        kind : str
            FMI type of the variables.
        references : sequence of int
            Value references [-].
        buffer : object
            Buffer of the values, as a pointer that ctypes accepts.
        count : int
            Number of values [-].
        """
        name = f"{'Get' if get else 'Set'}{self.accessors[kind][0]}"
        # A variable of FMI 3 may be an array: values and references differ in number.
        sizes = (count,) if self.version == 3 else ()
        return Call(self, name, *self.listed(references), buffer, *sizes)

    @staticmethod
    def listed(references: Sequence[int]) -> tuple[Any, int]:
        """Return value references [-] as an array of C, and their number."""
        return (ctypes.c_uint * len(references))(*references), len(references)

    def enter_initialization(self, start: float, tol: float | None) -> None:
        """Set up the experiment and enter initialization mode.

        Parameters
        ----------
        start : float
            Start time of the experiment [s].
        tol : float or None
            Relative tolerance of the FMU's own solver [-].
        """
        experiment = tol is not None, tol or 0.0, start, False, 0.0
        if self.version == 2:  # FMI 3 has one function for both calls
            self.call("SetupExperiment", *experiment)
            self.call("EnterInitializationMode")
        else:
            self.call("EnterInitializationMode", *experiment)

    # -- differences between the versions ---------------------------------------------------

    def instantiate(self, name: str, *, logging: bool) -> None:
        """Create the instance.

        Parameters
        ----------
        name : str
            Name of the instance, used in its log.
        logging : bool
            Whether the FMU logs all its messages.

        Raises
        ------
        FmuCallError
            If the FMU returns no instance.
        """
        raise NotImplementedError

    def do_step(self, t: float, h: float, rollback: bool) -> Step:
        """Perform a co-simulation step.

        Parameters
        ----------
        t, h : float
            Start and size of the step [s].
        rollback : bool
            Whether a state from before the step may be restored later.
        """
        raise NotImplementedError

    def update_discrete(self) -> Update:
        """Update discrete states once, in event mode."""
        raise NotImplementedError

    # -- instance ---------------------------------------------------------------------------

    def instantiated(self, component: Any) -> None:
        """Store the instance, or raise an error if there is none."""
        self.component = component
        if component and self.capabilities.canBeInstantiatedOnlyOncePerProcess:
            _alone.add(self.description.token)
        if not component:
            raise FmuCallError(
                f"FMU '{self.description.name}' could not be instantiated; often its GUID or "
                f"instantiation token does not match the binary{self.log.text()}"
            )

    def check_alone(self) -> None:
        """Raise an error for a second instance of an FMU that allows one per process.

        Raises
        ------
        FmuError
            If an instance exists already.
        """
        if (
            self.capabilities.canBeInstantiatedOnlyOncePerProcess
            and self.description.token in _alone
        ):
            raise FmuError(
                f"FMU '{self.description.name}' allows one instance in a process "
                "(canBeInstantiatedOnlyOncePerProcess), and one exists; stop that instance, or set "
                "time_limit to run this one in a child process"
            )

    def free(self) -> None:
        """Terminate and free the instance, if it exists and calls are still allowed."""
        PYTHON_LOGGER.removeHandler(self.log)
        if not self.component:
            return
        if not self.broken:
            with suppress(TrussflowError):
                # a failed Terminate does not prevent freeing
                self.call("Terminate")
        # Cleared first: a finalizer must not free the instance twice.
        component = self.component
        self.component = None
        _alone.discard(self.description.token)
        if not self.dead:
            self.function("FreeInstance")(component)

    def close(self) -> None:
        """Free the instance and unload the binary."""
        self.free()
        if not self.dead:
            from fmpy import freeLibrary

            freeLibrary(self._library._handle)
