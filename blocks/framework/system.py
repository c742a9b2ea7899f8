"""Flattening: a diagram with everything nested in it becomes one list of blocks and drivers."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import Clock
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import (
    DiagramError,
    NameLookupError,
    OpenInputError,
)
from trussflow.blocks.framework.port import Input, Port

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Driver:
    """What drives some elements of one input: elements of an output, or zero."""

    source: Port | None
    taken: Indices
    given: Indices
    where: str


@dataclass(frozen=True, eq=False)
class System:
    """A flat diagram.

    Attributes
    ----------
    blocks : dict
        Every block that is not a diagram, by path.
    diagrams : dict
        Every diagram, by path; the path of the outermost is empty.
    drivers : dict
        What drives each input, by (path of the block, name of the input).
    """

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

    def port(self, reference: str | Port) -> Port:
        """Return a leaf block's port from ``"block.port"`` or from a port, exposed or not.

        An exposed input that stands for several returns the first.

        Raises
        ------
        NameLookupError
            If there is no such block or port; the message lists what there is.
        """
        if isinstance(reference, Port):
            leaf = _source(reference)
            if self.blocks.get(leaf.block.path) is not leaf.block:
                raise NameLookupError(f"port '{reference.path}' is not in this diagram")
            return leaf
        path, _, name = str(reference).rpartition(".")
        block = self.blocks.get(path) or self.diagrams.get(path)
        if block is None:
            raise NameLookupError(
                f"no block '{path}' for '{reference}'; the blocks are: {', '.join(self.blocks)}"
            )
        return _source(block.port(name))


def flatten(diagram: Diagram) -> System:
    """Return the flat system of a diagram.

    Raises
    ------
    DiagramError
        If it is no diagram, or has no blocks.
    OpenInputError
        If inputs, or elements of them, are driven by nothing. All are listed.

    Notes
    -----
    Shapes that no wire and no block has fixed by now become scalar.
    """
    if not isinstance(diagram, Diagram):
        raise DiagramError(
            f"cannot simulate {diagram!r}: it is no Diagram; add blocks to a Diagram first"
        )
    system = System({})
    system.diagrams[""] = diagram
    _settle_shapes(diagram)
    _collect(diagram, system)
    if not system.blocks:
        raise DiagramError(f"diagram '{diagram.name}' has no blocks")
    faults = []
    for path, block in system.blocks.items():
        for port in block.inputs():
            fault = _open(port, system.drivers.setdefault((path, port.name), []))
            faults += [fault] if fault else []
    if faults:
        raise OpenInputError(
            "inputs are driven by nothing:\n  "
            + "\n  ".join(faults)
            + "\nwire each, or leave it at zero on purpose with diagram.ground(port)"
        )
    return system


def _settle_shapes(diagram: Diagram) -> None:
    """Make scalar what is still to be inferred: nothing says that it is anything else."""
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            _settle_shapes(block)
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
        source = None if wire.source is None else _source(wire.source)
        given = wire.target.elements().ravel()
        taken = np.zeros(0, dtype=np.int64) if source is None else source.elements().ravel()
        for target in _targets(wire.target):
            system.drivers.setdefault((target.block.path, target.name), []).append(
                Driver(source, taken, given, wire.where)
            )


def _source(port: Port) -> Port:
    """Follow a port inwards to the (first) block that has it, keeping the slice."""
    while isinstance(port.block, Diagram):
        inner = port.block.exposed[port.name][0]
        port = inner if port.index is None else inner[port.index]
    return port


def _targets(port: Port) -> list[Port]:
    """Follow an input inwards to the blocks that read it."""
    if not isinstance(port.block, Diagram):
        return [port]
    return [leaf for inner in port.block.exposed[port.name] for leaf in _targets(inner)]


def _open(port: Port, drivers: list[Driver]) -> str:
    """Say which elements of an input are driven by nothing."""
    declaration: Any = port.declaration
    if isinstance(declaration, Input) and declaration.default is not None and not drivers:
        return ""
    driven = np.zeros(port.size, dtype=bool)
    for driver in drivers:
        driven[driver.given] = True
    if driven.all():
        return ""
    if not driven.any():
        return port.describe()
    return f"{port.describe()}: elements {', '.join(map(str, np.flatnonzero(~driven)))}"
