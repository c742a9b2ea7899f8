"""Members: what is coupled, with what drives their inputs and what their outputs need."""

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
class Member:
    """Something that steps itself between communication points.

    Attributes
    ----------
    name : str
        Path of the block or diagram it is, or ``"the rest"``.
    open : callable
        Returns what steps it in one run.
    inlets : tuple of Inlet
        Its inputs, in the order of the vector that what steps it takes.
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
    open: Callable[[], SelfStepping]
    inlets: tuple[Inlet, ...]
    outlets: tuple[Port, ...]
    needs: tuple[frozenset[int], ...]
    held: frozenset[int] = frozenset()
    route: Callable[[int, int], list[str]] = field(default=lambda _i, _o: [])
    parameters: Mapping[str, list[float]] = field(default_factory=dict)
    fingerprint: str = ""
