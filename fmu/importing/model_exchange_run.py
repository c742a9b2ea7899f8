"""An FMU for model exchange in one run: our solver integrates its states."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.equations import Values
from trussflow.blocks.framework.types import Array, Vector
from trussflow.fmu.importing.fmu_run import FmuRun
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.saved_states import saved_state

if TYPE_CHECKING:
    from trussflow.fmu.importing.block import Fmu

PLACEHOLDER = "placeholder"
"""Name of the state, always zero, of a block whose FMU has none: solvers step from state to
state, and its events are found on the way."""


STATE_EVENT, TIME_EVENT = "state_event", "time_event"
"""Names of the events that such a block declares."""


class ModelExchangeRun(FmuRun):
    """An FMU that says what its derivatives are, in one run.

    Parameters
    ----------
    block : Fmu
        The block.
    p : Signals
        Its parameters, which follow when they are changed [units as the FMU states].
    """

    def __init__(self, block: Fmu, p: Signals) -> None:
        super().__init__(block, p, LoadedModelExchange)
        # When it was initialized, until it is first evaluated; NaN before.
        self._begun: float | None = math.nan
        self._in_run = False  # else it is evaluated anywhere, for linear analysis
        self._last: tuple[float, Vector] | None = None  # the last accepted point: time and inputs
        self._pending = False  # whether an event is to be handled at once

    # -- evaluation -----------------------------------------------------------------------------

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Initialize the FMU with its inputs at the start, and return its states."""
        self._initialize(0.0, self._interface.inputs.join(u))
        self._in_run = True
        return self._by_name(self._fmu.initial_states)

    def _initialize(self, time: float, inputs: Vector) -> None:
        self._set_up(time, inputs)
        self._begun, self._last, self._pending = time, None, False

    def _by_name(self, flat: Vector) -> Values:
        """Return states, or their derivatives, by name."""
        states = self._interface.states
        return states.split(flat) | ({} if states.size else {PLACEHOLDER: np.zeros(())})

    def _place(self, t: Array, x: Signals, u: Signals) -> Vector:
        """Bring the FMU to a point; return the inputs there."""
        time, inputs = float(t), self._interface.inputs.join(u)
        if self._begun is not None and time != self._begun:
            self._initialize(time, inputs)  # the run does not begin at zero
        self._begun = None
        states = self._interface.states.join(x)
        self._fmu.place(time, states, inputs)
        if not self._in_run:  # its discrete states become those of this point
            self._fmu.handle_event(inputs)
            self._fmu.place(time, states, inputs)
        return inputs

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs."""
        self._place(t, x, u)
        return self._interface.outputs.split(self._fmu.get_outputs())

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the derivatives of the states."""
        # Only steps go on after the end: events look ahead by a part of a step.
        self._refuse_after_end(float(t))
        self._place(t, x, u)
        return self._by_name(self._fmu.derivatives())

    # -- events ---------------------------------------------------------------------------------

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the event indicators, and the time of the FMU's next time event [s].

        Inputs that jumped since the last accepted point, or may change at events only, ask for an
        event at once.
        """
        inputs, last = self._place(t, x, u), self._last
        if last is None or last[0] >= float(t):  # an event may be a rounding error later
            self._pending = (
                self._pending
                or self._fmu.event_inputs_changed(inputs)
                or (last is not None and not np.array_equal(last[1], inputs))
                or self._is_retuned
            )
        next_time = -math.inf if self._pending else float(self._fmu.next_time)
        return {STATE_EVENT: np.array(self._fmu.indicators()), TIME_EVENT: next_time}

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Tell the FMU that a step is accepted; return whether it wants an event."""
        self._refuse_after_end(float(t))
        inputs = self._place(t, x, u)
        self._last = float(t), inputs
        wanted = self._completed_step(float(t))
        return wanted or bool(self._fmu.event_inputs_changed(inputs))

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        """Let the FMU handle an event; return its states if they jumped."""
        inputs = self._place(t, x, u)
        if self._last is None or self._last[0] != float(t):
            self._completed_step(float(t))
        states, ended = self._fmu.handle_event(inputs, self._retuned())
        self._pending, self._last = False, (float(t), inputs)
        self._ended = float(t) if ended else self._ended
        return {} if states is None else self._by_name(states)

    def _completed_step(self, time: float) -> bool:
        wanted, ended = self._fmu.completed_step()
        self._ended = time if ended else self._ended
        return bool(wanted)

    # -- going back -------------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """Return the state of the FMU, what it keeps between events included.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        inputs = self._fmu.input_values.copy()
        return self._kept(saved_state(self._fmu)) | {"next": float(self._fmu.next_time), "inputs": inputs}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to what `save` returned."""
        self._went_back(saved)
        self._fmu.set_restored(saved["next"], saved["inputs"])
        self._begun, self._last, self._pending, self._in_run = None, None, False, True


class DifferentiableRun(ModelExchangeRun):
    """A run of an FMU that has directional derivatives, and no inputs that change at events only."""

    def directional_derivative(
        self, kind: str, t: Array, x: Signals, u: Signals, p: Signals, dx: Signals, du: Signals
    ) -> Values:
        """Return how what `kind` returns changes along `dx` and `du` [units as the FMU states]."""
        self._place(t, x, u)
        found = self._fmu.along(kind, self._interface.states.join(dx), self._interface.inputs.join(du))
        return self._interface.outputs.split(found) if kind == "output" else self._by_name(found)
