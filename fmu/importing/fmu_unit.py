"""An FMU for co-simulation as a unit of the master."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.cosimulation.slave import StepDiscardedError
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector
from trussflow.fmu.errors import FmuCallError
from trussflow.fmu.importing.import_interface import ImportInterface, Side
from trussflow.fmu.runtime.child_process import open_instance
from trussflow.fmu.runtime.description import REAL
from trussflow.fmu.runtime.file import FmuFile
from trussflow.fmu.runtime.loaded_co_simulation import LoadedCoSimulation
from trussflow.fmu.runtime.saved_states import HeldState

PARTS = 1000
"""Early returns in one communication step after which an FMU is given up."""

NUDGE = 1e-3
"""How much inputs are moved to see whether outputs follow, relative and absolute
[-, unit of the input]."""


class FmuUnit:
    """An FMU for co-simulation, stepped by the master; see `LoadedCoSimulation` of ``trussflow.blocks``.

    Whether outputs follow their inputs between two steps, FMI leaves to the FMU. So it is tried
    out, on a saved state: an FMU that cannot be restored is taken not to follow.

    Parameters
    ----------
    file : FmuFile
        The FMU.
    interface : Interface
        What the ports of its block are in the FMU.
    options : mapping
        Arguments of `open_instance`.
    starts : mapping
        Values to set before initialization, by the FMU's names.
    tolerance : float or None
        Relative tolerance of the FMU's own solver [-].
    follows : bool
        Whether any output depends on an input within an instant.
    delayed : bool
        Whether outputs shall not depend on inputs of the same instant, whatever the FMU says.
    """

    def __init__(
        self,
        file: FmuFile,
        interface: ImportInterface,
        options: dict[str, Any],
        starts: dict[str, Any],
        tolerance: float | None,
        follows: bool,
        delayed: bool,
    ) -> None:
        self._file, self._options, self._starts = file, options, starts
        self._fixed, self._tolerance = interface.fixed_starts(), tolerance
        self._inputs, self._outputs = _places(interface.inputs), _places(interface.outputs)
        self._u = np.zeros(interface.inputs.size)
        self._real = np.array(
            [v.type in REAL for v in interface.inputs.order for _ in range(v.size)], dtype=bool
        )
        self._follows, self._delayed = follows, delayed
        description = interface.description
        self.name, self.token = description.name, description.token
        self.restores = description.kinds["cs"].saves_state
        self.varies = description.kinds["cs"].variable_step
        self.refreshes = False
        self.ramps = False
        self._fmu: Any = None
        self._begun: Vector | None = None

    def start(self, inputs: Vector) -> None:
        """Load the FMU if it is not, and initialize it with these inputs."""
        self._u[self._inputs] = inputs
        if self._begun is not None and (
            self._delayed or np.array_equal(self._begun, self._u)
        ):  # the master asks again until all signals at the start fit each other
            return
        if self._fmu is None:
            self._fmu = open_instance(
                LoadedCoSimulation, self._file, start=self._fixed, name=self.name, **self._options
            )
        self._set_up()
        self.ramps = self._fmu.can_interpolate
        self.refreshes = self.restores and self._follows and self._tried()
        self._begun = self._u.copy()

    def _set_up(self) -> None:
        self._fmu.setup(
            0.0, tolerance=self._tolerance, inputs=self._u if self._u.size else None, start=self._starts
        )

    def _tried(self) -> bool:
        """Move the inputs, and see whether the outputs follow."""
        fmu = self._fmu
        saved, before = HeldState(fmu), fmu.get_outputs().copy()
        moved = np.where(self._real, self._u * (1.0 + NUDGE) + NUDGE, self._u)
        try:
            fmu.set_inputs(moved)
            follows = not np.array_equal(before, fmu.get_outputs(), equal_nan=True)
            fmu.set_inputs(self._u)
            fmu.restore_state(saved.handle)
        except FmuCallError:  # it does not allow that: begin again
            self._set_up()
            return False
        return follows

    def stop(self) -> None:
        """Free and unload the FMU."""
        fmu, self._fmu, self._begun = self._fmu, None, None
        if fmu is not None:
            fmu.close()

    def set(self, inputs: Vector, rates: Vector | None = None) -> None:
        """Set all inputs, and how fast they change."""
        self._begun = None
        self._u[self._inputs] = inputs
        if self._u.size:
            self._fmu.set_inputs(self._u)
        if self.ramps and self._u.size:
            slopes = np.zeros_like(self._u)
            if rates is not None:
                slopes[self._inputs] = rates
            self._fmu.set_input_derivatives(slopes)

    def latch(self, inputs: Vector) -> None:
        """Nothing: an FMU keeps its clocks to itself."""

    def advance(self, now: float, until: float) -> None:
        """Take one communication step, in parts where the FMU returns early."""
        self._begun = None
        fmu, time = self._fmu, now
        for _ in range(PARTS):
            done = fmu.do_step(time, until - time, rollback=self.restores)
            if done.discarded:
                raise StepDiscardedError(
                    f"FMU '{self.name}' discarded the step from t = {now:g} s to {until:g} s; it "
                    f"reached {done.time:g} s{fmu.log_text()}"
                )
            ended = done.terminate
            if done.event:
                ended = fmu.handle_event() or ended
            if ended:
                raise SimulationError(
                    f"FMU '{self.name}' asks to end the run at t = {done.time:g} s{fmu.log_text()}"
                )
            if not done.early or until - done.time <= 1e-9 * (until - now):
                return
            time = done.time
        raise SimulationError(
            f"FMU '{self.name}' returned early {PARTS} times in the step from t = {now:g} s"
        )

    def outputs(self) -> Vector:
        """Return all outputs, in the order of the ports."""
        found: Vector = self._fmu.get_outputs()[self._outputs]
        return found

    def save(self) -> HeldState:
        """Let the FMU save its state."""
        return HeldState(self._fmu)

    def restore(self, saved: HeldState) -> None:
        """Give the FMU a state back."""
        self._begun = None
        self._fmu.restore_state(saved.handle)


def _places(side: Side) -> NDArray[np.int64]:
    """Return where each element of the ports, one after the other, is in the FMU's vector."""
    numbered = side.split(np.arange(float(side.size)))
    parts = [values.ravel() for values in numbered.values()]
    return np.concatenate([np.zeros(0), *parts]).astype(np.int64)


def fmu_unit(block: Any, p: Signals) -> FmuUnit:
    """Return the unit of a block made by `Fmu`.

    Parameters
    ----------
    block : CoSimulationFmu
        The block.
    p : Signals
        Parameters by name [units as the FMU states].
    """
    own = block.__dict__
    interface: ImportInterface = own["_interface"]
    return FmuUnit(
        own["_file"],
        interface,
        own["_options"],
        interface.changed(p),
        own["_tolerance"],
        follows=any(block.feedthrough().values()),
        delayed=own["_delayed"],
    )
