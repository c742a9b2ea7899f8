"""Flattening: conversion of nested diagrams to one list of blocks and drivers."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import DiagramError, NameLookupError, OpenInputError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import Clock
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.port import Port
from trussflow.blocks.support.validation import shown

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Driver:
    """Source of some elements of an input: elements of an output, or zero.

    Attributes
    ----------
    source : Port or None
        The output; None for zero.
    taken, given : array of int
        Elements of the output, and the elements of the input that they drive; without an output both are
        those of the input.
    where : str
        The line of the connection.
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
        The diagram or block that was flattened.
    blocks : dict
        All blocks that are not diagrams, by path.
    diagrams : dict
        All diagrams, by path; the path of the outermost one is empty.
    drivers : dict
        Drivers of each input, by (path of the block, name of the input).
    """

    root: Block
    blocks: dict[str, Block]
    diagrams: dict[str, Diagram] = field(default_factory=dict)
    drivers: dict[tuple[str, str], list[Driver]] = field(default_factory=dict)

    @cached_property
    def clock_of(self) -> dict[str, Clock | None]:
        """Clock of each block by path; None if the block is not sampled."""
        return {
            path: None if block.sample_time is None else Clock.of(block)
            for path, block in self.blocks.items()
        }

    @cached_property
    def clocks(self) -> list[Clock]:
        """Distinct clocks of the sampled blocks."""
        return sorted({clock for clock in self.clock_of.values() if clock})

    def holding(self, active: Collection[Clock]) -> set[str]:
        """Return the paths of the blocks whose outputs are held while the `active` clocks tick."""
        return {
            path
            for path, block in self.blocks.items()
            if not block.traced or self.clock_of[path] not in (None, *active)
        }

    @property
    def external(self) -> dict[str, External]:
        """External inputs by name."""
        return {b.name: b for b in self.blocks.values() if isinstance(b, External)}

    def source(self, name: str) -> External:
        """Return the source block of the external input with that `name`.

        Raises
        ------
        NameLookupError
            If there is none; the message lists the valid names.
        """
        if name not in self.external:
            known = ", ".join(self.external) or "none"
            raise NameLookupError(
                f"no input '{name}'; the external inputs are: {known}"
            )
        return self.external[name]

    def port(self, reference: str | Port) -> Port:
        """Return a leaf block's port from ``"block.port"`` or from a port, exposed or not.

        The reference of a port of the outermost diagram, or of the single block, is ``"port"``. For an
        exposed input that drives several inputs, the first of them is returned.

        Raises
        ------
        NameLookupError
            If there is no such block or port; the message lists the valid names.
        """
        if isinstance(reference, Port):
            leaf = resolved(reference)
            if self.blocks.get(leaf.block.path) is not leaf.block:
                raise NameLookupError(f"port '{reference.path}' is not in this diagram")
            return leaf
        return resolved(self.port_of(str(reference), str(reference)))

    def port_of(self, name: str, reference: str) -> Port:
        """Return the port, exposed or not, with the `name` ``"block.port"``; messages show the `reference`.

        Raises
        ------
        NameLookupError
            If there is no such block or port; the message lists the valid names.
        """
        path, _, own = name.rpartition(".")
        block = (
            self.blocks.get(path)
            or self.diagrams.get(path)
            or (None if path else self.root)
        )
        if block is None:
            blocks = ", ".join(b for b in self.blocks if not b.startswith("("))
            raise NameLookupError(
                f"no block '{path}' for '{reference}'; the blocks are: {blocks}"
            )
        return block.port(own)


def flatten(item: Block, *, external: bool = False) -> System:
    """Return the flat system of a diagram or of a single block.

    Parameters
    ----------
    item : Block
        A diagram, or any other block.
    external : bool
        Whether exposed inputs, or those of a single block, become external inputs.

    Raises
    ------
    DiagramError
        If it is not a diagram and `external` is false, or it has no blocks.
    OpenInputError
        If inputs, or elements of them, have no driver; the message lists all of them.

    Notes
    -----
    Shapes that are still open become scalar.
    """
    if not isinstance(item, Block if external else Diagram):
        raise DiagramError(
            f"cannot simulate {shown(item)}: it is not a Diagram; add blocks to a Diagram first"
        )
    system = System(item, {})
    if isinstance(item, Diagram):
        system.diagrams[""] = item
        # First, as the elements of wires and slices need all shapes.
        for block in item.within():
            _settle_ports(block)
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
            fault = _open(
                port, system.drivers.setdefault((path, port.name), []), system
            )
            # Inputs behind one exposed port give the same text.
            faults += [fault] if fault and fault not in faults else []
    if faults:
        error = OpenInputError(
            "inputs are not connected:\n  "
            + "\n  ".join(faults)
            + "\nconnect each, or set it to zero intentionally with diagram.ground(port)"
        )
        error.diagram = system.diagrams.get("")
        raise error
    return system


def _drive_from_outside(system: System, port: Port) -> None:
    """Add the source of an external input for an input of the outermost block."""
    source = External(port)
    system.blocks[source.path] = source
    # The exposed input has the shape of each of its targets.
    everything = np.arange(port.size)
    for target in targets(port):
        system.drivers.setdefault((target.block.path, target.name), []).append(
            Driver(source.y, everything, everything, "outside")
        )


def _settle_ports(block: Block) -> None:
    for port in block.ports.values():
        if port.inferable_shape.is_open:
            port.inferable_shape.fix((), "a simulation: no connected port had a shape")


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
        # Pairs of elements in row-major order: given[i] of the input reads taken[i].
        taken = given if source is None else source.elements().ravel()
        for target in targets(wire.target):
            system.drivers.setdefault((target.block.path, target.name), []).append(
                Driver(source, taken, given, wire.where)
            )


def resolved(port: Port) -> Port:
    """Return the port of the (first) leaf block behind an exposed port, with the same slice."""
    # All inputs of a group have the same driver, so the first one is enough.
    while isinstance(port.block, Diagram):
        inner = port.block.exposed[port.name][0]
        port = inner if port.index is None else inner[port.index]
    return port


def targets(port: Port) -> list[Port]:
    """Return the inputs of leaf blocks behind an input."""
    if not isinstance(port.block, Diagram):
        return [port]
    return [leaf for inner in port.block.exposed[port.name] for leaf in targets(inner)]


def _open(port: Port, drivers: list[Driver], system: System) -> str:
    """Return the description of the elements of an input without drivers, or an empty text.

    The name is that of the outermost exposed port that can be connected.
    """
    # A default replaces a missing wire, not missing elements.
    if port.declaration.default is not None and not drivers:
        return ""
    driven = np.zeros(port.size, dtype=bool)
    for driver in drivers:
        driven[driver.given] = True
    if driven.all():
        return ""
    leaf = port
    # Outer diagrams come before inner ones; the outermost is left out, as its inputs
    # cannot be connected. Reversed, so that the outermost exposed port is found last.
    inner = [*system.diagrams.values()][1:]
    for diagram in reversed(inner):
        for outer in diagram.inputs():
            port = outer if leaf in targets(outer) else port
    if not driven.any():
        meaning = port.declaration.meaning
        return port.describe() + (meaning and f": {meaning}")
    return f"{port.describe()}: elements {', '.join(map(str, np.flatnonzero(~driven)))}"
