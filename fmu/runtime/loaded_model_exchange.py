"""Loaded FMU for model exchange, which an external solver integrates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import chain
from typing import Any, ClassVar

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.fmu.errors import FmuEndedError
from trussflow.fmu.runtime.description import Kind
from trussflow.fmu.runtime.library import Call, call_words
from trussflow.fmu.runtime.loaded import LoadedFmu
from trussflow.fmu.runtime.variable_buffers import continuous_elements


class LoadedModelExchange(LoadedFmu):
    """An FMU for model exchange, loaded.

    Call `setup` first. At each evaluation call `place`, then any of `derivatives`, `indicators`
    and `get_outputs`. Call `completed_step` after each accepted step, `handle_event` at each
    event, and `close` at the end, or use a ``with`` statement.

    The parameters are those of `LoadedFmu`.

    Attributes
    ----------
    next_time : float
        Time of the next time event [s]; infinite if there is none.
    initial_states : Vector
        The continuous states after initialization [units as the FMU states].
    """

    kind: ClassVar[Kind] = "me"

    next_time: float = math.inf

    @property
    def size(self) -> int:
        """Number of continuous states."""
        return sum(v.size for v in self.description.states)

    def _started(self, time: float) -> None:
        library = self._library
        self._states = np.zeros(self.size)
        self._rates = np.zeros(self.size)
        self._signs = np.zeros(self.description.event_indicators)
        self._set_states = library.vector_call("SetContinuousStates", self._states)
        self._get_states = library.vector_call("GetContinuousStates", self._states)
        self._get_rates = library.vector_call(library.derivatives_name, self._rates)
        self._get_signs = library.vector_call("GetEventIndicators", self._signs)
        self._flags = np.zeros(4, dtype=np.int32)
        flags = self._flags.ctypes.data
        self._completed: Any = (
            Call(library, "CompletedIntegratorStep", 1, flags, flags + 4)
            if self.capabilities.needsCompletedIntegratorStep
            else None
        )
        self.next_time = math.inf
        # After initialization the FMU is in event mode.
        if self._resume()[1]:
            raise FmuEndedError(
                f"FMU '{self.description.name}' asks to end the run at its start, t = {time:g} s"
                f"{self.log_text()}"
            )
        if self.size:
            self._get_states()
        # The buffer changes with each evaluation.
        self.initial_states = self._states.copy()

    def place(self, t: float, x: Vector, u: Vector) -> None:
        """Set the time, the continuous states and the continuous inputs.

        Parameters
        ----------
        t : float
            Time [s].
        x : Vector
            Continuous states [units as the FMU states].
        u : Vector
            All inputs [units as the FMU states].

        Raises
        ------
        FmuCallError
            If the FMU rejects a value.
        """
        self._library.call("SetTime", t)
        if x.size:
            self._states[:] = x
            self._set_states()
        # FMI allows changes of discrete inputs in event mode only.
        np.copyto(self._input.values, u, where=self._input.continuous)
        self._input.write(only_continuous=True)

    def set_restored(self, next_time: float, inputs: Vector) -> None:
        """Set the values that belong to a restored state but are stored outside the FMU.

        Parameters
        ----------
        next_time : float
            Time of the next time event [s].
        inputs : Vector
            Value of `input_values` when the state was saved [units as the FMU states].
        """
        self.next_time = next_time
        self._input.values[:] = inputs

    def event_inputs_changed(self, u: Vector) -> bool:
        """Return whether any input that may change at events only has changed.

        Parameters
        ----------
        u : Vector
            All inputs [units as the FMU states].
        """
        changed = self._input.values != u
        return bool(np.any(changed & ~self._input.continuous))

    def derivatives(self) -> Vector:
        """Return the derivatives of the continuous states; the next call overwrites them."""
        if self._rates.size:
            self._get_rates()
        return self._rates

    def along(self, what: str, dx: Vector, du: Vector) -> Vector:
        """Return directional derivatives; those of discrete variables are zero.

        Parameters
        ----------
        what : str
            ``"output"`` or ``"derivative"``.
        dx, du : Vector
            Direction in the states and in all inputs [units as the FMU states].

        Raises
        ------
        FmuCallError
            If the FMU cannot compute them.
        """
        unknowns = self.outputs if what == "output" else self.description.derivatives
        knowns = (*self.description.states, *self.inputs)
        rows = continuous_elements(unknowns)
        columns = continuous_elements(knowns)
        seed = np.concatenate([dx, du])[columns]
        result = np.zeros(np.count_nonzero(rows))
        arguments: list[Any] = []
        for side in (unknowns, knowns):
            # An array has one reference, but as many values as elements.
            references = [v.reference for v in side if v.is_continuous]
            arguments += self._library.listed(references)
        for vector in (seed, result):
            sizes = [vector.size] if self._library.version == 3 else []
            arguments += [vector.ctypes.data, *sizes]
        if seed.size and result.size:
            self._library.call("GetDirectionalDerivative", *arguments)
        found = np.zeros(rows.size)
        found[rows] = result
        return found

    def indicators(self) -> Vector:
        """Return the event indicators; the next call overwrites them."""
        if self._signs.size:
            self._get_signs()
        return self._signs

    def compiled(self, time: float, inputs: Vector) -> list[int] | None:
        """Return words of ``tf_block`` in ``driver.c``; None if the FMU has single-precision variables.

        Parameters
        ----------
        time : float
            Time of the last accepted point [s].
        inputs : Vector
            Inputs there [units as the FMU states].
        """
        u = self._input
        if "Float32" in {v.type for v in (*self.inputs, *self.outputs)}:
            return None
        (write, written), (read, got) = u.compiled(), self._output.compiled()
        self._times = np.array([math.nan, time, self.next_time, *inputs])
        self._flags[:] = 0
        self._calls = (
            *(Call(self._library, "SetTime"), self._set_states, write, read),
            *(self._get_rates, self._get_signs, self._completed),
        )
        self._arrays = (
            *(written, got, u.continuous, np.empty_like(inputs)),
            *(self._times, self._flags),
        )
        return [
            self._library.component,
            *chain.from_iterable(map(call_words, self._calls)),
            *(array.ctypes.data for array in self._arrays),
            *(inputs.size, written.size, got.size),
        ]

    def resume(self) -> tuple[float, Vector, int, int]:
        """Return time and inputs of the last accepted point, and whether the FMU requests an event, and the end.

        Raises
        ------
        FmuCallError
            If a call failed.
        """
        event, end, status, number = self._flags.tolist()
        if status:
            self._calls[number].check(status)
        return float(self._times[1]), self._times[3:], event, end

    def completed_step(self) -> tuple[bool, bool]:
        """Report to the FMU that the solver accepted the step.

        Returns
        -------
        tuple of bool
            Whether the FMU requests an event now, and whether it requests the end of the run.
        """
        if not self._completed:
            return False, False
        self._completed()
        return bool(self._flags[0]), bool(self._flags[1])

    def handle_event(
        self, u: Vector, values: Mapping[str, Any] | None = None
    ) -> tuple[Vector | None, bool]:
        """Handle an event at the current time.

        Parameters
        ----------
        u : Vector
            All inputs [units as the FMU states].
        values : mapping of str to object, optional
            Changed parameters by the FMU's names [units as the FMU states].

        Returns
        -------
        tuple
            The continuous states if they changed, else None; and whether the FMU requests the end
            of the run.

        Raises
        ------
        FmuError
            If the discrete states do not converge, or the FMU fails.
        """
        self._library.call("EnterEventMode")
        if u.size:
            self.set_inputs(u)
        if values:
            self.tune(values)
        jumped, ended = self._resume()
        if jumped and self.size:
            self._get_states()
            return self._states, ended
        return None, ended

    def _resume(self) -> tuple[bool, bool]:
        """Iterate the discrete states, enter continuous-time mode; return (states changed, terminate)."""
        update = self._settle()
        self.next_time = update.next_time
        self._library.call("EnterContinuousTimeMode")
        return update.states_changed, update.terminate
