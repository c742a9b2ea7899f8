"""Members of a co-simulation, with the drivers of their inputs and the feedthrough to their outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.running import SelfStepping
from trussflow.blocks.framework.system import Driver


@dataclass(frozen=True, slots=True, eq=False)
class Inlet:
    """One input of a member.

    Attributes
    ----------
    port : Port
        The (first) port of the input.
    drivers : tuple of Driver
        Drivers of its elements; elements without a driver read `default`.
    default : float
        Value of elements without a driver [as declared].
    """

    port: Port
    drivers: tuple[Driver, ...]
    default: float = 0.0

    @property
    def size(self) -> int:
        """Number of elements."""
        return self.port.size


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """Subsystem that steps itself between communication points.

    Attributes
    ----------
    name : str
        Path of the block or diagram, or ``"the rest"``.
    open : callable
        Returns the object that steps the member in one run.
    inlets : tuple of Inlet
        Inputs, in the order of the input vector.
    outlets : tuple of Port
        Outputs, in the order of the output vector; whole ports of leaf blocks.
    needs : tuple of frozenset of int
        Inlets with direct feedthrough to each outlet.
    held : frozenset of int
        Outlets of sampled blocks, which change only at their instants.
    route : callable
        Returns the path from an inlet to an outlet, for messages.
    parameters : mapping
        Values of the parameters by ``"block.parameter"`` [units as declared].
    fingerprint : str
        Hash, or another identification, of the equations.
    """

    name: str
    open: Callable[[], SelfStepping]
    inlets: tuple[Inlet, ...]
    outlets: tuple[Port, ...]
    needs: tuple[frozenset[int], ...]
    held: frozenset[int] = frozenset()
    route: Callable[[int, int], list[str]] = field(default=lambda _i, _o: [])
    parameters: Mapping[str, list[float]] = field(default_factory=dict)
    fingerprint: str = ""
