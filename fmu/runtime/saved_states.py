"""Saved states of FMUs: bytes where the FMU can, else handles that only its own run can use."""

from __future__ import annotations

import weakref
from contextlib import suppress
from typing import Any

from trussflow.fmu.errors import FmuError


class HeldState:
    """A state that an FMU keeps for us because it cannot turn it into bytes.

    Parameters
    ----------
    fmu : object
        A `LoadedCoSimulation` or `LoadedModelExchange`, or one in a child process.
    """

    def __init__(self, fmu: Any) -> None:
        self.fmu, self.instance = weakref.ref(fmu), fmu.generation
        self.handle: int = fmu.save_state()
        self._name: str = fmu.description.name
        weakref.finalize(self, _free, self.fmu, self.instance, self.handle)

    def __repr__(self) -> str:
        return f"a state of FMU '{self._name}', which cannot turn it into bytes (no canSerializeFMUState)"


def _free(fmu: weakref.ref[Any], instance: int, handle: int) -> None:
    """Free a state, if the instance that keeps it is still there."""
    found = fmu()
    if found is None:
        return
    with suppress(FmuError):  # its process may have ended, and the state with it
        if found.initialized and found.generation == instance:
            found.free_state(handle)


def saved_state(fmu: Any) -> bytes | HeldState:
    """Return the state of an FMU: bytes if it can, else an object that keeps it.

    Parameters
    ----------
    fmu : object
        A `LoadedCoSimulation` or `LoadedModelExchange`, or one in a child process.

    Raises
    ------
    FmuError
        If it cannot save its state.
    """
    if not fmu.capabilities.serializes_state:
        return HeldState(fmu)
    handle = fmu.save_state()
    try:
        content: bytes = fmu.serialize_state(handle)
    finally:
        fmu.free_state(handle)
    return content


def restore_state(fmu: Any, state: bytes | HeldState) -> None:
    """Give an initialized FMU back a state.

    Parameters
    ----------
    fmu : object
        A `LoadedCoSimulation` or `LoadedModelExchange`, or one in a child process.
    state : bytes or HeldState
        What `saved_state` returned.

    Raises
    ------
    FmuError
        If the state is of an instance that is gone.
    """
    if isinstance(state, HeldState):
        keeper: Any = state.fmu()
        if keeper is not fmu or state.instance != fmu.generation:
            raise FmuError(
                f"cannot restore FMU '{fmu.description.name}': it cannot turn its state into "
                "bytes, so only the run that saved it can go back to it"
            )
        fmu.restore_state(state.handle)
        return
    handle = fmu.deserialize_state(state)
    try:
        fmu.restore_state(handle)
    finally:
        fmu.free_state(handle)
