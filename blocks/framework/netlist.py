"""Wires of a diagram: connection, disconnection, and transfer when a block is replaced."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np

from trussflow.blocks.errors import (
    BlockError,
    DiagramError,
    NameLookupError,
    TrussflowError,
    WiringError,
    pictured,
)
from trussflow.blocks.framework.arithmetic import Operation, Sum, operation
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.connection_check import fit, overlap, same, unite
from trussflow.blocks.framework.port import Port, is_port, port_text
from trussflow.blocks.support.call_site import call_site, warn
from trussflow.blocks.support.validation import shown

MAX_LEVELS = 400
"""Largest number of diagrams around a nested diagram [-]; paths of blocks are recursive."""


@dataclass(frozen=True, slots=True, eq=False)
class Wire:
    """Connection of `source` to `target`, made at `where`; a grounded input has no source."""

    source: Port | None
    target: Port
    where: str

    @property
    def ends(self) -> tuple[Port, ...]:
        """Ports of the wire."""
        return (self.target,) if self.source is None else (self.source, self.target)


class Netlist(Block):
    """Base of diagrams: their blocks, and the wires between them.

    Attributes
    ----------
    blocks : dict of str to Block
        The blocks by name.
    wires : list of Wire
        The wires, in the order in which they were made.
    exposed : dict of str to tuple of Port
        Inner ports, by the name of the exposed port.
    """

    blocks: dict[str, Block]
    wires: list[Wire]
    exposed: dict[str, tuple[Port, ...]]

    @pictured
    def connect(self, source: Port, target: Port, *, where: str | None = None) -> None:
        """Connect an output to an input, as ``source >> target`` does; a repeated call has no effect.

        Parameters
        ----------
        source, target : Port
            Ports of blocks in this diagram, whole or sliced.
        where : str, optional
            ``file:line`` of the connection for messages; by default that of the caller.

        Raises
        ------
        WiringError
            If the ports do not fit, are not in this diagram, or the input already has a driver.
        """
        where = where or call_site()
        for port in (source, target):
            if not is_port(port):
                raise WiringError(
                    f"cannot wire {shown(port)}: it is not a port   [{where}]\n  "
                    "connect a constant by the block Constant(value)"
                )
            if port.block.parent is not self:
                home = (
                    "no diagram"
                    if port.block.parent is None
                    else f"'{port.block.parent.name}'"
                )
                raise WiringError(
                    f"cannot wire '{port.path}' in diagram '{self.name}': its block is in {home}   "
                    f"[{where}]\n  add the block here, or expose the port of the inner diagram"
                )
        self._add_wire(self._present(source), self._present(target), where)

    def _add_wire(self, source: Port | None, target: Port, where: str) -> None:
        """Check and add a wire, unless there is an equal one; `source` is None for a grounded input."""
        # So that a notebook cell may be run again.
        if any(same(w.source, source) and same(w.target, target) for w in self.wires):
            return
        if target.is_input:
            self._check_free(target, where)
        if source is not None:
            outputs = (p for b in self.blocks.values() for p in b.outputs())
            # All outputs here, so that the message can propose one that fits.
            fit(source, target, where, outputs)
        self.wires.append(Wire(source, target, where))

    def ground(self, *ports: Port) -> None:
        """Leave inputs unconnected intentionally: they read zero.

        Parameters
        ----------
        *ports : Port
            Inputs, whole or sliced.
        """
        where = call_site()
        for port in ports:
            if not self._owns(port) or not port.is_input:
                raise WiringError(
                    f"cannot ground {port_text(port)}: it is not an input of a block in diagram '{self.name}'   "
                    f"[{where}]"
                )
            self._add_wire(None, port, where)

    def _check_free(self, target: Port, where: str) -> None:
        """Check that no element gets a second driver."""
        if (
            target.index is not None
            and np.unique(target.elements()).size < target.elements().size
        ):
            raise WiringError(
                f"cannot drive input {target.describe()}: the index selects an element twice   [{where}]"
            )
        for other in self.wires:
            # Slices of one input may have different drivers, if they share no element.
            if overlap(other.target, target):
                by = "ground" if other.source is None else f"'{other.source.path}'"
                raise WiringError(
                    f"cannot drive input {target.describe()} twice   [{where}]\n  "
                    f"it is already driven by {by}   [{other.where}]"
                )
        for name, inner in self.exposed.items():
            if any(overlap(port, target) for port in inner):
                raise WiringError(
                    f"cannot drive input {target.describe()}: it is exposed as '{name}' and driven "
                    f"from outside   [{where}]"
                )

    def disconnect(self, *ports: Port) -> None:
        """Remove all wires of ports; a port without wires is allowed.

        Parameters
        ----------
        *ports : Port
            Inputs and outputs of blocks in this diagram, whole or sliced.

        Raises
        ------
        WiringError
            If it is not a port of a block in this diagram.
        """
        for port in ports:
            if not self._owns(port):
                raise WiringError(
                    f"cannot disconnect {port_text(port)}: it is no port of a block in diagram '{self.name}'   "
                    f"[{call_site()}]"
                )
        self.wires[:] = [
            wire
            for wire in self.wires
            if not any(overlap(end, port) for end in wire.ends for port in ports)
        ]
        self._infer_anew()

    def remove(self, *items: str | Block) -> None:
        """Remove blocks with their wires and exposed ports, or remove exposed ports.

        Parameters
        ----------
        *items : str or Block
            Blocks of this diagram, or names of blocks or exposed ports.

        Raises
        ------
        NameLookupError
            If there is no such block or exposed port.
        """
        for item in items:
            name = (
                item.name if isinstance(item, Block) and item.parent is self else item
            )
            there = [*self.blocks, *self.exposed]
            if name not in there:
                named = ", ".join(there) or "nothing"
                raise NameLookupError(
                    f"cannot remove {shown(item)} from '{self.name}': there is {named}"
                )
            if name in self.exposed:
                del self.exposed[name], self.ports[name]
            else:
                self.blocks.pop(name).__dict__["parent"] = None
        self._infer_anew()

    def _put(self, name: str, block: Block) -> None:
        """Store a `block` under a `name`; it gets the wires of a block that had this name before."""
        before = self.blocks.get(name)
        self.blocks[name] = block
        # Blocks are frozen: only __dict__ accepts a new name and diagram.
        block.__dict__.update(name=name, parent=self)
        if before is not None:
            before.__dict__["parent"] = None
            self._infer_anew()

    def _present(self, port: Port, block: str = "") -> Port:
        """Return the port of the same name and slice of `block`, by default of the block with its block's name.

        Raises
        ------
        LookupError, NameLookupError
            If the block, or its port, is no longer there.
        """
        now = self.blocks[block or port.block.name].port(port.name)
        return now if port.index is None else now[port.index]

    def _infer_anew(self) -> None:
        """Infer shapes, units, frames and labels from the present wires; remove wires that no longer fit."""
        # Everywhere, as inferred properties pass through the ports of nested diagrams.
        root = self._surroundings()[-1]
        blocks = [root, *root.within()]
        for block in blocks:
            for port in block.ports.values():
                for name in ("shape", "unit", "frame", "labels"):
                    getattr(port, f"inferable_{name}").forget()
        # Inner diagrams first: wires outside need the new exposed ports.
        for diagram in reversed(blocks):
            if isinstance(diagram, Netlist):
                for fault in diagram._fit_anew():
                    warn(
                        f"a wire no longer fits its ports, and is removed: {fault}",
                        RuntimeWarning,
                    )

    def _surroundings(self) -> list[Netlist]:
        """Return this diagram and the diagrams that contain it."""
        found = [self]
        while found[-1].parent is not None:
            found.append(found[-1].parent)
        return found

    def _owns(self, port: object) -> bool:
        """Return whether an argument from the user is a port of a block in this diagram."""
        return isinstance(port, Port) and port.block.parent is self

    def within(self, level: int = 0) -> Iterator[Block]:
        """Yield all blocks in this diagram and in nested ones, each diagram before its blocks.

        Raises
        ------
        DiagramError
            If this diagram is inside too many others; the outermost one has `level` 0 [-].
        """
        if level > MAX_LEVELS:
            raise DiagramError(
                f"diagram '{self.name}' is inside {level} other diagrams; at most {MAX_LEVELS} are supported: "
                "add its blocks to an outer diagram"
            )
        for block in self.blocks.values():
            yield block
            if isinstance(block, Netlist):
                yield from block.within(level + 1)

    def _fit_anew(self) -> list[str]:
        """Remove exposed ports and wires without their blocks, and check the others again.

        Returns the faults of the wires that no longer fit.
        """
        for name, inner in [*self.exposed.items()]:
            there = []
            for port in inner:
                with suppress(LookupError, NameLookupError):
                    there.append(self._present(port))
            # All inner ports are gone, so the exposed port goes too.
            if not there:
                del self.exposed[name], self.ports[name]
                continue
            self.exposed[name] = first, *others = tuple(there)
            self.ports[name] = replace(first, block=self, name=name)
            for port in others:
                unite(first, port, "exposed")
        fitted: dict[Wire, Wire] = {}
        before = -1
        while before < len(fitted):  # a slice may need a shape of a later wire
            before = len(fitted)
            # Only the faults of the last pass count.
            faults = []
            for wire in self.wires:
                if wire not in fitted:
                    try:
                        fitted[wire] = self._fit(wire)
                    # The block or port was removed: the wire is dropped
                    # without a warning.
                    except (LookupError, NameLookupError):
                        continue
                    except TrussflowError as error:
                        faults.append(str(error))
        self.wires[:] = [fitted[wire] for wire in self.wires if wire in fitted]
        return faults

    def _fit(self, wire: Wire) -> Wire:
        """Return the wire between the present ports of its blocks, which must fit."""
        source = None
        target = self._present(wire.target)
        if wire.source is not None:
            source = self._present(wire.source)
            fit(source, target, wire.where)
        return replace(wire, source=source, target=target)

    def add_operation(
        self, function: np.ufunc, operands: Sequence[Any], *, where: str
    ) -> Port:
        """Add the block of a function, and return its output; port arithmetic calls this method.

        An existing block for the same function and operands is reused.

        Parameters
        ----------
        function : numpy.ufunc
            Function to compute.
        operands : sequence of Port, Block or array_like
            Outputs of blocks in this diagram, blocks with one output, and numbers [any].
        where : str
            ``file:line`` of the operation for messages.

        Raises
        ------
        WiringError
            If the operands do not fit.
        """
        given = [
            each.only_output() if isinstance(each, Block) else each for each in operands
        ]
        try:
            block = operation(function, given)
        except BlockError as error:
            raise WiringError(
                f"cannot compute with {' and '.join(map(shown, given))}: {error}   [{where}]"
            ) from error
        # Numbers among the operands are parameters of the block, not wires.
        ports = {f"u{i}": each for i, each in enumerate(given, 1) if is_port(each)}
        for other in self.blocks.values():
            # The expression may be evaluated again, as in a notebook:
            # equal blocks are reused.
            if isinstance(other, Sum | Operation) and other.computes == block.computes:
                ends = {
                    w.target.name: w.source
                    for w in self.wires
                    if w.target.block is other
                }
                if ends.keys() == ports.keys() and all(
                    same(ends[name], port) for name, port in ports.items()
                ):
                    return other.port("y")
        self.add_wired(
            "sum" if isinstance(block, Sum) else function.__name__,
            block,
            ports,
            where=where,
        )
        return block.port("y")

    def add_wired(
        self, stem: str, block: Block, ports: Mapping[str, Port], *, where: str
    ) -> None:
        """Add a block under the first free name, and connect its inputs.

        Parameters
        ----------
        stem : str
            Beginning of the name; a number follows.
        block : Block
            The block.
        ports : mapping of str to Port
            Drivers of its inputs, by name.
        where : str
            ``file:line`` of the operation for messages.

        Raises
        ------
        WiringError
            If a port does not fit; the block is then not added.
        """
        name = next(
            name
            for i in count(1)
            if (name := f"{stem}_{i}") not in {**self.blocks, **self.ports}
        )
        self._put(name, block)
        try:
            for end, port in ports.items():
                self.connect(port, block.port(end), where=where)
        except WiringError:
            # a partly connected block would be reused by the next attempt
            self.remove(block)
            raise
