"""An FMU for co-simulation in one run: it steps itself.

The one rule for steps that do not end where they should, wherever the FMU runs: one that returns
early is stepped on from where it came to; one that discards a step is given half of it, if it takes
steps of different lengths, again and again, until it gives in or `StepDiscardedError` is raised.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.running import SelfStepping
from trussflow.blocks.framework.types import Vector
from trussflow.fmu.errors import FmuCallError, FmuDiscardError, FmuEndedStepError, FmuError
from trussflow.fmu.importing.fmu_run import FmuRun
from trussflow.fmu.importing.import_interface import Side
from trussflow.fmu.runtime.description import REAL
from trussflow.fmu.runtime.library import Step
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.saved_states import HeldState, restore_state, saved_state

if TYPE_CHECKING:
    from trussflow.fmu.importing.block import Fmu

HALVINGS = 10
"""How often a step is halved before an FMU that discards it is given up."""

MOST_PARTS = 100_000
"""Parts of one step after which an FMU that keeps returning early is given up."""

ROUND_OFF = 1e-9
"""Part of a step that counts as nothing: times are added up in floating point."""

NUDGE = 1e-3
"""How much inputs are moved to see whether outputs follow, relative and absolute
[-, unit of the input]."""


class CoSimulationRun(FmuRun, SelfStepping):
    """An FMU that steps itself, in one run.

    Parameters
    ----------
    block : Fmu
        The block.
    p : Signals
        Its parameters, which follow when they are changed [units as the FMU states].
    """

    def __init__(self, block: Fmu, p: Signals) -> None:
        super().__init__(block, p, LoadedCoSimulation)
        interface = self._interface
        self._inputs, self._outputs = _places(interface.inputs), _places(interface.outputs)
        self._u = interface.initial_inputs()
        self._slopes: Vector | None = None
        self._delayed = block.delayed
        self._direct = any(block.feedthrough().values())
        self._nominal = float(block.sample_time or 0.0)
        self.varies = self._fmu.capabilities.variable_step
        self._saved_once = False
        self._follows: bool | None = None
        self._begun: tuple[float, Vector] | None = None

    # -- the start ------------------------------------------------------------------------------

    def start(self, time: float, inputs: Vector) -> None:
        """Initialize the FMU with these inputs; where they are NaN, with start values of its own."""
        self._u[self._inputs] = np.where(np.isnan(inputs), self._u[self._inputs], inputs)
        before = self._begun  # a co-simulation asks again until all signals at the start fit
        same = before is not None and before[0] == time and np.array_equal(before[1], self._u)
        if same or (before is not None and self._delayed):
            return
        self._set_up(time, self._u)
        self.ramps = self._fmu.can_interpolate
        self._begun = time, self._u.copy()

    @property
    def refreshes(self) -> bool:  # type: ignore[override] # found out when it is first asked for
        """Whether outputs follow inputs between two steps.

        FMI leaves that to the FMU. So it is tried out at the start, on a saved state: an FMU that
        cannot be restored is taken not to follow.
        """
        if self._follows is None:
            self._follows = self.restores and self._direct and self._tried()
        return self._follows

    def _tried(self) -> bool:
        """Move the inputs, and see whether the outputs follow."""
        fmu = self._fmu
        saved, before = HeldState(fmu), fmu.get_outputs().copy()
        inputs = self._interface.inputs.order
        is_real = np.array([v.type in REAL for v in inputs for _ in range(v.size)], dtype=bool)
        try:
            fmu.set_inputs(np.where(is_real, self._u * (1.0 + NUDGE) + NUDGE, self._u))
            follows = not np.array_equal(before, fmu.get_outputs(), equal_nan=True)
            fmu.set_inputs(self._u)
            restore_state(fmu, saved)
        except FmuCallError:  # it does not allow that: begin again
            assert self._begun is not None
            self._set_up(self._begun[0], self._u)
            return False
        return follows

    # -- steps ----------------------------------------------------------------------------------

    def set(self, inputs: Vector, rates: Vector | None = None) -> None:
        """Set all inputs and how fast they change, and parameters that were changed."""
        self._begun = None
        self._u[self._inputs] = inputs
        self._slopes = None
        if self.ramps and self._u.size:
            self._slopes = np.zeros_like(self._u)
            if rates is not None:
                self._slopes[self._inputs] = rates
        self._write(0.0)
        if self._look and (changed := self._retuned()):
            self._fmu.tune(changed)

    def _write(self, since: float) -> None:
        """Give the FMU its inputs as they are some time after they were set [s]."""
        if not self._u.size:
            return
        if self._slopes is None:
            self._fmu.set_inputs(self._u)
        else:
            self._fmu.set_inputs(self._u + self._slopes * since)
            self._fmu.set_input_derivatives(self._slopes)

    def advance(self, now: float, until: float) -> None:
        """Take one step, in parts if the FMU returns early or discards."""
        self._begun = None
        fmu, time, longest, halved = self._fmu, now, np.inf, 0
        small = ROUND_OFF * (until - now)
        refused: tuple[float, float] | None = None
        for part in range(MOST_PARTS):
            self._refuse_after_end(until)
            left = until - time
            if abs(left - self._nominal) <= small:
                left = self._nominal  # to the last digit the same in every step
            if part and self._slopes is not None:
                self._write(time - now)
            step = min(left, longest)
            try:
                done: Step = fmu.do_step(time, step, rollback=self._saved_once)
            except FmuCallError as error:
                if refused is None:
                    raise
                raise self._discarded(*refused, ", and does not go on after that") from error
            refused = (time, step) if done.discarded else None
            ended = done.terminate
            if done.event:
                ended = fmu.handle_event() or ended
            stuck = done.discarded and done.time - time <= small
            if ended and not stuck:  # where it could do nothing, smaller steps are tried first
                self._ended = done.time
            if stuck:
                halved, longest = halved + 1, step / 2
                if not self.varies:
                    raise self._discarded(time, step, ", and does not take smaller ones", ended)
                if halved > HALVINGS:
                    raise self._discarded(time, step, ", and all parts of it", ended)
            time = max(time, done.time)
            if until - time <= small:
                return
        raise FmuError(
            f"FMU '{self._description.name}' returned early {MOST_PARTS} times in the step from t = {now:g} s"
        )

    def _discarded(self, time: float, step: float, more: str, ended: bool = False) -> FmuDiscardError:
        asks = f"asks to end the run at t = {time:g} s: it " if ended else ""
        hint = "" if self._logs_all else "; logging=True may tell more"
        kind = FmuEndedStepError if ended else FmuDiscardError
        return kind(
            f"FMU '{self._description.name}' {asks}discarded its step of {step:g} s from t = {time:g} s"
            f"{more}{hint}{self._fmu.log_text()}"
        )

    def outputs(self) -> Vector:
        """Return all outputs, in the order of the ports."""
        found: Vector = self._fmu.get_outputs()[self._outputs]
        return found

    # -- going back -------------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """Return the state of the FMU: as bytes, if it can.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        self._saved_once = True
        return self._kept(saved_state(self._fmu)) | {"u": self._u.copy()}

    def mark(self) -> dict[str, Any]:
        """Return the state of the FMU, for this run alone."""
        self._saved_once = True
        return self._kept(HeldState(self._fmu)) | {"u": self._u.copy()}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to what `save` or `mark` returned."""
        self._begun, self._saved_once = None, True
        self._u[:], self._slopes = saved["u"], None  # rates are set anew before each step
        self._went_back(saved)


def _places(side: Side) -> Any:
    """Return where each element of the ports, one after the other, is in the FMU's vector."""
    numbered = side.split(np.arange(float(side.size)))
    parts = [values.ravel() for values in numbered.values()]
    places = np.concatenate([np.zeros(0), *parts]).astype(np.int64)
    return slice(None) if np.array_equal(places, np.arange(side.size)) else places
