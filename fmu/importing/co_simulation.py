"""Co-simulation FMUs as sampled blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.types import Array
from trussflow.fmu.errors import FmuCallError, FmuError
from trussflow.fmu.importing.block import Fmu
from trussflow.fmu.runtime.description import Kind
from trussflow.fmu.runtime.library import DISCARD, Step
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.loaded_model_exchange import LoadedModelExchange
from trussflow.fmu.runtime.saved_states import restore_state, saved_state

if TYPE_CHECKING:
    from trussflow.fmu.importing.fmu_unit import FmuUnit

HALVINGS = 10
"""How often a step is halved before an FMU that discards it is given up."""

MOST_PARTS = 100_000
"""Parts of one step after which an FMU that keeps returning early is given up."""

ROUND_OFF = 1e-9
"""Part of a step that counts as nothing: times are added up in floating point."""


class CoSimulationFmu(Fmu):
    """An FMU that steps itself; the parameters are those of `Fmu`."""

    _kind: ClassVar[Kind] = "cs"
    _opens: ClassVar[type[LoadedCoSimulation | LoadedModelExchange]] = LoadedCoSimulation

    def _finish(self, step: float | None) -> None:
        description = self.description
        suggested = step
        if step is None:
            suggested = description.step or description.kinds["cs"].fixed_step
        if suggested is None:
            raise FmuError(
                f"FMU '{description.name}' does not say which step suits it; give step, the time "
                "between two exchanges of inputs and outputs [s]"
            )
        self.sampled(suggested)

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return the inputs that each output depends on within an instant."""
        found: dict[str, tuple[str, ...]] = self.__dict__["_interface"].feedthrough()
        return dict.fromkeys(found, ()) if self.__dict__["_delayed"] else found

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Take note of the inputs at the start, which initialization may depend on.

        Parameters
        ----------
        u, p : Signals
            Inputs and parameters by name [units as the FMU states].
        """
        self.__dict__["_interface"].inputs.put(u, self._live["u"])
        return {}

    def cosimulation_slave(self, p: Signals) -> FmuUnit:
        """Return what steps the FMU as a unit of a co-simulation, without this block.

        Parameters
        ----------
        p : Signals
            Parameters by name [units as the FMU states].
        """
        from trussflow.fmu.importing.fmu_unit import fmu_unit

        return fmu_unit(self, p)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Step the FMU to the present time, and return its outputs.

        Parameters
        ----------
        t : array, shape ()
            Time [s].
        x, u, p : Signals
            States (none), inputs and parameters by name [units as the FMU states].
        """
        live, interface = self._live, self.__dict__["_interface"]
        fmu, flat = live["fmu"], live["u"]
        if "direct" not in live:
            live["direct"] = {name for names in self.feedthrough().values() for name in names}
        if live["time"] is None:
            interface.inputs.put(u, flat, live["direct"])
            self._set_up(float(t), flat)
            live["time"] = float(t)
        else:
            self._advance(float(t))
            if live["direct"]:
                interface.inputs.put(u, flat, live["direct"])
                fmu.set_inputs(flat)
        found: Values = interface.outputs.split(fmu.get_outputs())
        return found

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Keep the inputs, and changed parameters, for the step that follows.

        The arguments `t`, `x`, `u` and `p` are those of `output`.
        """
        live, interface = self._live, self.__dict__["_interface"]
        interface.inputs.put(u, live["u"])
        if changed := self._retuned(p):
            live["fmu"].tune(changed)
        return {}

    def _advance(self, until: float) -> None:
        """Step the FMU to a time, in parts if it returns early or discards."""
        live = self._live
        fmu, time = live["fmu"], live["time"]
        if live["u"].size:
            fmu.set_inputs(live["u"])
        whole = float(self.sample_time or 0.0)
        longest, halved, rollback = np.inf, 0, live.get("rollback", False)
        small, refused = ROUND_OFF * whole, None
        for _ in range(MOST_PARTS):
            left = until - time
            step = min(whole if abs(left - whole) <= small else left, longest)
            try:
                done: Step = fmu.do_step(time, step, rollback=rollback)
            except FmuCallError as error:
                if refused is None:
                    raise
                raise self._discarded(*refused, ", and does not go on after that") from error
            refused = (time, step) if done.discarded else None
            ended = done.terminate
            if done.event:
                ended = fmu.handle_event() or ended
            if ended:
                raise FmuError(
                    f"FMU '{self.description.name}' asks to end the run at t = {done.time:g} s"
                    f"{fmu.log_text()}"
                )
            if done.discarded and done.time - time <= small:
                halved, longest = halved + 1, step / 2
                self._check_discard(time, step, halved)
            time = max(time, done.time)
            if until - time <= small:
                live["time"] = until
                return
        raise FmuError(
            f"FMU '{self.description.name}' returned early {MOST_PARTS} times in the step from "
            f"t = {live['time']:g} s"
        )

    def _check_discard(self, time: float, step: float, halved: int) -> None:
        """Give up an FMU that cannot do a step, nor parts of it."""
        variable = self.description.kinds["cs"].variable_step
        if variable and halved <= HALVINGS:
            return
        raise self._discarded(
            time, step, ", and all parts of it" if variable else ", and does not take smaller ones"
        )

    def _discarded(self, time: float, step: float, more: str) -> FmuCallError:
        hint = "" if self.__dict__["_options"]["logging"] else "; logging=True may tell more"
        error = FmuCallError(
            f"FMU '{self.description.name}' discarded its step of {step:g} s from t = {time:g} s"
            f"{more}{hint}{self._live['fmu'].log_text()}"
        )
        error.status = DISCARD
        return error

    # -- going back -----------------------------------------------------------------------------

    def on_save(self) -> Any:
        """Return the state of the FMU and where it stands.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        live = self._live
        saved = {"time": live["time"], "u": live["u"].copy(), "tuned": live["tuned"]}
        live["rollback"] = True
        if live["time"] is not None:
            saved["state"] = saved_state(live["fmu"])
        return saved

    def on_restore(self, saved: Any) -> None:
        """Go back to what `on_save` returned.

        Parameters
        ----------
        saved : object
            That.
        """
        live = self._live
        live.update(time=saved["time"], u=np.array(saved["u"]), tuned=np.array(saved["tuned"]), rollback=True)
        if saved["time"] is not None:
            if not live["fmu"].initialized:
                self._set_up(saved["time"], live["u"])
            restore_state(live["fmu"], saved["state"])
