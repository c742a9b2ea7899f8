"""Model exchange FMUs as continuous blocks."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.types import Array, Vector
from trussflow.fmu.errors import FmuError
from trussflow.fmu.importing.block import Fmu
from trussflow.fmu.importing.import_interface import ImportInterface
from trussflow.fmu.runtime.description import Kind
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.saved_states import restore_state, saved_state

PLACEHOLDER = "placeholder"
"""Name of the state, always zero, of a block whose FMU has none: solvers step from state to
state, and its events are found on the way."""


class ModelExchangeFmu(Fmu):
    """An FMU whose states our solver integrates; the parameters are those of `Fmu`."""

    _kind: ClassVar[Kind] = "me"
    _opens: ClassVar[type[LoadedCoSimulation | LoadedModelExchange]] = LoadedModelExchange

    def _all_declared(self, interface: ImportInterface) -> dict[str, Any]:
        declared = dict(interface.declarations)
        if not interface.states.size:
            state = State(meaning="always zero: the FMU has no states")
            state.name = PLACEHOLDER
            declared[PLACEHOLDER] = state
        return declared

    def _finish(self, step: float | None) -> None:
        if step is not None:
            raise FmuError(
                f"FMU '{self.description.name}' is used for model exchange: the diagram's solver "
                "has the step; leave out step, or say kind='cs'"
            )
        if self.__dict__["_delayed"]:
            raise FmuError(
                f"FMU '{self.description.name}' is used for model exchange, where nothing is held "
                "from instant to instant; leave out delayed, or say kind='cs'"
            )

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return the inputs that each output depends on within an instant."""
        found: dict[str, tuple[str, ...]] = self.__dict__["_interface"].feedthrough()
        return found

    # -- evaluation -----------------------------------------------------------------------------

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Initialize the FMU with its inputs at the start, and return its states.

        Parameters
        ----------
        u, p : Signals
            Inputs and parameters by name [units as the FMU states].
        """
        self._initialize(0.0, self._inputs(u))
        return self._by_name(self._live["fmu"].initial_states)

    def _initialize(self, t: float, u: Vector) -> None:
        self._set_up(t, u)
        self._live.update(time=t, fresh=True, last=None, pending=False, u=u)

    def _inputs(self, u: Signals) -> Vector:
        side = self.__dict__["_interface"].inputs
        flat = np.empty(side.size)
        side.put(u, flat)
        return flat

    def _by_name(self, flat: Vector) -> Values:
        """Return states, or their derivatives, by name."""
        states = self.__dict__["_interface"].states
        found: Values = states.split(flat) if states.size else {PLACEHOLDER: np.zeros(())}
        return found

    def _place(self, t: Array, x: Signals, u: Signals) -> Vector:
        """Bring the FMU to a point; return the inputs there."""
        live, states = self._live, self.__dict__["_interface"].states
        time, inputs = float(t), self._inputs(u)
        if live.pop("fresh", False) and time != live["time"]:
            self._initialize(time, inputs)  # the run does not begin at zero
            live.pop("fresh")
        flat = np.empty(states.size)
        states.put(x, flat)
        live["fmu"].place(time, flat, inputs)
        return inputs

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs.

        Parameters
        ----------
        t : array, shape ()
            Time [s].
        x, u, p : Signals
            States, inputs and parameters by name [units as the FMU states].
        """
        self._place(t, x, u)
        found: Values = self.__dict__["_interface"].outputs.split(self._live["fmu"].get_outputs())
        return found

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the derivatives of the states.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        self._place(t, x, u)
        return self._by_name(self._live["fmu"].derivatives())

    # -- events ---------------------------------------------------------------------------------

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Vector:
        """Return the event indicators.

        The arguments `t`, `x`, `u` and `p` are those of `output`. Inputs that jumped since the
        last accepted point, or may change at events only, ask for an event at once.
        """
        live = self._live
        inputs = self._place(t, x, u)
        last = live["last"]
        if last is None or last[0] == float(t):
            live["pending"] = (
                live["pending"]
                or live["fmu"].event_inputs_changed(inputs)
                or (last is not None and not np.array_equal(last[1], inputs))
                or self._is_retuned(p)
            )
        found: Vector = np.array(live["fmu"].indicators())
        return found

    def _is_retuned(self, p: Signals) -> bool:
        tunable = self.__dict__["_interface"].tunable(p)
        return not np.array_equal(tunable, self._live["tuned"])

    def next_event(self) -> float:
        """Return the time of the FMU's next time event [s]; at once if inputs jumped."""
        if self._live["pending"]:
            return -math.inf
        return float(self._live["fmu"].next_time)

    def on_step(self, t: Array, x: Signals, u: Signals, p: Signals) -> bool:
        """Tell the FMU that a step is accepted; return whether it wants an event.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        inputs = self._place(t, x, u)
        self._live["last"] = float(t), inputs
        wanted, ended = self._live["fmu"].completed_step()
        self._end_if(ended, t)
        return bool(wanted)

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals) -> dict[str, Array]:
        """Let the FMU handle an event; return its states if they jumped.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        live = self._live
        inputs = self._place(t, x, u)
        if live["last"] is None or live["last"][0] != float(t):
            live["fmu"].completed_step()
        changed = self._retuned(p)
        states, ended = live["fmu"].handle_event(inputs, changed)
        live.update(pending=False, last=(float(t), inputs))
        self._end_if(ended, t)
        return {} if states is None else self._by_name(states)

    def _end_if(self, ended: bool, t: Array) -> None:
        """Stop where the FMU asks for it."""
        if ended:
            raise FmuError(
                f"FMU '{self.description.name}' asks to end the run at t = {float(t):g} s"
                f"{self._live['fmu'].log_text()}"
            )

    # -- going back -------------------------------------------------------------------------------

    def on_save(self) -> Any:
        """Return the state of the FMU, what it keeps between events included.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        live = self._live
        return {
            "state": saved_state(live["fmu"]),
            "next": float(live["fmu"].next_time),
            "inputs": live["fmu"].input_values.copy(),
            "tuned": live["tuned"],
            "time": live["time"],
            "u": live["u"].copy(),
        }

    def on_restore(self, saved: Any) -> None:
        """Go back to what `on_save` returned.

        Parameters
        ----------
        saved : object
            That.
        """
        live = self._live
        restore_state(live["fmu"], saved["state"])
        live["fmu"].set_restored(saved["next"], saved["inputs"])
        live.update(tuned=np.array(saved["tuned"]), last=None, pending=False)
        live.pop("fresh", None)
