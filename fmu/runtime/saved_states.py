"""Saved states of FMUs: bytes if the FMU can serialize them, else handles for the same run."""

from __future__ import annotations

import weakref
from contextlib import suppress
from typing import Any

from trussflow.fmu.errors import FmuError


class HeldState:
    """A state inside an FMU instance that cannot serialize it to bytes.

    Parameters
    ----------
    fmu : object
        A `LoadedCoSimulation` or `LoadedModelExchange`, or one in a child process.
    """

    def __init__(self, fmu: Any) -> None:
        # A saved state must not keep the FMU loaded.
        self.fmu = weakref.ref(fmu)
        self.instance = fmu.generation
        self.handle = fmu.save_state()
        self._name = fmu.description.name
        weakref.finalize(self, _free, self.fmu, self.instance, self.handle)

    def __repr__(self) -> str:
        return f"a state of FMU '{self._name}', which cannot serialize it to bytes (no canSerializeFMUState)"


def _free(fmu: weakref.ref[Any], instance: int, handle: int) -> None:
    """Free a state, if its instance still exists."""
    found = fmu()
    if found is None:
        return
    with suppress(FmuError):  # the state is already gone if the child process has ended
        # An earlier instance took its states with it when it was freed.
        if found.generation == instance:
            found.free_state(handle)


def saved_state(fmu: Any) -> bytes | HeldState:
    """Return the state of an FMU as bytes if it can serialize them, else as a `HeldState`.

    Parameters
    ----------
    fmu : object
        A `LoadedCoSimulation` or `LoadedModelExchange`, or one in a child process.

    Raises
    ------
    FmuError
        If the FMU cannot save its state.
    """
    if not fmu.capabilities.canSerializeFMUstate:
        return HeldState(fmu)
    content: bytes = fmu.state_to_bytes()
    return content


def restore_state(fmu: Any, state: bytes | HeldState) -> None:
    """Restore a saved state in an initialized FMU.

    Parameters
    ----------
    fmu : object
        A `LoadedCoSimulation` or `LoadedModelExchange`, or one in a child process.
    state : bytes or HeldState
        Result of `saved_state`.

    Raises
    ------
    FmuError
        If the state belongs to another instance.
    """
    if not isinstance(state, HeldState):
        fmu.state_from_bytes(state)
        return
    owner: Any = state.fmu()
    if owner is not fmu or state.instance != owner.generation:
        raise FmuError(
            f"cannot restore FMU '{fmu.description.name}': it cannot serialize its state to "
            "bytes, so only the run that saved the state can restore it"
        )
    owner.restore_state(state.handle)
