"""What lives for one run of a block. A block itself never changes when it runs.

Most blocks need nothing of this: what they keep is declared as states, which live outside them.
A block that keeps more (a library's solver, an open file, an FMU) returns from `Block.open` an
object that does, one for each run; so one diagram may run many times at once.
"""

from __future__ import annotations

from typing import Any

from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector


class StepDiscardedError(SimulationError):
    """What steps itself refuses a step, usually because it is too long; it must be restored."""


class Running(Equations):
    """A block in one run, with what it keeps there besides its declared states.

    It states the equations in the block's place. What it keeps should change in `update` (of a
    sampled block, called once per instant), `on_step` and `on_event` only. One that can go back to
    an earlier time overrides `save` and `restore`.

    Attributes
    ----------
    stuck : str
        Why it cannot go back, if it cannot.
    """

    stuck = "what its open() returns would have to override save() and restore()"

    @property
    def restores(self) -> bool:
        """Whether `save` and `restore` work; by default, whether they are overridden."""
        own = type(self)
        return own.save is not Running.save and own.restore is not Running.restore

    @property
    def messages(self) -> tuple[str, ...]:
        """What there is to tell of this run, such as what an FMU logged; results keep it."""
        return ()

    def tuned(self) -> None:
        """Take note that parameters were changed: those that `Block.open` was given have followed."""

    def save(self) -> Any:
        """Return a copy of what is kept, for `restore` of this object or one of an equal block.

        Numbers, strings, bytes, NumPy arrays of numbers, and lists, tuples and dicts of such
        can be written to files too.
        """
        raise NotImplementedError

    def restore(self, saved: Any) -> None:
        """Take back what `save` returned; it may be restored again, so it must not change."""
        raise NotImplementedError

    def close(self) -> None:
        """Release everything; called when the run ends, whatever ended it."""


class SelfStepping(Running):
    """A block that steps itself from one communication point to the next.

    It is a member of a co-simulation, and a sampled block in any other run.
    Inputs and outputs are flat vectors: all ports in order of declaration, each row by row.

    Attributes
    ----------
    varies : bool
        Whether steps may be of different lengths.
    ramps : bool
        Whether inputs may change linearly during a step. Known once started.
    refreshes : bool
        Whether outputs that depend on inputs directly follow them before the next step. If not,
        they show what the inputs of the last step made of them. Known once started.
    """

    varies: bool = True
    ramps: bool = False
    refreshes: bool = True

    def start(self, time: float, inputs: Vector) -> None:
        """Begin at a time with these inputs; again, if they turn out to be others.

        Parameters
        ----------
        time : float
            Time at which the run begins [s].
        inputs : Vector
            All inputs; NaN where nothing is known yet [units as declared].
        """
        raise NotImplementedError

    def set(self, inputs: Vector, rates: Vector | None = None) -> None:
        """Set all inputs, from the present time on.

        Parameters
        ----------
        inputs : Vector
            All inputs at the present time [units as declared].
        rates : Vector, optional
            How fast they change from now on [units as declared, per second]; None: held.
        """
        raise NotImplementedError

    def latch(self, inputs: Vector) -> None:
        """Let what is sampled at the present time compute with these inputs.

        Called before `set` where a step gets inputs that are not those of its start. What keeps
        its clocks to itself, as FMUs do, does nothing.

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
            If the step is refused.
        DivergenceError
            If a signal stops being finite.
        """
        raise NotImplementedError

    def mark(self) -> Any:
        """Return what `restore` takes like what `save` returns, for this object alone: quicker."""
        return self.save()

    def outputs(self) -> Vector:
        """Return all outputs at the present time [units as declared]."""
        raise NotImplementedError
