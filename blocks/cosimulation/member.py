"""Units: what the master couples, with what drives their inputs and what their outputs need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from trussflow.blocks.cosimulation.slave import Slave
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.system import Driver


@dataclass(frozen=True, slots=True, eq=False)
class Inlet:
    """One input of a unit.

    Attributes
    ----------
    port : Port
        The (first) port that reads it; it has the size.
    drivers : tuple of Driver
        What drives its elements; those without a driver read `default`.
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
class Unit:
    """Something that steps itself between communication points.

    Attributes
    ----------
    name : str
        Path of the block or diagram it is, or ``"the rest"``.
    slave : Slave
        What steps it.
    inlets : tuple of Inlet
        Its inputs, in the order of the slave's vector.
    outlets : tuple of Port
        Its outputs, likewise; ports of leaf blocks, whole.
    needs : tuple of frozenset of int
        For each outlet, the inlets on which it depends within the same instant.
    held : frozenset of int
        Outlets that only change at instants of their own: sampled blocks.
    route : callable
        Returns the hops from an inlet to an outlet, for messages.
    parameters : mapping
        Values of its parameters by ``"block.parameter"`` [units as declared].
    fingerprint : str
        A hash, or another mark, of what it computes.
    """

    name: str
    slave: Slave
    inlets: tuple[Inlet, ...]
    outlets: tuple[Port, ...]
    needs: tuple[frozenset[int], ...]
    held: frozenset[int] = frozenset()
    route: Callable[[int, int], list[str]] = field(default=lambda _i, _o: [])
    parameters: Mapping[str, list[float]] = field(default_factory=dict)
    fingerprint: str = ""
