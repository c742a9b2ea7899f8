"""Base class of a run of an FMU, for both kinds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import FmuEndedError, FmuError
from trussflow.fmu.runtime.child_process import Loaded, open_instance
from trussflow.fmu.runtime.saved_states import restore_state
from trussflow.fmu.runtime.start_values import Starts

if TYPE_CHECKING:
    from trussflow.fmu.importing.block import Fmu


class FmuRun(Running):
    """An FMU, unpacked and loaded for one run.

    Parameters
    ----------
    block : Fmu
        The block.
    p : Signals
        Its parameters, updated when they change [units as the FMU states].
    kind : type
        Class of the loaded FMU.
    """

    stuck = "its FMU cannot save its state (no canGetAndSetFMUState in its model description)"

    def __init__(self, block: Fmu, p: Signals, kind: type[Loaded]) -> None:
        self._interface = block.interface
        self._description = block.description
        self._p = p
        self._tolerance = block.tolerance
        self._logs_all = block.options["logging"]
        self._tuned = self._interface.tunable(p)
        self._look = False
        self._starts = self._interface.initial_values(p)
        self._ended: float | None = (
            None  # time at which the FMU requested the end of the run
        )
        self._fmu: Any = open_instance(
            kind, block.file, name=block.name, **block.options
        )

    @property
    def restores(self) -> bool:
        """Whether the FMU can restore a saved state."""
        return bool(self._fmu.capabilities.canGetAndSetFMUstate)

    @property
    def messages(self) -> tuple[str, ...]:
        """Latest log messages of the FMU: ``"[status] text"``."""
        try:
            return tuple(self._fmu.log)
        except FmuError:  # the child process has ended
            return ()

    def _set_up(self, time: float, inputs: Vector) -> None:
        """Initialize the FMU in a new instance."""
        self._ended = None
        self._fmu.setup(
            time, tolerance=self._tolerance, inputs=inputs, start=self._starts
        )

    def _retuned(self) -> Starts:
        """Return the tunable parameters that changed since the last call."""
        changes = self._changes()
        self._tuned = self._tuned | changes
        self._look = False
        return changes

    def _changes(self) -> Starts:
        """Return the tunable parameters that changed; compared only after a call of `tuned`."""
        # Compared on demand only, because this runs in every step.
        now = self._interface.tunable(self._p) if self._look else {}
        return {
            name: value
            for name, value in now.items()
            if not np.array_equal(value, self._tuned[name])
        }

    def tuned(self) -> None:
        """Note that parameters were changed."""
        self._look = True

    def _kept(self, state: Any) -> dict[str, Any]:
        """Return the argument of `_went_back` for a state of the FMU."""
        return {"state": state, "tuned": self._tuned, "ended": self._ended}

    def _went_back(self, saved: dict[str, Any]) -> None:
        """Restore the state of the FMU and the parameters that belong to it."""
        restore_state(self._fmu, saved["state"])
        # The parameters of the run may differ from those of the saved state.
        self._tuned = saved["tuned"]
        self._look = True
        self._ended = saved["ended"]

    def _refuse_after_end(self, time: float) -> None:
        """Raise `FmuEndedError` if `time` is after the end of the run that the FMU requested."""
        if self._ended is not None and time > self._ended:
            raise FmuEndedError(
                f"FMU '{self._description.name}' asks to end the run at t = {self._ended:g} s; the result of "
                f"this exception contains the log until then{self._fmu.log_text()}"
            )

    def close(self) -> None:
        """Free and unload the FMU, and delete its unpacked files."""
        self._fmu.close()
