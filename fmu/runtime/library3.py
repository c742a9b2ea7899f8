"""Functions of FMI 3.0 that differ from FMI 2.0."""

from __future__ import annotations

import ctypes
import math
import os
from typing import Any, ClassVar

import numpy as np

from trussflow.fmu.runtime.description import INTEGER_TYPES
from trussflow.fmu.runtime.library import Library, Step, Update
from trussflow.fmu.runtime.messages import STATUS_DISCARD, STATUS_WARNING, callback3


class Library3(Library):
    """An FMU of FMI 3.0; the parameters are those of `Library`."""

    version: ClassVar[int] = 3
    accessors: ClassVar[dict[str, tuple[str, Any]]] = {
        **{
            kind: (kind, np.dtype(kind.lower()).type)
            for kind in ("Float32", "Float64", *INTEGER_TYPES)
        },
        "Boolean": ("Boolean", np.bool_),
        "String": ("String", object),
        "Enumeration": ("Int64", np.int64),
    }
    state_word: ClassVar[str] = "FMUState"
    deserialize_name: ClassVar[str] = "DeserializeFMUState"
    derivatives_name: ClassVar[str] = "GetContinuousStateDerivatives"

    _logger: Any = None

    def instantiate(self, name: str, *, logging: bool) -> None:
        """Create the instance; early return is enabled only with event mode, which handles it."""
        self._logger = callback3(self.log)
        # the results of a step: event, end, early, time
        self._results: Any = (*(ctypes.c_bool() for _ in range(3)), ctypes.c_double())
        self._pointers = [*map(ctypes.byref, self._results)]
        folder = self.folder / "resources"
        resources = f"{folder}{os.sep}".encode() if folder.is_dir() else None
        common = (
            name.encode(),
            self.description.token.encode(),
            resources,
            False,
            logging,
        )
        logger = ctypes.cast(self._logger, ctypes.c_void_p)
        if self.kind == "cs":
            events = self.capabilities.hasEventMode
            # Twice `events`: eventModeUsed and earlyReturnAllowed.
            component = self.function("InstantiateCoSimulation")(
                *common, events, events, None, 0, None, logger, None
            )
        else:
            component = self.function("InstantiateModelExchange")(*common, None, logger)
        self.instantiated(component)

    def do_step(self, t: float, h: float, rollback: bool) -> Step:
        """Perform a co-simulation step; see `Library`."""
        do_step = self.function("DoStep")
        status = do_step(self.component, t, h, not rollback, *self._pointers)
        event, end, early, reached = (result.value for result in self._results)
        if status <= STATUS_WARNING:
            # Of a whole step, the time that the FMU reports may have a round-off error.
            inside = early or (end and t <= reached <= t + h)
            return Step(reached if inside else t + h, False, early, event, end)
        if status != STATUS_DISCARD:
            self.fail("DoStep", status)
        inside = early and t <= reached <= t + h
        return Step(reached if inside else t, True, False, False, end)

    def update_discrete(self) -> Update:
        """Update discrete states once, in event mode."""
        again, end, nominals, changed, defined = (ctypes.c_bool() for _ in range(5))
        time = ctypes.c_double()
        flags = [
            ctypes.byref(flag) for flag in (again, end, nominals, changed, defined)
        ]
        self.call("UpdateDiscreteStates", *flags, ctypes.byref(time))
        next_time = time.value if defined.value else math.inf
        return Update(again.value, end.value, changed.value, next_time)
