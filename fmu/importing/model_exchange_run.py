"""Run of an FMU for model exchange, integrated by the solver of the diagram."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.equations import Values
from trussflow.blocks.support.types import Array, Vector
from trussflow.fmu.importing.fmu_run import FmuRun
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.saved_states import saved_state

if TYPE_CHECKING:
    from trussflow.fmu.importing.block import Fmu

PLACEHOLDER_STATE = "placeholder"
"""Name of a constant zero state for an FMU without states, because the solver locates events only
between steps of a state."""


STATE_EVENT, TIME_EVENT = "state_event", "time_event"
"""Names of the events of a block for model exchange."""


class ModelExchangeRun(FmuRun):
    """Run of an FMU for model exchange.

    Parameters
    ----------
    block : Fmu
        The block.
    p : Signals
        Its parameters, updated when they change [units as the FMU states].
    """

    def __init__(self, block: Fmu, p: Signals) -> None:
        super().__init__(block, p, LoadedModelExchange)
        # Time of initialization, until the first evaluation; NaN before initialization.
        self._begun: float | None = math.nan
        self._in_run = (
            False  # False: evaluated at arbitrary points, for linear analysis
        )
        self._last: tuple[float, Vector] | None = (
            None  # time and inputs of the last accepted point
        )
        self._pending = False  # whether an event must be handled immediately
        self._placed: object = None  # time, states and inputs of the FMU, if known

    # -- evaluation -----------------------------------------------------------------------------

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Initialize the FMU with its initial inputs, and return its states."""
        self._initialize(0.0, self._interface.inputs.join(u))
        self._in_run = True
        return self._by_name(self._fmu.initial_states)

    def _initialize(self, time: float, inputs: Vector) -> None:
        self._set_up(time, inputs)
        self._begun = time
        self._last = self._placed = None
        self._pending = False

    def _by_name(self, flat: Vector) -> Values:
        """Return states or their derivatives by name."""
        states = self._interface.states
        return states.split(flat) | (
            {} if states.size else {PLACEHOLDER_STATE: np.zeros(())}
        )

    def _place(self, t: Array, x: Signals, u: Signals) -> Vector:
        """Set time, states and inputs of the FMU; return the inputs."""
        time = float(t)
        inputs = self._interface.inputs.join(u)
        if self._begun is not None and time != self._begun:
            self._initialize(time, inputs)  # the run starts at another time than zero
        self._begun = None
        states = self._interface.states.join(x)
        # Several equations are evaluated at one point.
        point = time, states.tobytes(), inputs.tobytes()
        if self._in_run and point == self._placed:
            return inputs
        self._placed = point
        self._fmu.place(time, states, inputs)
        if not self._in_run:  # updates the discrete states to this point
            self._fmu.handle_event(inputs)
            self._fmu.place(time, states, inputs)
        return inputs

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs."""
        self._place(t, x, u)
        return self._interface.outputs.split(self._fmu.get_outputs())

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the derivatives of the states."""
        # Not checked in `indicators`, which event location may evaluate after the end.
        self._refuse_after_end(float(t))
        self._place(t, x, u)
        return self._by_name(self._fmu.derivatives())

    # -- events ---------------------------------------------------------------------------------

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the event indicators and the time of the FMU's next time event [s].

        Inputs that jumped since the last accepted point, and changed discrete inputs, cause an
        immediate event.
        """
        inputs = self._place(t, x, u)
        last = self._last
        if last is None or last[0] >= float(t):
            # round-off may put the accepted time after t
            self._pending = (
                self._pending
                or self._fmu.event_inputs_changed(inputs)
                or (last is not None and not np.array_equal(last[1], inputs))
                or bool(self._changes())
            )
        # A time event in the past is due now.
        next_time = -math.inf if self._pending else float(self._fmu.next_time)
        # A copy, because the next call overwrites the buffer.
        return {STATE_EVENT: np.array(self._fmu.indicators()), TIME_EVENT: next_time}

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Report an accepted step to the FMU; return whether an event is needed."""
        self._refuse_after_end(float(t))
        inputs = self._place(t, x, u)
        self._last = float(t), inputs
        changed = bool(self._fmu.event_inputs_changed(inputs))
        return self._completed_step(float(t)) or changed

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Let the FMU handle an event; return its states if they changed."""
        inputs = self._place(t, x, u)
        # FMI: a point is reported as accepted before its event; `on_step` may not have.
        if self._last is None or self._last[0] != float(t):
            self._completed_step(float(t))
        states, ended = self._fmu.handle_event(inputs, self._retuned())
        self._pending, self._placed = False, None
        self._last = (float(t), inputs)
        self._ended = float(t) if ended else self._ended
        return {} if states is None else self._by_name(states)

    def _completed_step(self, time: float) -> bool:
        wanted, ended = self._fmu.completed_step()
        self._ended = time if ended else self._ended
        return bool(wanted)

    # -- steps in C -----------------------------------------------------------------------------

    def compiled(self) -> list[int] | None:
        """Return the FMU for steps in C, if it is in this process, and has an accepted point but no event."""
        known = self._interface
        vectors = known.states, known.inputs, known.outputs
        if (
            self._last is None
            or self._ended is not None
            or self._changes()
            or not isinstance(self._fmu, LoadedModelExchange)
            or not all(isinstance(v.places, slice) for v in vectors)
        ):
            return None
        return self._fmu.compiled(*self._last)

    def resume(self) -> bool:
        """Continue from the last accepted point; return whether the FMU requests an event there."""
        time, inputs, event, end = self._fmu.resume()
        self._last, self._placed = (time, inputs), None
        self._ended = time if end else self._ended
        return bool(event)

    # -- saved states -----------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """Return the state of the FMU, its next time event and its inputs.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        inputs = self._fmu.input_values.copy()
        return self._kept(saved_state(self._fmu)) | {
            "next": float(self._fmu.next_time),
            "inputs": inputs,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the result of `save`."""
        self._went_back(saved)
        # FMI has no function that reads the next time event from a state.
        self._fmu.set_restored(saved["next"], saved["inputs"])
        self._begun = self._last = self._placed = None
        self._pending = False
        self._in_run = True


class DifferentiableRun(ModelExchangeRun):
    """Run of an FMU with directional derivatives and without discrete inputs."""

    def directional_derivative(
        self,
        kind: str,
        t: Array,
        x: Signals,
        u: Signals,
        p: Signals,
        dx: Signals,
        du: Signals,
    ) -> Values:
        """Return the derivative of method `kind` along `dx` and `du` [units as the FMU states]."""
        self._place(t, x, u)
        found = self._fmu.along(
            kind, self._interface.states.join(dx), self._interface.inputs.join(du)
        )
        return (
            self._interface.outputs.split(found)
            if kind == "output"
            else self._by_name(found)
        )
