"""Loaded FMU for co-simulation, with little overhead per step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.fmu.runtime.description import Kind
from trussflow.fmu.runtime.library import Step
from trussflow.fmu.runtime.loaded import LoadedFmu


class LoadedCoSimulation(LoadedFmu):
    """An FMU for co-simulation, loaded.

    Call `setup` first, then `set_inputs`, `do_step` and `get_outputs` for each step, and `close`
    at the end, or use a ``with`` statement. Call `setup` again to start a new run. `do_step`
    returns whether the step was completed, discarded or ended early; the caller decides how to
    continue. If a step ends at an event, call `handle_event` before the next step.

    The parameters are those of `LoadedFmu`.

    Examples
    --------
    ::

        with LoadedCoSimulation("plant.fmu") as slave:
            slave.setup(start={"mass": 2.0})
            for k in range(1000):
                slave.set_inputs(force)
                slave.do_step(k * 1e-3, 1e-3)
                y = slave.get_outputs()
    """

    kind: ClassVar[Kind] = "cs"

    def _started(self, time: float) -> None:
        self._written: Vector | None = None
        self._ended = False
        self._discrete = ~self._input.continuous
        if (
            self.capabilities.hasEventMode
        ):  # FMI 3: it is in event mode after initialization
            self._ended = self._leave_event_mode()

    def restore_state(self, state: int) -> None:
        """Restore a saved state; see `LoadedFmu.restore_state`."""
        super().restore_state(state)
        self._written = None  # the discrete inputs in the state are unknown
        self._ended = False

    def set_inputs(self, values: Vector | None = None) -> None:
        """Set all inputs; see `LoadedFmu.set_inputs`.

        If the FMU has an event mode, changed discrete inputs (integers, Booleans, discrete reals)
        are set in that mode.
        """
        if values is not None:
            self._input.values[:] = values
        if not (self.capabilities.hasEventMode and self._discrete.any()):
            self._input.write()
            return
        # A Boolean index copies, so `now` does not change with the buffer.
        now = self._input.values[self._discrete]
        if self._written is not None and np.array_equal(now, self._written):
            self._input.write(only_continuous=True)
            return
        self._library.call("EnterEventMode")
        self._input.write()
        self._ended = self._leave_event_mode()
        self._written = now

    def do_step(self, time: float, step: float, *, rollback: bool = False) -> Step:
        """Perform a step.

        Parameters
        ----------
        time, step : float
            Start time and size of the step [s].
        rollback : bool
            Whether a state from before this step may be restored later.

        Returns
        -------
        Step
            Result of the step. No step is performed if the FMU requested the end of the run when
            its inputs or parameters were set.

        Raises
        ------
        FmuCallError
            If the FMU fails; the message includes the FMU's log.
        """
        if self._ended:
            return Step(time, terminate=True)
        return self._library.do_step(time, step, rollback)

    def tune(self, values: Mapping[str, Any]) -> None:
        """Change parameters between steps, in event mode if the FMU has one; see `LoadedFmu.tune`."""
        if self.capabilities.hasEventMode:
            self._library.call("EnterEventMode")
        super().tune(values)
        if self.capabilities.hasEventMode:
            self._ended = self._leave_event_mode()

    def handle_event(self) -> bool:
        """Iterate the discrete states to convergence (FMI 3 with event mode).

        Returns
        -------
        bool
            Whether the FMU requests the end of the run.

        Raises
        ------
        FmuError
            If the discrete states do not converge.
        FmuCallError
            If the FMU fails.
        """
        self._library.call("EnterEventMode")
        return self._leave_event_mode()

    def _leave_event_mode(self) -> bool:
        """Iterate the discrete states and enter step mode; return whether the FMU requests the end."""
        update = self._settle()
        self._library.call("EnterStepMode")
        return update.terminate
