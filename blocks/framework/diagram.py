"""The diagram: blocks and the wires between them. A diagram is itself a block."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.call_site import call_site
from trussflow.blocks.framework.described import Description
from trussflow.blocks.framework.errors import BlockError, DiagramError, NameLookupError, WiringError
from trussflow.blocks.framework.files import replaced
from trussflow.blocks.framework.port import Port, is_port
from trussflow.blocks.framework.sum import Sum
from trussflow.blocks.framework.validation import as_path, is_whole, shown
from trussflow.blocks.framework.wiring import fit, unite

DEEPEST = 100
"""How deep diagrams can be nested; Python itself ends recursion soon after."""


@dataclass(frozen=True, slots=True, eq=False)
class Wire:
    """One connection, made at `where`, of `source` to `target`; a grounded input has no source."""

    source: Port | None
    target: Port
    where: str


class Picture(str):
    """The text of an SVG picture."""

    __slots__ = ()

    def _repr_svg_(self) -> str:
        return self


class Diagram(Block):
    """Blocks wired together.

    Parameters
    ----------
    name : str
        Name for messages and results.

    Examples
    --------
    >>> from trussflow.blocks import Constant, Diagram, Integrator, simulate
    >>> diagram = Diagram("ramp")
    >>> one, integral = diagram.add(one=Constant(1.0), integral=Integrator())
    >>> _ = one.y >> integral.u
    >>> float(simulate(diagram, 2.0, step=0.1)["integral.y"][-1].round(9))
    2.0
    """

    def __init__(self, name: str = "diagram") -> None:
        self.blocks: dict[str, Block] = {}
        self.wires: list[Wire] = []
        self.exposed: dict[str, tuple[Port, ...]] = {}
        super().__init__()
        self.named(name)

    def __getattr__(self, name: str) -> Any:
        blocks = self.__dict__.get("blocks", {})
        if name in blocks or name.startswith("_") or "ports" not in self.__dict__:
            return blocks[name] if name in blocks else super().__getattr__(name)
        return self.port(name)

    def port(self, name: str) -> Port:
        """Return the port of that name.

        Raises
        ------
        NameLookupError
            If there is none; the message lists ports and blocks.
        """
        try:
            return super().port(name)
        except NameLookupError as error:
            blocks = ", ".join(self.blocks) or "none"
            raise NameLookupError(f"{error}; blocks: {blocks}") from None

    def add(self, *unnamed: object, **blocks: Block) -> Any:
        """Add blocks under the names of the keywords.

        Parameters
        ----------
        *unnamed : object
            Refused: each block needs a name.
        **blocks : Block
            Name and block.

        Returns
        -------
        Block or tuple of Block
            What was given, in the same order, for unpacking.

        Raises
        ------
        DiagramError
            If a name is taken, a block is already in a diagram, or it is no block.
        """
        if unnamed:
            what = type(unnamed[0]).__name__
            raise DiagramError(
                f"cannot add a {what} to diagram '{self.name}' without a name: "
                f"say diagram.add(name={what}(...))"
            )
        for name, block in blocks.items():
            self._check_name(name)
            given: object = block
            fault = ""
            if not isinstance(given, Block):
                fault = f"{shown(given)} is not a block"
            elif block.parent is not None:
                fault = (
                    f"this {type(block).__name__} is already in diagram '{block.parent.name}' as "
                    f"'{block.name}'; build a second one (to copy a block copies its diagram too)"
                )
            elif block in self._surroundings():
                fault = "a diagram cannot contain itself"
            elif isinstance(block, Diagram) and len(self._surroundings()) + block.levels > DEEPEST:
                fault = f"diagrams can be nested {DEEPEST} deep"
            if fault:
                raise DiagramError(f"cannot add '{name}' to diagram '{self.name}': {fault}")
            self.blocks[name] = block
            block.__dict__.update(name=name, parent=self)
        added = tuple(blocks.values())
        return added[0] if len(added) == 1 else added

    def _check_name(self, name: str) -> None:
        """Refuse a name that is taken, or that could not be used as an attribute."""
        if name in self.blocks or name in self.ports:
            fault = "it has one already"
        elif name in self.__dict__ or hasattr(type(self), name):
            fault = "every diagram has an attribute of that name"
        elif not name.isidentifier():
            fault = "names consist of letters, digits and underscores"
        else:
            return
        raise DiagramError(f"diagram '{self.name}' cannot have a '{name}': {fault}; choose another name")

    @property
    def levels(self) -> int:
        """How many diagrams lie within each other here, this one included."""
        inner = (block.levels for block in self.blocks.values() if isinstance(block, Diagram))
        return 1 + max(inner, default=0)

    def _surroundings(self) -> list[Diagram]:
        """Return this diagram and those around it."""
        return [self] if self.parent is None else [self, *self.parent._surroundings()]

    def connect(self, source: Port, target: Port, *, where: str | None = None) -> None:
        """Wire an output to an input; ``source >> target`` does the same.

        Parameters
        ----------
        source, target : Port
            Ports of blocks in this diagram, whole or sliced.
        where : str, optional
            ``file:line`` to blame in messages; found by itself.

        Raises
        ------
        WiringError
            If the ports do not fit, are not in this diagram, or the input is driven already.
        """
        where = where or call_site()
        for port in (source, target):
            if not is_port(port):
                raise WiringError(
                    f"cannot wire {shown(port)}: it is not a port   [{where}]\n  "
                    "wire a constant with the block Constant(value)"
                )
            if port.block.parent is not self:
                home = "no diagram" if port.block.parent is None else f"'{port.block.parent.name}'"
                raise WiringError(
                    f"cannot wire '{port.path}' in diagram '{self.name}': its block is in {home}   "
                    f"[{where}]\n  add the block here, or expose the port of the inner diagram"
                )
        if target.is_input:
            self._check_free(target, where)
        outputs = (p for b in self.blocks.values() for p in b.outputs())
        fit(source, target, where, outputs)
        self.wires.append(Wire(source, target, where))

    def ground(self, *ports: Port) -> None:
        """Leave inputs open on purpose: they read zero.

        Parameters
        ----------
        *ports : Port
            Inputs, whole or sliced.
        """
        where = call_site()
        for port in ports:
            if not is_port(port) or not port.is_input or port.block.parent is not self:
                what = port.describe() if is_port(port) else shown(port)
                raise WiringError(
                    f"cannot ground {what}: it is no input of a block in diagram '{self.name}'   [{where}]"
                )
            self._check_free(port, where)
            self.wires.append(Wire(None, port, where))

    def _check_free(self, target: Port, where: str) -> None:
        """Refuse to drive an element twice."""
        if target.index is not None and np.unique(target.elements()).size < target.elements().size:
            raise WiringError(
                f"cannot drive input {target.describe()}: the index names an element twice   [{where}]"
            )
        for other in self.wires:
            if other.target.block is not target.block or other.target.name != target.name:
                continue
            whole = other.target.index is None or target.index is None
            if whole or np.intersect1d(other.target.elements(), target.elements()).size:
                by = "ground" if other.source is None else f"'{other.source.path}'"
                raise WiringError(
                    f"cannot drive input {target.describe()} twice   [{where}]\n  "
                    f"it is already driven by {by}   [{other.where}]"
                )
        for name, inner in self.exposed.items():
            if any(p.block is target.block and p.name == target.name for p in inner):
                raise WiringError(
                    f"cannot drive input {target.describe()}: it is exposed as '{name}' and driven "
                    f"from outside   [{where}]"
                )

    def expose(self, **ports: Port | tuple[Port, ...]) -> None:
        """Give this diagram ports of its own that stand for ports of blocks inside.

        Parameters
        ----------
        **ports : Port or tuple of Port
            Name outside, and the port inside; an input may stand for several inputs.

        Raises
        ------
        DiagramError
            If a name is taken or a port is not of a block in this diagram.
        """
        where = call_site()
        for name, given in ports.items():
            inner = given if isinstance(given, tuple) else (given,)
            self._check_name(name)
            for port in inner:
                if fault := self._exposure_fault(port, inner):
                    what = port.describe() if is_port(port) else shown(port)
                    raise DiagramError(f"cannot expose {what} as '{name}': {fault}   [{where}]")
            if not inner:
                raise DiagramError(f"cannot expose nothing as '{name}'   [{where}]")
            first = inner[0]
            for port in inner[1:]:
                unite(first, port, where)
            self.exposed[name] = inner
            self.ports[name] = replace(first, block=self, name=name)

    def _exposure_fault(self, port: Port, group: tuple[Port, ...]) -> str:
        """Say why a port cannot be exposed together with the others of its group."""
        if not is_port(port) or port.block.parent is not self or port.index is not None:
            return f"give whole ports of blocks in diagram '{self.name}'"
        if len(group) > 1 and not port.is_input:
            return "only inputs can be grouped"
        if group.count(port) > 1:
            return "it is named twice"
        if not port.is_input:
            return ""
        for wire in self.wires:
            if wire.target.block is port.block and wire.target.name == port.name:
                return f"it is driven inside   [{wire.where}]"
        for name, inner in self.exposed.items():
            if port in inner:
                return f"it is exposed as '{name}' already"
        return ""

    def add_sum(self, ports: tuple[Port, ...], signs: str, *, where: str | None = None) -> Port:
        """Add a sum junction of ports and return its output; port arithmetic calls this.

        Parameters
        ----------
        ports : tuple of Port
            Outputs of blocks in this diagram.
        signs : str
            One ``+`` or ``-`` for each.
        where : str, optional
            ``file:line`` to blame in messages.
        """
        number = 1 + sum(name.startswith("sum_") for name in self.blocks)
        junction = self.add(**{f"sum_{number}": Sum(signs)})
        try:
            for i, port in enumerate(ports, 1):
                self.connect(port, junction.port(f"u{i}"), where=where or call_site())
        except WiringError:  # a junction wired by half would be in the way of the next try
            self.wires[:] = [w for w in self.wires if w.target.block is not junction]
            del self.blocks[junction.name]
            raise
        total: Port = junction.y
        return total

    def draw(self, path: str | Path | None = None, *, depth: int = 0) -> Picture:
        """Draw the diagram: signals from left to right, feedback back below or above.

        Sampled blocks are coloured by rate, those of an algebraic loop are red; what is wired, its shape,
        units and rate are shown where the pointer rests.

        Parameters
        ----------
        path : str or pathlib.Path, optional
            File to write, named .svg; an old one is replaced.
        depth : int
            How many levels of the diagrams in it are open [-]; by default each is one block.

        Returns
        -------
        Picture
            The SVG text, which notebooks show as a picture.

        Raises
        ------
        DiagramError
            If the file cannot be written, has another ending, or the depth makes no sense.

        Examples
        --------
        >>> from trussflow.blocks import Constant, Diagram, Integrator
        >>> ramp = Diagram("ramp")
        >>> one, integral = ramp.add(one=Constant(1.0), integral=Integrator())
        >>> _ = one.y >> integral.u
        >>> ramp.draw()[:4]
        '<svg'
        """
        if not is_whole(depth) or depth < 0:
            raise DiagramError(f"cannot draw '{self.name}' with depth {shown(depth)}: give 0, 1, 2...")
        picture = Picture(type(self)._artist(self, depth))
        if path is not None:
            cannot = f"cannot draw diagram '{self.name}' to"
            if as_path(DiagramError, cannot, path).suffix.lower() != ".svg":
                raise DiagramError(f"{cannot} '{path}': pictures are SVG; name the file .svg")
            try:
                with replaced(path) as partial:
                    partial.write_text(picture, encoding="utf-8")
            except OSError as error:
                raise DiagramError(f"{cannot} '{path}': {error}") from error
        return picture

    _artist: ClassVar[Callable[[Diagram, int], str]]
    """What draws: the room `drawing`, which sees what a diagram does and so stands above this one."""

    def _repr_svg_(self) -> str:
        return self.draw()

    def _repr_html_(self) -> str:
        return self.draw() + self._described().html(unfolded=False)

    def _described(self) -> Description:
        own, blocks = super()._described(), self.__dict__.get("blocks", {}).values()
        return replace(
            own,
            title=f"{own.title}, {len(blocks)} blocks, {len(self.wires)} wires",
            parts=tuple(block._described() for block in blocks),
        )

    def sampled(self, every: float, offset: float = 0.0) -> Block:
        """Refuse: a diagram has no clock of its own.

        Raises
        ------
        BlockError
            Always; the message says what to do.
        """
        raise BlockError(f"cannot sample diagram '{self.path}': sample the blocks in it one by one")
