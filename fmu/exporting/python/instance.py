"""Instance of a Python FMU: variables by value reference, steps, saved states."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.framework.clock import SNAP
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Vector
from trussflow.fmu.exporting.python.payload import Payload


class RefusedError(Exception):
    """A call by the importer violates the FMI standard or the interface."""


class Instance:
    """A co-simulation instance. Its methods may raise any error, which the slave catches.

    Value references count from 1: time, inputs, parameters, states, derivatives, outputs, modes,
    event indicators.

    Parameters
    ----------
    payload : Payload
        The block and the facts of its interface.
    """

    def __init__(self, payload: Payload) -> None:
        self._payload = payload
        self._session: Session = payload.session()
        plan = self._plan = self._session.prepared.plan
        ends = np.cumsum([1, plan.u.size, plan.p.size, plan.x.size]).tolist()
        self._u, self._p, self._x = (slice(a, b) for a, b in pairwise(ends))
        self._values = payload.values.copy()
        self._touched = np.zeros(len(self._values))  # 1 for each value that was set
        self._start = 0.0
        self._fault = ""
        self._running = self._ended = False
        self._stale = self._parameters_set = True

    @property
    def restores(self) -> bool:
        """Whether the states of all blocks can be saved."""
        return self._session.restores

    # -- variables ----------------------------------------------------------------------------

    def get(self, references: Sequence[int]) -> list[float]:
        """Return values by value reference."""
        indices = self._indices(references)
        self._refresh()
        values: list[float] = self._values[indices].tolist()
        return values

    def set(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set `values` [as declared] by value `references`; they are checked at their first use.

        Raises
        ------
        RefusedError
            If a variable cannot be set now. Then no value is set, and the next step fails.
        """
        indices = self._indices(references)
        early = self._payload.early
        bad = indices[~(self._payload.late if self._running else early)[indices]]
        if bad.size:
            when = "after initialization" if early[bad[0]] else "at any time"
            fault = f"'{self._payload.names[bad[0]]}' cannot be set {when}"
            raise self._refused(fault, "; the next step is refused")
        self._values[indices] = values
        self._touched[indices] = 1.0
        self._stale = True
        # Parameters and states follow the inputs; inputs are passed in each step.
        self._parameters_set |= bool(np.any(indices >= self._u.stop))

    def _indices(self, references: Sequence[int]) -> NDArray[np.int64]:
        indices = np.asarray(references, dtype=np.int64) - 1
        unknown = indices[(indices < 0) | (indices >= len(self._values))]
        if unknown.size:
            fault = f"there is no variable with value reference {unknown[0] + 1}"
            raise self._refused(fault, f"; there are {len(self._values)} scalars")
        return indices

    def _refused(self, fault: str, more: str = "") -> RefusedError:
        """Return an error, and refuse the next step."""
        self._fault = fault
        return RefusedError(fault + more)

    def _refresh(self) -> None:
        """Update all values."""
        if not self._stale or self._ended:
            return
        if not self._running:
            self._begin()
        self._apply()
        session = self._session
        values = self._values
        values[0] = session.time
        values[self._x.start :] = np.concatenate(
            [session.states(), session.rates(), session.row(), session.events()]
        )
        self._stale = False

    def _begin(self) -> None:
        """Start the session from the values set so far."""
        plan = self._plan
        values = self._values
        # States that the importer did not set follow from parameters and inputs.
        touched = plan.x.named(self._touched[self._x])
        states = {
            name: v
            for name, v in plan.x.named(values[self._x]).items()
            if touched[name].any()
        }
        self._session.start(
            parameters=plan.p.named(values[self._p]),
            initial=states,
            inputs=self._inputs(),
            time=self._start,
        )
        self._parameters_set = False

    def _inputs(self) -> dict[str, Vector]:
        plan = self._plan
        first = self._u.start - plan.u_start
        return {
            name: self._values[first + e.start : first + e.stop].reshape(e.shape)
            for name, e in zip(plan.system.external, plan.u, strict=True)
        }

    def _apply(self) -> None:
        """Pass the inputs and changed parameters to the session."""
        self._session.set(self._inputs())
        if self._parameters_set:
            self._session.tune(self._plan.p.named(self._values[self._p]))
        self._parameters_set = False

    # -- running ------------------------------------------------------------------------------

    def set_up(self, start: float) -> None:
        """Set the start time [s]."""
        self._start = float(start)
        self._stale = True

    def initialize(self) -> None:
        """End the initialization."""
        try:
            self._refresh()
        except BaseException as error:
            self._fault = f"the initialization failed: {error}"
            raise
        self._running = True

    def step(self, time: float, length: float) -> bool:
        """Advance by one communication step; return True.

        Parameters
        ----------
        time, length : float
            Current time and size of the step [s].

        Raises
        ------
        RefusedError
            If the instance is not initialized, `time` is not the current time, a value set before
            is invalid, or an earlier step failed.
        TrussflowError
            If the step fails.
        """
        if self._fault:
            raise RefusedError(f"{self._fault}; restore a saved state, or reset")
        try:
            self._advance(time, length)
        except BaseException as error:
            self._fault = f"the step from t = {time:g} s failed before: {error}"
            raise
        return True

    def _advance(self, time: float, length: float) -> None:
        if not self._running or self._ended:
            raise RefusedError(
                "a step is possible only between initialization and termination"
            )
        if not (np.isfinite(time) and np.isfinite(length) and length >= 0):
            raise RefusedError(
                f"a step of {length!r} s from t = {time!r} s is not possible"
            )
        present = self._session.time
        tick = float(self._session.prepared.tick)
        if abs(present - time) > float(SNAP) * tick + 1e-12 * abs(present):
            raise RefusedError(
                f"the step starts at t = {time:g} s, but the current time is {present:g} s"
            )
        self._apply()
        self._stale = True
        self._session.advance(time + length)

    def terminate(self) -> None:
        """Terminate the run; values can still be read."""
        if not self._ended:
            with contextlib.suppress(TrussflowError):
                self._refresh()
            self.close()

    def close(self) -> None:
        """Release all resources, even if the importer has not called `terminate`."""
        self._ended = True
        with contextlib.suppress(TrussflowError):
            self._session.stop()

    # -- states -------------------------------------------------------------------------------

    def save(self) -> dict[str, Any]:
        """Return the current state; the snapshot is None before the end of initialization.

        Raises
        ------
        SimulationError
            If the last step failed, or a block cannot save its state.
        """
        snapshot = None
        if self._running:
            self._apply()
            snapshot = self._session.save()
        return {
            "start": self._start,
            "values": self._values.copy(),
            "touched": self._touched.copy(),
            "fault": self._fault,
            "snapshot": snapshot,
        }

    def restore(self, state: object) -> None:
        """Restore a state of this or another instance of the same FMU.

        Raises
        ------
        RefusedError
            If `state` is not such a state; the next step is refused then.
        """
        if not isinstance(state, dict):
            reason = state if isinstance(state, str) else "it was not saved"
            raise self._refused(f"a state could not be restored: {reason}")
        if len(state["values"]) != len(self._values):
            raise self._refused(
                "a state could not be restored: it belongs to another FMU"
            )
        snapshot = state["snapshot"]
        if snapshot is not None:
            if not self._session.started:
                self._session.start(time=state["start"])
            self._session.restore(snapshot)
        self._start = state["start"]
        self._touched[:] = state["touched"]
        self._fault = state["fault"]
        self._values[:] = state["values"]
        self._running = snapshot is not None
        self._ended = False
        self._stale = True
        self._parameters_set = False
