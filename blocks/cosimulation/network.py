"""Members of a co-simulation, and their network: the vector of all signals, and algebraic loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.layout import Layout, spans
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.run_state import SelfStepping
from trussflow.blocks.framework.system import Driver
from trussflow.blocks.tracing.sorted_order import in_order

Key = tuple[str, str]
Node = tuple[int, int]
"""Index of a member, and of one of its outlets."""


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
    routes : tuple of dict
        For each outlet, the paths from the inlets with direct feedthrough to it, for messages.
    held : frozenset of int
        Outlets of sampled blocks, which change only at their instants.
    parameters : mapping
        Values of the parameters by ``"block.parameter"`` [units as declared].
    fingerprint : str
        Hash, or another identification, of the equations.
    """

    name: str
    open: Callable[[], SelfStepping]
    inlets: tuple[Inlet, ...]
    outlets: tuple[Port, ...]
    routes: tuple[dict[int, list[str]], ...]
    held: frozenset[int] = frozenset()
    parameters: Mapping[str, list[float]] = field(default_factory=dict)
    fingerprint: str = ""


class Network:
    """Members and the layout of their signals.

    Parameters
    ----------
    members : sequence of Member
        The members.

    Attributes
    ----------
    start : Vector
        Initial signals: all outputs, member by member, which are NaN, and the values of inputs without a
        driver [as declared].
    outs : list of slice
        Slice of the outputs of each member in the vector of signals.
    ins : list of slice
        Slice of the inputs of each member in the vector of all inputs.
    gather : array of int
        Indices of all inputs in the vector of signals.
    source : array of int
        Index of the member that drives each input; -1 for none.
    held : array of bool
        Whether a sampled block drives each input.
    loop : str
        Description of the algebraic loop through members; empty if there is none.
    """

    def __init__(self, members: Sequence[Member]) -> None:
        self.members = list(members)
        self._node: dict[Key, Node] = {
            (port.block.path, port.name): (number, outlet)
            for number, member in enumerate(members)
            for outlet, port in enumerate(member.outlets)
        }
        ports = [port for member in members for port in member.outlets]
        self._outputs = Layout(
            (p.block.path, p.name, p.whole_shape or ()) for p in ports
        )
        self.outs = spans(
            sum(port.size for port in member.outlets) for member in members
        )
        inlets = [inlet for member in members for inlet in member.inlets]
        # Behind the outputs: zero, for grounded elements, then the default of each inlet. So
        # one index finds the value of any input element.
        defaults = [inlet.default for inlet in inlets]
        unknown = np.full(self._outputs.size, np.nan)
        self.start = np.concatenate([unknown, [0.0, *defaults]])
        parts = [self._places(inlet, i) for i, inlet in enumerate(inlets)]
        self.gather = np.fromiter(chain.from_iterable(parts), np.int64)
        self.ins = spans(
            sum(inlet.port.size for inlet in member.inlets) for member in members
        )
        # -1 marks values behind the outputs, which no member drives.
        unit_of = np.full(self.start.size, -1)
        held = np.zeros(self.start.size, dtype=bool)
        for number, member in enumerate(members):
            unit_of[self.outs[number]] = number
            for outlet in member.held:
                held[self.places(member.outlets[outlet])] = True
        self.source = unit_of[self.gather]
        self.held = held[self.gather]
        self._inputs = {
            (inlet.port.block.path, inlet.port.name): part
            for inlet, part in zip(inlets, parts, strict=True)
        }
        self._graph = {
            (i, o): self._needed(member, o)
            for i, member in enumerate(members)
            for o in range(len(member.outlets))
        }
        self._order, cycle = in_order(self._graph)
        lines: list[str] = []
        for first, second in pairwise(cycle):
            # Each step of the cycle is explained by the route through
            # the second member.
            inlet = self._graph[second][first]
            lines += self.members[second[0]].routes[second[1]][inlet]
        self.loop = "\n  ".join(lines)

    def _places(self, inlet: Inlet, number: int) -> NDArray[np.int64]:
        """Return the indices of the elements of the input with that `number` in `signals`."""
        zero = self._outputs.size
        # An inlet without drivers reads its default; with some, other
        # elements read zero.
        found = np.full(inlet.port.size, zero if inlet.drivers else zero + 1 + number)
        for driver in inlet.drivers:
            if driver.source is not None:
                output = driver.source.block.path, driver.source.name
                found[driver.given] = self._outputs.entries[output].start + driver.taken
        return found

    def places(self, port: Port) -> NDArray[np.int64]:
        """Return the indices of the elements of a whole port, output or input, in `signals`."""
        key = (port.block.path, port.name)
        if key in self._outputs.entries:
            entry = self._outputs.entries[key]
            return np.arange(entry.start, entry.stop)
        return self._inputs[key]

    def describe(self, place: int) -> str:
        """Return the name of one element of `signals`, for messages."""
        return self._outputs.describe(place)

    # -- order --------------------------------------------------------------------------------

    def _needed(self, member: Member, outlet: int) -> dict[Node, int]:
        """Return the outlets on which an outlet depends directly, each with the inlet of the path."""
        return {
            self._node[driver.source.block.path, driver.source.name]: inlet
            for inlet in member.routes[outlet]
            for driver in member.inlets[inlet].drivers
            if driver.source is not None
        }

    def visits(self, follows: Sequence[bool]) -> list[int]:
        """Return the members to read again, in order, after all members have been read.

        If each of them gets its inputs before it is read, all signals of an instant are consistent.

        Parameters
        ----------
        follows : sequence of bool
            Whether the outputs of each member follow its inputs before the next step; at the start, they
            always do.
        """
        # Outlets without direct feedthrough are right already; members that do not
        # follow their inputs keep the outputs of their last step.
        later = [i for i, o in self._order if self._graph[i, o] and follows[i]]
        # Neighbouring outlets of one member are read in one visit.
        return [member for member, _ in groupby(later)]
