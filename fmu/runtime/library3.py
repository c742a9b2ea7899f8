"""FMI 3.0: what it does in its own way."""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from trussflow.fmu.runtime.library import DISCARD, WARNING, Library, Step, Update
from trussflow.fmu.runtime.messages import callback3

_TYPES: dict[str, Any] = {
    "Float32": np.float32,
    "Float64": np.float64,
    "Boolean": np.bool_,
    "String": object,
    "Int8": np.int8,
    "UInt8": np.uint8,
    "Int16": np.int16,
    "UInt16": np.uint16,
    "Int32": np.int32,
    "UInt32": np.uint32,
    "Int64": np.int64,
    "UInt64": np.uint64,
}


class Library3(Library):
    """An FMU of FMI 3.0; the parameters are those of `Library`."""

    version: ClassVar[int] = 3
    flag: ClassVar[Any] = ctypes.c_bool
    accessors: ClassVar[dict[str, tuple[str, Any]]] = {
        **{name: (name, kind) for name, kind in _TYPES.items()},
        "Enumeration": ("Int64", np.int64),
    }
    state_names: ClassVar[dict[str, str]] = {
        "get": "GetFMUState",
        "set": "SetFMUState",
        "free": "FreeFMUState",
        "size": "SerializedFMUStateSize",
        "serialize": "SerializeFMUState",
        "deserialize": "DeserializeFMUState",
    }
    derivatives_name: ClassVar[str] = "GetContinuousStateDerivatives"

    _logger: Any = None

    def instantiate(self, name: str, *, logging: bool) -> None:
        """Make the instance; early return and event mode are used where the FMU has them.

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
        self._logger = callback3(self.log)
        folder = self.folder / "resources"
        resources = f"{folder}{os.sep}".encode() if folder.is_dir() else None
        common = name.encode(), self.description.token.encode(), resources, False, logging
        logger = ctypes.cast(self._logger, ctypes.c_void_p)
        if self.kind == "cs":
            events = self.capabilities.event_mode
            early = events or self.capabilities.early_return
            component = self.function("InstantiateCoSimulation")(
                *common, events, early, None, 0, None, logger, None
            )
        else:
            component = self.function("InstantiateModelExchange")(*common, None, logger)
        self.instantiated(component)

    def enter_initialization(self, start: float, stop: float | None, tol: float | None) -> None:
        """Enter initialization mode.

        Parameters
        ----------
        start : float
            Time at which it begins [s].
        stop : float or None
            Time at which it ends [s], if known.
        tol : float or None
            Relative tolerance of the FMU's own solver [-].
        """
        self.call(
            "EnterInitializationMode", tol is not None, tol or 0.0, start, stop is not None, stop or 0.0
        )

    def step_call(self, rollback: bool) -> Callable[[float, float], Step]:
        """Return the function that does a step of co-simulation from a time, of a size [s].

        Parameters
        ----------
        rollback : bool
            Whether the FMU must keep what it needs to go back before the step.
        """
        do_step, component, prior = self.function("DoStep"), self.component, not rollback
        event, end, early = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        reached = ctypes.c_double()
        pointers = [ctypes.byref(place) for place in (event, end, early, reached)]

        def step(t: float, h: float) -> Step:
            status = do_step(component, t, h, prior, *pointers)
            if status <= WARNING:
                if early.value:
                    return Step(reached.value, False, True, event.value, end.value)
                if event.value or end.value:
                    return Step(t + h, False, False, event.value, end.value)
                return Step(t + h)
            if status != DISCARD:
                self.fail("DoStep", status)
            inside = early.value and t <= reached.value <= t + h
            return Step(reached.value if inside else t, True, False, False, end.value)

        return step

    def update_discrete(self) -> Update:
        """Update discrete states once, in event mode."""
        again, end, nominals, changed, defined = (ctypes.c_bool() for _ in range(5))
        time = ctypes.c_double()
        flags = [ctypes.byref(flag) for flag in (again, end, nominals, changed, defined)]
        self.call("UpdateDiscreteStates", *flags, ctypes.byref(time))
        next_time = time.value if defined.value else math.inf
        return Update(again.value, end.value, changed.value, next_time)

    def completed_step(self) -> tuple[bool, bool]:
        """Tell that a step of model exchange was accepted; return (event wanted, end wanted)."""
        event, end = ctypes.c_bool(), ctypes.c_bool()
        self.call("CompletedIntegratorStep", True, ctypes.byref(event), ctypes.byref(end))
        return event.value, end.value
