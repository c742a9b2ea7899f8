"""Objects with the internal state of a block in one run. A run never changes the block itself.

Most blocks need no such object: their states are declared, and stored outside the block. A block with
other internal state (the solver of a library, an open file, an FMU) returns a new object from
`Block.open` for each run. So one diagram may have several simultaneous runs.
"""

from __future__ import annotations

from typing import Any

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.support.types import Vector


class StepDiscardedError(SimulationError):
    """A self-stepping block rejects a step, usually because it is too long; it must be restored."""


class Running(Equations):
    """Equations and internal state of a block in one run.

    The object defines the equations instead of the block. Its internal state should change only in
    `update` (of a sampled block, called once per instant), `on_step` and `on_event`. If it can return
    to an earlier time, it overrides `save` and `restore`.

    Attributes
    ----------
    stuck : str
        Reason why the state cannot be saved, for messages.
    """

    stuck = "its open() must return an object that overrides save() and restore()"

    @property
    def restores(self) -> bool:
        """Whether `save` and `restore` work; by default, whether they are overridden."""
        own = type(self)
        return own.save is not Running.save and own.restore is not Running.restore

    @property
    def messages(self) -> tuple[str, ...]:
        """Messages of this run, such as the log of an FMU; results store them."""
        return ()

    def tuned(self) -> None:
        """Handle a change of parameters; the argument of `Block.open` has the new values."""

    def compiled(self) -> list[int] | None:
        """Return a continuous block for steps in C, or None if it needs Python at present.

        The result is the structure ``tf_block`` of ``driver.c`` without the first four words.
        """
        return None

    def resume(self) -> bool:
        """Continue after steps in C, if there were any; return whether the block requests an event."""
        return False

    def save(self) -> Any:
        """Return a copy of the internal state, for `restore` of this object or one of an equal block.

        Numbers, strings, bytes, NumPy arrays of numbers, and lists, tuples and dicts of these can also be
        written to files.
        """
        raise NotImplementedError

    def restore(self, saved: Any) -> None:
        """Restore the state that `save` returned; `saved` must not change, as it may be restored again."""
        raise NotImplementedError

    def close(self) -> None:
        """Release all resources; called when the run ends for any reason."""


class SelfStepping(Running):
    """A block that steps itself from one communication point to the next.

    It is a subsystem in a co-simulation, and a sampled block in any other run.
    Inputs and outputs are flat vectors: all ports in order of declaration, each in row-major order.

    Attributes
    ----------
    varies : bool
        Whether steps may have different lengths.
    refreshes : bool
        Whether outputs with direct feedthrough follow new inputs before the next step. If not, they are
        those of the inputs of the last step. Known after `start`.
    """

    varies: bool = True
    refreshes: bool = True

    def start(self, time: float, inputs: Vector) -> None:
        """Start at a time with these inputs; called again if the initial inputs change.

        Parameters
        ----------
        time : float
            Initial time of the run [s].
        inputs : Vector
            All inputs; NaN if a value is not known yet [units as declared].
        """
        raise NotImplementedError

    def set(self, inputs: Vector) -> None:
        """Set all inputs, from the present time on.

        Parameters
        ----------
        inputs : Vector
            All inputs at the present time [units as declared].
        """
        raise NotImplementedError

    def latch(self, inputs: Vector) -> None:
        """Evaluate sampled blocks at the present time with these inputs.

        The method is called before `set` if the inputs of a step differ from those at its start. An
        object with internal clocks, such as an FMU, does nothing.

        Parameters
        ----------
        inputs : Vector
            All inputs at the present time [units as declared].
        """

    def advance(self, now: float, until: float) -> None:
        """Take one step.

        Parameters
        ----------
        now : float
            The present time [s].
        until : float
            Time to reach [s].

        Raises
        ------
        StepDiscardedError
            If the step is rejected.
        DivergenceError
            If a signal stops being finite.
        """
        raise NotImplementedError

    def mark(self) -> Any:
        """Return a state for `restore` of this object only, which may be faster than `save`."""
        return self.save()

    def outputs(self) -> Vector:
        """Return all outputs at the present time [units as declared]."""
        raise NotImplementedError
