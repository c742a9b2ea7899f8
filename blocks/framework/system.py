"""Flattening: a diagram with everything nested in it becomes one list of blocks and drivers."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import Clock
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import DiagramError, NameLookupError, OpenInputError
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.validation import shown

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Driver:
    """What drives some elements of one input: elements of an output, or zero.

    Attributes
    ----------
    source : Port or None
        The output; None: zero.
    taken, given : array of int
        Elements of the output, and those of the input that they drive.
    where : str
        The line that wired it.
    """

    source: Port | None
    taken: Indices
    given: Indices
    where: str


@dataclass(frozen=True, eq=False)
class System:
    """A flat diagram, or a single block.

    Attributes
    ----------
    root : Block
        What was flattened.
    blocks : dict
        Every block that is not a diagram, by path.
    diagrams : dict
        Every diagram, by path; the path of the outermost is empty.
    drivers : dict
        What drives each input, by (path of the block, name of the input).
    """

    root: Block
    blocks: dict[str, Block]
    diagrams: dict[str, Diagram] = field(default_factory=dict)
    drivers: dict[tuple[str, str], list[Driver]] = field(default_factory=dict)

    @cached_property
    def clocks(self) -> list[Clock]:
        """The distinct clocks of the sampled blocks."""
        return sorted({Clock.of(b) for b in self.blocks.values() if b.sample_time is not None})

    def clock(self, block: Block) -> Clock | None:
        """Return the clock of a sampled block."""
        return None if block.sample_time is None else Clock.of(block)

    @property
    def external(self) -> dict[str, External]:
        """What comes from outside, by the name of the input."""
        return {b.name: b for b in self.blocks.values() if isinstance(b, External)}

    def source(self, name: str) -> External:
        """Return what stands for the input from outside of that `name`.

        Raises
        ------
        NameLookupError
            If there is none; the message lists those there are.
        """
        if name not in self.external:
            known = ", ".join(self.external) or "none"
            raise NameLookupError(f"no input '{name}'; the inputs from outside are: {known}")
        return self.external[name]

    def port(self, reference: str | Port) -> Port:
        """Return a leaf block's port from ``"block.port"`` or from a port, exposed or not.

        A port of the outermost diagram, or of the single block, is just ``"port"``. An exposed
        input that stands for several returns the first.

        Raises
        ------
        NameLookupError
            If there is no such block or port; the message lists what there is.
        """
        if isinstance(reference, Port):
            leaf = resolved(reference)
            if self.blocks.get(leaf.block.path) is not leaf.block:
                raise NameLookupError(f"port '{reference.path}' is not in this diagram")
            return leaf
        return resolved(self.port_of(str(reference), str(reference)))

    def port_of(self, name: str, reference: str) -> Port:
        """Return the port, exposed or not, of a `name` ``"block.port"`` in the `reference` of a user.

        Raises
        ------
        NameLookupError
            If there is no such block or port; the message lists what there is.
        """
        path, _, own = name.rpartition(".")
        block = self.blocks.get(path) or self.diagrams.get(path) or (None if path else self.root)
        if block is None:
            blocks = ", ".join(b for b in self.blocks if not b.startswith("("))
            raise NameLookupError(f"no block '{path}' for '{reference}'; the blocks are: {blocks}")
        return block.port(own)


def flatten(item: Block, *, external: bool = False) -> System:
    """Return the flat system of a diagram or of a single block.

    Parameters
    ----------
    item : Block
        A diagram, or any other block.
    external : bool
        Whether exposed inputs, or those of a single block, may come from outside.

    Raises
    ------
    DiagramError
        If it is no diagram, unless inputs may come from outside, or it has no blocks.
    OpenInputError
        If inputs, or elements of them, are driven by nothing. All are listed.

    Notes
    -----
    Shapes that no wire and no block has fixed by now become scalar.
    """
    if not isinstance(item, Block if external else Diagram):
        raise DiagramError(f"cannot simulate {shown(item)}: it is no Diagram; add blocks to a Diagram first")
    system = System(item, {})
    if isinstance(item, Diagram):
        system.diagrams[""] = item
        _settle_shapes(item)
        _collect(item, system)
    else:
        _settle_ports(item)
        system.blocks[item.path] = item
    if not system.blocks:
        raise DiagramError(f"diagram '{item.name}' has no blocks")
    if external:
        for port in item.inputs():
            _drive_from_outside(system, port)
    faults = []
    for path, block in system.blocks.items():
        for port in block.inputs():
            fault = _open(port, system.drivers.setdefault((path, port.name), []), system)
            faults += [fault] if fault and fault not in faults else []
    if faults:
        error = OpenInputError(
            "inputs are driven by nothing:\n  "
            + "\n  ".join(faults)
            + "\nwire each, or leave it at zero on purpose with diagram.ground(port)"
        )
        error.diagram = system.diagrams.get("")
        raise error
    return system


def _drive_from_outside(system: System, port: Port) -> None:
    """Let an input of the outermost block come from outside."""
    source = External(port)
    system.blocks[source.path] = source
    everything = np.arange(port.size)
    for target in targets(port):
        system.drivers.setdefault((target.block.path, target.name), []).append(
            Driver(source.y, everything, everything, "outside")
        )


def _settle_shapes(diagram: Diagram) -> None:
    """Make scalar what is still to be inferred: nothing says that it is anything else."""
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            _settle_shapes(block)
        _settle_ports(block)


def _settle_ports(block: Block) -> None:
    for port in block.ports.values():
        if port.inferable_shape.is_open:
            port.inferable_shape.fix((), "a simulation: nothing wired to it had a shape")


def _collect(diagram: Diagram, system: System) -> None:
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            system.diagrams[block.path] = block
            _collect(block, system)
        else:
            system.blocks[block.path] = block
    for wire in diagram.wires:
        source = None if wire.source is None else resolved(wire.source)
        given = wire.target.elements().ravel()
        taken = np.zeros(0, dtype=np.int64) if source is None else source.elements().ravel()
        for target in targets(wire.target):
            system.drivers.setdefault((target.block.path, target.name), []).append(
                Driver(source, taken, given, wire.where)
            )


def resolved(port: Port) -> Port:
    """Follow a port inwards to the (first) block that has it, keeping the slice."""
    while isinstance(port.block, Diagram):
        inner = port.block.exposed[port.name][0]
        port = inner if port.index is None else inner[port.index]
    return port


def targets(port: Port) -> list[Port]:
    """Follow an input inwards to the blocks that read it."""
    if not isinstance(port.block, Diagram):
        return [port]
    return [leaf for inner in port.block.exposed[port.name] for leaf in targets(inner)]


def _open(port: Port, drivers: list[Driver], system: System) -> str:
    """Say which elements of an input are driven by nothing, by the name under which it is to be wired."""
    if port.declaration.default is not None and not drivers:
        return ""
    driven = np.zeros(port.size, dtype=bool)
    for driver in drivers:
        driven[driver.given] = True
    if driven.all():
        return ""
    inner = (port.block.path, port.name)
    for diagram in [*system.diagrams.values()][:0:-1]:  # from inside out; nothing wires the outermost one
        names = ((p, t.block.path, t.name) for p in diagram.inputs() for t in targets(p))
        port = next((p for p, *leaf in names if (*leaf,) == inner), port)
    if not driven.any():
        meaning = port.declaration.meaning
        return port.describe() + (meaning and f": {meaning}")
    return f"{port.describe()}: elements {', '.join(map(str, np.flatnonzero(~driven)))}"
