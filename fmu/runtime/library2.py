"""Functions of FMI 2.0 that differ from FMI 3.0."""

from __future__ import annotations

import ctypes
import math
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np

from trussflow.fmu.errors import FmuBinaryError
from trussflow.fmu.runtime.library import Library, Step, Update
from trussflow.fmu.runtime.messages import STATUS_DISCARD, STATUS_WARNING, callbacks2

KIND_LAST_SUCCESSFUL_TIME, KIND_TERMINATED = 2, 3
"""Values of ``fmi2StatusKind`` that are queried after a discarded step."""


class Library2(Library):
    """An FMU of FMI 2.0; the parameters are those of `Library`."""

    version: ClassVar[int] = 2
    accessors: ClassVar[dict[str, tuple[str, Any]]] = {
        "Real": ("Real", np.float64),
        "Integer": ("Integer", np.int32),
        "Enumeration": ("Integer", np.int32),
        "Boolean": ("Boolean", np.int32),
        "String": ("String", object),
    }
    state_word: ClassVar[str] = "FMUstate"
    deserialize_name: ClassVar[str] = "DeSerializeFMUstate"
    derivatives_name: ClassVar[str] = "GetDerivatives"

    _callbacks: Any = None

    def instantiate(self, name: str, *, logging: bool) -> None:
        """Create the instance; see `Library`."""
        if self._callbacks is None:
            self._callbacks = callbacks2(self.log, self.folder)
        # FMI 2 takes a URI; FMI 3 takes a path with a separator at its end.
        resources = (self.folder / "resources").as_uri()
        component = self.function("Instantiate")(
            name.encode(),
            int(self.kind == "cs"),
            self.description.token.encode(),
            resources.encode(),
            ctypes.byref(self._callbacks),
            0,
            int(logging),
        )
        self.instantiated(component)

    def do_step(self, t: float, h: float, rollback: bool) -> Step:
        """Perform a co-simulation step; see `Library`.

        The time that a discarded step reached is its start if the FMU does not report it.
        """
        status = self.function("DoStep")(self.component, t, h, int(not rollback))
        if status <= STATUS_WARNING:
            return Step(t + h)
        if status != STATUS_DISCARD:
            self.fail("DoStep", status)
        reached = ctypes.c_double(t)
        ended = ctypes.c_int(0)
        # Some FMUs lack the status functions; then no part of the step counts.
        with suppress(FmuBinaryError):
            status = self.function("GetRealStatus")(
                self.component, KIND_LAST_SUCCESSFUL_TIME, ctypes.byref(reached)
            )
            if status > STATUS_WARNING or not t <= reached.value <= t + h:
                reached.value = t
            status = self.function("GetBooleanStatus")(
                self.component, KIND_TERMINATED, ctypes.byref(ended)
            )
            if status > STATUS_WARNING:
                ended.value = 0
        return Step(reached.value, discarded=True, terminate=bool(ended.value))

    def update_discrete(self) -> Update:
        """Update discrete states once, in event mode."""
        from fmpy.fmi2 import fmi2EventInfo

        info = fmi2EventInfo()
        self.call("NewDiscreteStates", ctypes.byref(info))
        return Update(
            bool(info.newDiscreteStatesNeeded),
            bool(info.terminateSimulation),
            bool(info.valuesOfContinuousStatesChanged),
            info.nextEventTime if info.nextEventTimeDefined else math.inf,
        )

    def close(self) -> None:
        """Free the instance and unload the binary and its logger library."""
        super().close()
        # Unloaded after the FMU, which may log until its instance is freed.
        proxy = getattr(self._callbacks, "proxy", None)
        if proxy is not None and not self.dead:
            from fmpy import freeLibrary

            del self._callbacks.proxy
            freeLibrary(proxy._handle)
