"""Slaves: what steps itself, and is coupled to others at communication points only."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.types import Vector


class StepDiscardedError(SimulationError):
    """A slave refuses a step, usually because it is too long; it must be restored."""


class Slave(Protocol):
    """What the master asks of a unit: a compiled part of a diagram, or an FMU.

    Inputs and outputs are flat vectors: all ports in order of declaration, each row by row.

    Attributes
    ----------
    restores : bool
        Whether `save` and `restore` work.
    varies : bool
        Whether communication steps may be of different lengths.
    ramps : bool
        Whether inputs may change linearly during a step.
    refreshes : bool
        Whether outputs that depend on inputs directly follow them before the next step. If not,
        they show what the inputs of the last step made of them. Known once started.
    """

    restores: bool
    varies: bool
    ramps: bool
    refreshes: bool

    def start(self, inputs: Vector) -> None:
        """Begin at time 0 with these inputs; again, if they turn out to be others.

        Parameters
        ----------
        inputs : Vector
            All inputs [units as declared].
        """
        ...

    def stop(self) -> None:
        """End, whatever happened before; several times if need be."""
        ...

    def set(self, inputs: Vector, rates: Vector | None = None) -> None:
        """Set all inputs, from the present time on.

        Parameters
        ----------
        inputs : Vector
            All inputs at the present time [units as declared].
        rates : Vector, optional
            How fast they change from now on [units as declared, per second]; None: held.
        """
        ...

    def latch(self, inputs: Vector) -> None:
        """Let what is sampled at the present time compute with these inputs.

        Called before `set` where a step gets inputs that are not those of its start. A slave that
        keeps its clocks to itself, as FMUs do, does nothing.

        Parameters
        ----------
        inputs : Vector
            All inputs at the present time [units as declared].
        """
        ...

    def advance(self, now: float, until: float) -> None:
        """Take one communication step.

        Parameters
        ----------
        now : float
            The present time [s].
        until : float
            Time to reach [s].

        Raises
        ------
        StepDiscardedError
            If the slave refuses the step.
        DivergenceError
            If a signal stops being finite.
        """
        ...

    def outputs(self) -> Vector:
        """Return all outputs at the present time [units as declared]."""
        ...

    def save(self) -> Any:
        """Return all that is needed to go on from the present time."""
        ...

    def restore(self, saved: Any) -> None:
        """Go back to where `saved` was taken, to the last bit; possible any number of times."""
        ...


@runtime_checkable
class Cosimulated(Protocol):
    """A block that is always a unit of its own, because it steps itself: an FMU."""

    def cosimulation_slave(self, p: Signals) -> Slave:
        """Return what steps this block; its ports are those of the block.

        Parameters
        ----------
        p : Signals
            Parameters by name [units as declared].
        """
        ...
