"""Scene: a diagram as boxes and nets with their layout."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field, replace

from trussflow.blocks.drawing.graph import (
    JUNCTION_LEAD,
    JUNCTION_PITCH,
    JUNCTION_SIZE,
    Box,
    Net,
    Pin,
)
from trussflow.blocks.drawing.layout import PIN_PITCH, layout
from trussflow.blocks.framework.arithmetic import Operation, Sum
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.symbol import Symbol, value_text

LETTER_WIDTH = 6.7
"""Width of a letter of 11 px in a font of equal widths [px]."""

NAME_HEIGHT, CAPTION_HEIGHT, FOOT_HEIGHT = 17.0, 12.0, 8.0
"""Heights of the name and of a caption, and of the margin below the ports of a block [px]."""

LINE_HEIGHT, BAR_HEIGHT = 14.0, 4.0
"""Heights of a line and of the bar of a fraction in a symbol [px]."""

CURVE_SIZE = 36.0, 24.0
"""Width and height of the curve of a symbol [px]."""

SYMBOL_MARGIN = 5.0
"""Margin around a symbol [px]."""

MAX_NAME_LENGTH = 28
"""Largest number of letters of a name; the tooltip has the complete name."""

MAX_PARAMETERS, MAX_FREE_PORTS = 4, 2
"""Largest numbers of parameters and of unused ports that a block without symbol shows."""

RAISED = re.compile(r"\^\((.*?)\)")
"""Pattern of superscripts."""


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
class Figure:
    """Block of a scene.

    Attributes
    ----------
    block : Block
        The block.
    symbol : Symbol or None
        Its symbol.
    box : Box
        Its box.
    outline : tuple of float
        Left upper corner in the box, width and height of the drawn outline [px].
    middle : float
        Distance of the middle of the symbol from the left side of the box [px].
    name : str
        Text of the name; empty if port arithmetic made the block.
    captions : list of str
        Lines below the name.
    """

    block: Block
    symbol: Symbol | None
    box: Box
    outline: tuple[float, float, float, float]
    middle: float
    name: str
    captions: list[str]


@dataclass(eq=False, slots=True)
class Scene:
    """Contents and layout of one diagram.

    Attributes
    ----------
    figures : list of Figure
        The blocks.
    pins : list of tuple
        Rows with their pins.
    wires : list of tuple
        Nets with their sources.
    edges : list of Box
        Boxes of the exposed ports of the diagram.
    width, height : float
        Size of the scene [px].
    """

    figures: list[Figure] = field(default_factory=list)
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
        1 + (unicodedata.east_asian_width(letter) in "WF")
        for letter in RAISED.sub(r"\1", text)
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


def shown_rows(
    diagram: Diagram, block: Block, symbol: Symbol | None, used: set[str]
) -> list[list[Row]]:
    """Return the rows that are drawn.

    A `symbol` replaces names of ports. Without symbol, many unused ports are not drawn.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    block : Block
        A block in it.
    symbol : Symbol or None
        Its symbol.
    used : set of str
        Paths of the connected outputs.
    """
    sides = rows(diagram, block)
    if symbol is None:
        free = [
            row
            for row in (*sides[0], *sides[1])
            if not (row.key or row.note or row.port.path in used)
        ]
        hidden = free if len(free) > MAX_FREE_PORTS else []
        return [[row for row in side if row not in hidden] for side in sides]
    signs = dict(zip(block.inputs(), symbol.pins, strict=False))
    return [
        [
            replace(
                row,
                name=signs.get(
                    row.port,
                    row.name if len(side) > 1 and symbol.outline != "circle" else "",
                ),
            )
            for row in side
        ]
        for side in sides
    ]


def labels(block: Block, symbol: Symbol | None, hidden: int) -> tuple[str, list[str]]:
    """Return name and captions of a `block` with this `symbol`; a number of its ports is `hidden` [-]."""
    if symbol is None:
        kind = type(block).__name__
        if isinstance(block, Diagram):
            kind = f"{len(block.blocks)} blocks"
        captions = [brief(kind)]
        scalars = {n: v for n, v in block.parameters.items() if not v.ndim}
        if len(scalars) <= MAX_PARAMETERS:
            captions += [brief(f"{n} = {value_text(v)}") for n, v in scalars.items()]
        return brief(block.name), captions + [f"{hidden} more ports"] * bool(hidden)
    # Port arithmetic makes names such as multiply_1.
    own = block.function.__name__ if isinstance(block, Operation) else "sum"
    made = isinstance(block, Sum | Operation) and re.fullmatch(
        rf"{own}_\d+", block.name
    )
    return "" if made else brief(block.name), list(filter(None, [symbol.caption]))


def size_of(symbol: Symbol, sides: list[list[Row]]) -> tuple[float, float, float]:
    """Return width and height of the outline of a `symbol`, and the middle of its content [px].

    Its inputs and outputs have the rows `sides`.
    """
    lines = symbol.text.split("\n")
    width = max(20.0, *map(breadth, lines)) + 2 * SYMBOL_MARGIN
    height = sum(BAR_HEIGHT if line == "-" else LINE_HEIGHT for line in lines)
    if symbol.curve:
        width, height = CURVE_SIZE[0] + 2 * SYMBOL_MARGIN, CURVE_SIZE[1]
    if symbol.outline == "triangle":
        # The text is in the wide half.
        return 1.4 * width, height + 20, 0.5 * width
    left, right = (
        max((breadth(row.name) + 8 for row in side if row.name), default=0.0)
        for side in sides
    )
    rise = max(height + 2 * SYMBOL_MARGIN, PIN_PITCH * max(map(len, sides)) + 4)
    return left + width + right, rise, left + width / 2


def figure_of(block: Block, symbol: Symbol | None, sides: list[list[Row]]) -> Figure:
    """Return the figure of a `block` with this `symbol` and these rows on both `sides`, without pins."""
    hidden = len(block.ports) - len({row.port.name for side in sides for row in side})
    name, captions = labels(block, symbol, hidden)
    # `breadth` is for 11 px; names have 12 px, captions 9 px.
    head = (
        max(breadth(name) * 12, *(breadth(line) * 9 for line in [*captions, ""])) / 11
    )
    low = NAME_HEIGHT * bool(name) + CAPTION_HEIGHT * len(captions)
    count = max(map(len, sides))
    if symbol is None:
        names = sum(max((breadth(r.name) for r in side), default=0.0) for side in sides)
        box = Box(
            max(head + 16, names + 24), low + 10 + count * PIN_PITCH + FOOT_HEIGHT
        )
        outline, middle = (0.0, 0.0, box.width, box.height), 0.0
    elif symbol.outline == "circle":
        tall = max(JUNCTION_SIZE, JUNCTION_PITCH * count)
        box = Box(JUNCTION_SIZE + head, tall + 2 * JUNCTION_LEAD, junction=True)
        outline = (0.0, JUNCTION_LEAD, JUNCTION_SIZE, tall)
        middle = JUNCTION_SIZE / 2
    else:
        width, tall, middle = size_of(symbol, sides)
        box = Box(max(width, head), tall + low)
        x = (box.width - width) / 2
        outline, middle = (x, 0.0, width, tall), x + middle
    return Figure(block, symbol, box, outline, middle, name, captions)


def scene_of(diagram: Diagram) -> Scene:
    """Return the scene of a `diagram`."""
    scene = Scene()
    pins: dict[tuple[str, str, str], Pin] = {}
    ends = [wire.source for wire in diagram.wires if wire.source is not None]
    used = {port.path for inner in (ends, *diagram.exposed.values()) for port in inner}
    for block in diagram.blocks.values():
        symbol = block.symbol and block.symbol.of(block)
        sides = shown_rows(diagram, block, symbol, used)
        figure = figure_of(block, symbol, sides)
        scene.figures.append(figure)
        x, y, width, height = figure.outline
        for side, found in enumerate(sides):
            # Rows of a symbol are around its middle, others at the bottom.
            dy = y + (height - len(found) * PIN_PITCH) / 2
            if symbol is None:
                dy = height - FOOT_HEIGHT - max(map(len, sides)) * PIN_PITCH
            inset = figure.box.width - x - width if side else x
            for i, row in enumerate(found):
                note = breadth(row.note) * 9 / 11 + 6 if row.note else 0.0
                pin = figure.box.pin(side, dy + (i + 0.5) * PIN_PITCH, note, inset)
                pin.negative = row.name == "−"
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
    boxes = [*(figure.box for figure in scene.figures), *scene.edges]
    if boxes:
        scene.width, scene.height = layout(boxes, [net for net, _ in scene.wires])
    return scene
