"""Scene: a diagram as boxes and nets with their layout."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass, field

from trussflow.blocks.drawing.graph import Box, Net, Pin
from trussflow.blocks.drawing.layout import PIN_PITCH, layout
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port

LETTER_WIDTH = 6.7
"""Width of a letter of 11 px in a font of equal widths [px]."""

HEAD_HEIGHT, FOOT_HEIGHT = 40.0, 8.0
"""Height of the name and kind above the ports of a block, and of the margin below them [px]."""

MAX_NAME_LENGTH = 28
"""Largest number of letters of a name; the tooltip has the complete name."""


@dataclass(frozen=True, eq=False, slots=True)
class Row:
    """Row of a block for one wire.

    Attributes
    ----------
    port : Port
        The port.
    key : str
        Source of the wire: a path, ``"outside"`` or an empty text.
    name, note : str
        Text at the port, and at the end of the wire.
    """

    port: Port
    key: str
    name: str
    note: str = ""


@dataclass(eq=False, slots=True)
class Scene:
    """Contents and layout of one diagram.

    Attributes
    ----------
    blocks : list of tuple
        Blocks with their boxes.
    pins : list of tuple
        Rows with their pins.
    wires : list of tuple
        Nets with their sources.
    edges : list of Box
        Boxes of the exposed ports of the diagram.
    width, height : float
        Size of the scene [px].
    """

    blocks: list[tuple[Block, Box]] = field(default_factory=list)
    pins: list[tuple[Row, Pin]] = field(default_factory=list)
    wires: list[tuple[Net, Port]] = field(default_factory=list)
    edges: list[Box] = field(default_factory=list)
    width: float = 0.0
    height: float = 0.0


def brief(name: str) -> str:
    """Return a name, shortened if it is too long."""
    return name if len(name) <= MAX_NAME_LENGTH else f"{name[: MAX_NAME_LENGTH - 1]}…"


def breadth(text: str) -> float:
    """Return the width of a text of 11 px [px]; letters of some scripts have twice the width."""
    return LETTER_WIDTH * sum(
        1 + (unicodedata.east_asian_width(letter) in "WF") for letter in text
    )


def part_of(port: Port) -> str:
    """Return the index of a slice as text; it is empty for the whole `port`."""
    whole = port.index is None or port.elements().size == port.size
    return "" if whole else port.full_path.removeprefix(port.path)


def rows(diagram: Diagram, block: Block) -> tuple[list[Row], list[Row]]:
    """Return the rows of the inputs and outputs of a `block` in a `diagram`, one for each wire."""
    inputs = []
    for port in block.inputs():
        ends: dict[str, list[tuple[str, str]]] = {}
        for wire in diagram.wires:
            if wire.target.block is block and wire.target.name == port.name:
                source = wire.source
                end = "0" if source is None else part_of(source)
                ends.setdefault("" if source is None else source.path, []).append(
                    (part_of(wire.target), end)
                )
        if any(port in inner for inner in diagram.exposed.values()):
            ends["outside"] = [("", "")]
        if not ends:
            ends[""] = [("", "open" if port.declaration.default is None else "")]
        for key, parts in ends.items():
            inner, outer = (
                "".join(dict.fromkeys(texts)) for texts in zip(*parts, strict=True)
            )
            inputs.append(Row(port, key, brief(port.name + inner), brief(outer)))
    return inputs, [Row(port, "", brief(port.name)) for port in block.outputs()]


def scene_of(diagram: Diagram) -> Scene:
    """Return the scene of a `diagram`."""
    scene = Scene()
    pins: dict[tuple[str, str, str], Pin] = {}
    for block in diagram.blocks.values():
        sides = rows(diagram, block)
        # `breadth` is for 11 px; names have 12 px, notes 9 px.
        title = breadth(brief(block.name)) * 12 / 11
        head = max(title, breadth(brief(type(block).__name__))) + 16
        names = sum(
            max((breadth(row.name) for row in side), default=0.0) for side in sides
        )
        ports = max(map(len, sides)) * PIN_PITCH
        box = Box(max(head, names + 24), HEAD_HEIGHT + ports + FOOT_HEIGHT)
        scene.blocks.append((block, box))
        for side, found in enumerate(sides):
            for i, row in enumerate(found):
                note = breadth(row.note) * 9 / 11 + 6 if row.note else 0.0
                pin = box.pin(side, HEAD_HEIGHT + (i + 0.5) * PIN_PITCH, note)
                pins[block.name, row.port.name, row.key] = pin
                scene.pins.append((row, pin))
    # One net per source, so that wires from one output share a stem.
    nets: dict[Pin, tuple[Net, Port]] = {}
    for name, inside in diagram.exposed.items():
        port = diagram.ports[name]
        width = breadth(brief(name)) + 12
        box = Box(width, PIN_PITCH, edge=-1 if port.is_input else 1)
        scene.edges.append(box)
        pin = box.pin(int(port.is_input), box.height / 2)
        scene.pins.append((Row(port, "", brief(name)), pin))
        if port.is_input:
            targets = [pins[end.block.name, end.name, "outside"] for end in inside]
            nets[pin] = Net(pin, targets), port
        else:
            source = pins[inside[0].block.name, inside[0].name, ""]
            nets.setdefault(source, (Net(source, []), inside[0]))[0].targets.append(pin)
    for wire in diagram.wires:
        if wire.source is not None:
            block = wire.source.block
            source = pins[block.name, wire.source.name, ""]
            fresh = Net(source, []), block.ports[wire.source.name]
            net, _ = nets.setdefault(source, fresh)
            target = pins[wire.target.block.name, wire.target.name, wire.source.path]
            # Several slices of one source end at one row.
            net.targets += [target] if target not in net.targets else []
    scene.wires = list(nets.values())
    boxes = [*(box for _, box in scene.blocks), *scene.edges]
    if boxes:
        scene.width, scene.height = layout(boxes, [net for net, _ in scene.wires])
    return scene
