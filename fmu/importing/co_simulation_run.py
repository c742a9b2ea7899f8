"""Run of an FMU for co-simulation.

After an early return, the step continues from the time reached. After a discarded step, the step
size is halved if the FMU allows variable steps, up to `MAX_HALVINGS` times; then
`StepDiscardedError` is raised.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.run_state import SelfStepping
from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import (
    FmuCallError,
    FmuDiscardError,
    FmuEndedStepError,
    FmuError,
)
from trussflow.fmu.importing.fmu_run import FmuRun
from trussflow.fmu.runtime.description import REAL_TYPES
from trussflow.fmu.runtime.library import Step
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.saved_states import HeldState, restore_state, saved_state

if TYPE_CHECKING:
    from trussflow.fmu.importing.block import Fmu

MAX_HALVINGS = 10
"""Maximum number of halvings of a step that the FMU discards [-]."""

MAX_PARTS = 100_000
"""Maximum number of parts of one step, for an FMU that returns early [-]."""

TIME_TOLERANCE = 1e-9
"""Tolerance of times relative to the step size [-], for round-off errors of their sums."""

INPUT_PERTURBATION = 1e-3
"""Perturbation of the inputs for the feedthrough test, relative and absolute
[-, unit of the input]."""


class CoSimulationRun(FmuRun, SelfStepping):
    """Run of an FMU for co-simulation.

    Parameters
    ----------
    block : Fmu
        The block.
    p : Signals
        Its parameters, updated when they change [units as the FMU states].
    """

    def __init__(self, block: Fmu, p: Signals) -> None:
        super().__init__(block, p, LoadedCoSimulation)
        interface = self._interface
        self._inputs = interface.inputs.places
        self._outputs = interface.outputs.places
        self._u = interface.initial_inputs()
        self._delayed = block.delayed
        self._direct = any(block.feedthrough().values())
        self._nominal = float(block.sample_time or 0.0)
        self.varies = self._fmu.capabilities.canHandleVariableCommunicationStepSize
        self._saved_once = False
        self._follows: bool | None = None
        self._begun: tuple[float, Vector] | None = None

    # -- initialization -------------------------------------------------------------------------

    def start(self, time: float, inputs: Vector) -> None:
        """Initialize the FMU with the given inputs; NaN selects the FMU's start value."""
        self._u[self._inputs] = np.where(
            np.isnan(inputs), self._u[self._inputs], inputs
        )
        if self._begun is not None:  # initial signals are iterated: several calls
            before, u = self._begun
            # Delayed outputs do not depend on the inputs: the first call is final.
            if self._delayed or (before == time and np.array_equal(u, self._u)):
                return
        self._set_up(time, self._u)
        self._begun = time, self._u.copy()

    @property
    def refreshes(self) -> bool:  # type: ignore[override] # tested on first access
        """Whether outputs change with the inputs between two steps.

        FMI leaves this to the FMU. It is tested at the start and the state is restored afterwards.
        If the FMU cannot restore its state, the value is False.
        """
        if self._follows is None:
            self._follows = self.restores and self._direct and self._tried()
        return self._follows

    def _tried(self) -> bool:
        """Return whether the outputs change when the inputs are perturbed."""
        fmu = self._fmu
        saved, before = HeldState(fmu), fmu.get_outputs().copy()
        inputs = self._interface.inputs.order
        # Integers and Booleans cannot take a small perturbation.
        real = np.array([v.type in REAL_TYPES for v in inputs for _ in range(v.size)])
        try:
            fmu.set_inputs(
                self._u + INPUT_PERTURBATION * (1.0 + np.abs(self._u)) * real
            )
            follows = not np.array_equal(before, fmu.get_outputs(), equal_nan=True)
            fmu.set_inputs(self._u)
            restore_state(fmu, saved)
        except FmuCallError:  # the FMU forbids it: initialize again
            assert self._begun is not None
            self._set_up(self._begun[0], self._u)
            return False
        return follows

    # -- steps ----------------------------------------------------------------------------------

    def set(self, inputs: Vector) -> None:
        """Set all inputs, and changed parameters."""
        self._begun = None
        self._u[self._inputs] = inputs
        if self._u.size:
            self._fmu.set_inputs(self._u)
        if self._look and (changed := self._retuned()):
            self._fmu.tune(changed)

    def advance(self, now: float, until: float) -> None:
        """Perform one step, in parts if the FMU returns early or discards it."""
        self._begun = None
        fmu, time, longest, halved = self._fmu, now, np.inf, 0
        small = TIME_TOLERANCE * (until - now)
        refused: tuple[float, float] | None = None
        for _ in range(MAX_PARTS):
            if self._ended is not None:
                self._refuse_after_end(until)
            left = until - time
            if abs(left - self._nominal) <= small:
                # bit-equal step sizes, without round-off of the times
                left = self._nominal
            step = min(left, longest)
            try:
                done: Step = fmu.do_step(time, step, rollback=self._saved_once)
            except FmuCallError as error:
                # Some FMUs answer the step after a discarded one with an error.
                if refused is None:
                    raise
                raise self._discarded(
                    *refused, ", and fails in the step after it"
                ) from error
            refused = (time, step) if done.discarded else None
            ended = done.terminate
            if done.event:
                ended = fmu.handle_event() or ended
            # A discarded step may have reached a later time: it goes on from there.
            stuck = done.discarded and done.time - time <= small
            if ended and not stuck:  # a smaller step is tried before the run ends
                self._ended = done.time
            if stuck:
                halved, longest = halved + 1, step / 2
                if not self.varies:
                    raise self._discarded(
                        time, step, ", and does not take smaller ones", ended
                    )
                if halved > MAX_HALVINGS:
                    raise self._discarded(time, step, ", and all parts of it", ended)
            time = max(time, done.time)
            if until - time <= small:
                return
        raise FmuError(
            f"FMU '{self._description.name}' returned early {MAX_PARTS} times in the step from t = {now:g} s"
        )

    def _discarded(
        self, time: float, step: float, more: str, ended: bool = False
    ) -> FmuDiscardError:
        asks = f"asks to end the run at t = {time:g} s: it " if ended else ""
        hint = "" if self._logs_all else "; logging=True may show the reason"
        kind = FmuEndedStepError if ended else FmuDiscardError
        return kind(
            f"FMU '{self._description.name}' {asks}discarded its step of {step:g} s from t = {time:g} s"
            f"{more}{hint}{self._fmu.log_text()}"
        )

    def outputs(self) -> Vector:
        """Return all outputs, in the order of the ports."""
        found: Vector = self._fmu.get_outputs()[self._outputs]
        return found

    # -- saved states -----------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """Return the state of the FMU, as bytes if it can serialize them.

        Raises
        ------
        FmuError
            If the FMU cannot save its state.
        """
        return self._kept(saved_state(self._fmu))

    def mark(self) -> dict[str, Any]:
        """Return the state of the FMU, valid for this run only."""
        return self._kept(HeldState(self._fmu))

    def _kept(self, state: Any) -> dict[str, Any]:
        self._saved_once = True
        return super()._kept(state) | {"u": self._u.copy()}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the result of `save` or `mark`."""
        self._begun, self._saved_once = None, True
        self._u[:] = saved["u"]
        self._went_back(saved)
