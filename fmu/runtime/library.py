"""The binary of an FMU, loaded, and one instance of it: calls with checked status."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn

from trussflow.blocks.framework.temporary import not_loaded
from trussflow.blocks.framework.types import Vector
from trussflow.fmu.errors import FmuBinaryError, FmuCallError, FmuError
from trussflow.fmu.runtime.description import FmuDescription, Kind
from trussflow.fmu.runtime.messages import Messages, status_name
from trussflow.fmu.runtime.signatures import function

WARNING, DISCARD, ERROR, FATAL = 1, 2, 3, 4
"""The statuses that are told apart; anything else above a warning is an error."""

_alone: set[str] = set()
"""Tokens of the FMUs that have an instance in this process and allow no second one."""

Call = Callable[[], None]
"""A function of the FMU with all its arguments, which raises an error unless all is well."""


class Step(NamedTuple):
    """How a step of co-simulation ended.

    Attributes
    ----------
    time : float
        Time reached [s]; short of the end of the step if it was discarded or returned early.
    discarded : bool
        Whether the FMU could not do the step; up to `time` it did.
    early : bool
        Whether the FMU returned early on purpose; it can be stepped on from `time`.
    event : bool
        Whether there is an event to be handled at `time`.
    terminate : bool
        Whether the FMU asks to end the run.
    """

    time: float
    discarded: bool = False
    early: bool = False
    event: bool = False
    terminate: bool = False


class Update(NamedTuple):
    """What an event did.

    Attributes
    ----------
    again : bool
        Whether discrete states must be updated once more.
    terminate : bool
        Whether the FMU asks to end the run.
    states_changed : bool
        Whether continuous states jumped.
    next_time : float
        Time of the next time event [s]; infinite if there is none.
    """

    again: bool
    terminate: bool
    states_changed: bool
    next_time: float


def binary_path(description: FmuDescription, kind: Kind) -> str:
    """Return where in an FMU its binary for this machine is.

    Parameters
    ----------
    description : FmuDescription
        The model description.
    kind : str
        ``"cs"`` or ``"me"``.
    """
    from fmpy import platform, platform_tuple, sharedLibraryExtension

    folder = platform if description.version == 2 else platform_tuple
    identifier = description.kinds[kind].identifier
    return f"binaries/{folder}/{identifier}{sharedLibraryExtension}"


class Library:
    """A loaded binary and its instance; `Library2` and `Library3` know the versions of FMI.

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
        If there is no binary for this machine, or it cannot be loaded.
    """

    version: ClassVar[int]
    accessors: ClassVar[dict[str, tuple[str, Any]]]
    """For each type the name of its functions, and the type of its elements in C."""

    flag: ClassVar[Any]
    """The type of a truth value in C."""

    state_word: ClassVar[str]
    """How the functions around saved states spell what they are about."""

    deserialize_name: ClassVar[str]
    """How the function is called that makes a saved state of bytes."""

    derivatives_name: ClassVar[str]
    """How the function for derivatives is called."""

    def __init__(self, folder: Path, description: FmuDescription, kind: Kind) -> None:
        self.folder, self.description, self.kind = folder, description, kind
        self.capabilities = description.kinds[kind]
        self.log = Messages()
        self.component: Any = None
        self.dead = False  # no function may be called any more
        self.broken = False  # the instance may only be freed
        path = folder / binary_path(description, kind)
        try:
            self._library = ctypes.CDLL(str(path))
        except OSError as error:
            raise FmuBinaryError(
                f"the binary of FMU '{description.name}' cannot be loaded: {not_loaded(error)}"
            ) from error
        self._functions: dict[str, Any] = {}

    def function(self, name: str) -> Any:
        """Return a function of the binary."""
        if name not in self._functions:
            self._functions[name] = function(self._library, self.version, name)
        return self._functions[name]

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function with the instance.

        Parameters
        ----------
        name : str
            Name without the prefix.
        *arguments : object
            All but the instance.

        Raises
        ------
        FmuCallError
            If the status is an error.
        """
        self.bound(name, *arguments)()

    def fail(self, name: str, status: int) -> NoReturn:
        """Raise the error of a call.

        Parameters
        ----------
        name : str
            Name of the function without the prefix.
        status : int
            What it returned [-].
        """
        self.dead = self.dead or status == FATAL
        self.broken = self.broken or status >= ERROR
        error = FmuCallError(
            f"FMU '{self.description.name}': fmi{self.version}{name} returned status "
            f"'{status_name(status)}'{self.log.text()}"
        )
        error.status = status
        raise error

    def bound(self, name: str, *arguments: Any) -> Call:
        """Return a call with everything it needs, for the inner loop.

        Parameters
        ----------
        name : str
            Name without the prefix.
        *arguments : object
            All but the instance.
        """
        status_of = partial(self.function(name), self.component, *arguments)

        def checked() -> None:
            if (status := status_of()) > WARNING:
                self.fail(name, status)

        return checked

    def vector_call(self, name: str, vector: Vector) -> Call:
        """Return a call that hands over a vector of floats, such as the continuous states.

        Parameters
        ----------
        name : str
            Name without the prefix.
        vector : Vector
            Where the values are [units as the FMU states]; it must not move.
        """
        return self.bound(name, vector.ctypes.data, vector.size)

    def accessor(self, get: bool, kind: str, references: Sequence[int], buffer: Any, count: int) -> Call:
        """Return the call that reads or writes variables of one type.

        Parameters
        ----------
        get : bool
            Whether to read.
        kind : str
            Type of the variables.
        references : sequence of int
            Value references [-].
        buffer : object
            Where the values are: anything that ctypes takes for a pointer.
        count : int
            Number of values [-].
        """
        name = f"{'Get' if get else 'Set'}{self.accessors[kind][0]}"
        listed = (ctypes.c_uint * len(references))(*references)
        sizes = (count,) if self.version == 3 else ()
        return self.bound(name, listed, len(references), buffer, *sizes)

    def enter_initialization(self, start: float, tol: float | None) -> None:
        """Set up the experiment and enter initialization mode.

        Parameters
        ----------
        start : float
            Time at which it begins [s].
        tol : float or None
            Relative tolerance of the FMU's own solver [-].
        """
        experiment = tol is not None, tol or 0.0, start, False, 0.0
        if self.version == 2:  # FMI 3 has made one function of the two
            self.call("SetupExperiment", *experiment)
            self.call("EnterInitializationMode")
        else:
            self.call("EnterInitializationMode", *experiment)

    def completed_step(self) -> tuple[bool, bool]:
        """Tell that a step of model exchange was accepted; return (event wanted, end wanted)."""
        event, end = self.flag(), self.flag()
        self.call("CompletedIntegratorStep", True, ctypes.byref(event), ctypes.byref(end))
        return bool(event.value), bool(end.value)

    # -- what the versions do differently ---------------------------------------------------

    def instantiate(self, name: str, *, logging: bool) -> None:
        """Make the instance.

        Parameters
        ----------
        name : str
            Name of the instance, in its log.
        logging : bool
            Whether it should log as much as it can.

        Raises
        ------
        FmuCallError
            If the FMU refuses.
        """
        raise NotImplementedError

    def step_call(self, rollback: bool) -> Callable[[float, float], Step]:
        """Return the function that does a step of co-simulation from a time, of a size [s].

        Parameters
        ----------
        rollback : bool
            Whether the FMU must keep what it needs to go back before the step.
        """
        raise NotImplementedError

    def update_discrete(self) -> Update:
        """Update discrete states once, in event mode."""
        raise NotImplementedError

    # -- instance ---------------------------------------------------------------------------

    def instantiated(self, component: Any) -> None:
        """Keep the instance, or say why there is none."""
        self.component = component
        if component and self.capabilities.once_per_process:
            _alone.add(self.description.token)
        if not component:
            raise FmuCallError(
                f"FMU '{self.description.name}' could not be instantiated; often its GUID or "
                f"instantiation token does not match the binary{self.log.text()}"
            )

    def check_alone(self) -> None:
        """Refuse a second instance of an FMU that allows one per process.

        Raises
        ------
        FmuError
            If there is one already.
        """
        if self.capabilities.once_per_process and self.description.token in _alone:
            raise FmuError(
                f"FMU '{self.description.name}' allows one instance in a process "
                "(canBeInstantiatedOnlyOncePerProcess), and there is one; stop that one, or give "
                "time_limit, so that this one runs in a process of its own"
            )

    def free(self) -> None:
        """Free the instance, if there is one and it can still be called."""
        component, self.component = self.component, None
        if component:
            _alone.discard(self.description.token)
        if component and not self.dead:
            self.function("FreeInstance")(component)

    def close(self) -> None:
        """Free the instance and unload the binary."""
        self.free()
        if not self.dead:
            unload(self._library)


def unload(library: ctypes.CDLL) -> None:
    """Unload a library.

    Parameters
    ----------
    library : ctypes.CDLL
        The library; it must not be used any more.
    """
    from fmpy import freeLibrary

    freeLibrary(library._handle)
