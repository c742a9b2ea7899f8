"""Scene: a diagram as boxes and nets with their layout."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import replace
from typing import NamedTuple

from trussflow.blocks.drawing.graph import (
    JUNCTION_LEAD,
    JUNCTION_PITCH,
    JUNCTION_SIZE,
    Box,
    Net,
    Pin,
)
from trussflow.blocks.drawing.layout import PIN_PITCH, layout
from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.arithmetic import Operation, Sum
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.symbol import Symbol, brief
from trussflow.blocks.support.validation import shown

LETTER_WIDTH = 6.7
"""Width of a letter of 11 px in a font of equal widths [px]."""

NAME_HEIGHT, CAPTION_HEIGHT = 17.0, 12.0
"""Heights of the name and of a caption [px]."""

LINE_HEIGHT, BAR_HEIGHT = 14.0, 4.0
"""Heights of a line and of the bar of a fraction in a symbol [px]."""

CURVE_SIZE = 36.0, 24.0
"""Width and height of the curve of a symbol [px]."""

SYMBOL_MARGIN = 5.0
"""Margin around a symbol [px]."""

MAX_INNER_WIDTH = 110.0
"""Largest width of a text next to names of ports [px]; a wider one is below the block."""

RAISED = re.compile(r"\^\((.*?)\)")
"""Pattern of superscripts."""


class Row(NamedTuple):
    """Row of a block for one wire.

    Attributes
    ----------
    port : Port
        The port.
    key : object
        Key of the wire of an input in a diagram, otherwise the path of the port.
    name, note : str
        Text at the port, and at the end of the wire.
    """

    port: Port
    key: object
    name: str
    note: str = ""


class Figure(NamedTuple):
    """Block of a scene.

    Attributes
    ----------
    block : Block
        The block.
    symbol : Symbol
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
    symbol: Symbol
    box: Box
    outline: tuple[float, float, float, float]
    middle: float
    name: str
    captions: list[str]


class Scene(NamedTuple):
    """Contents and layout of one diagram.

    Attributes
    ----------
    figures : list of Figure
        The blocks.
    pins : dict of Pin to Row
        The rows by their pins.
    wires : list of tuple
        Nets with their sources.
    edges : list of Box
        Boxes of the exposed ports of the diagram.
    width, height : float
        Size of the scene [px].
    """

    figures: list[Figure]
    pins: dict[Pin, Row]
    wires: list[tuple[Net, Port]]
    edges: list[Box]
    width: float
    height: float


def breadth(text: str) -> float:
    """Return the width of a text of 11 px [px]; letters of some scripts have twice the width."""
    return LETTER_WIDTH * sum(
        1 + (unicodedata.east_asian_width(letter) in "WF")
        for letter in RAISED.sub(r"\1", text)
    )


def height_of(lines: list[str]) -> float:
    """Return the height of the `lines` of a symbol [px]."""
    return sum(BAR_HEIGHT if line == "-" else LINE_HEIGHT for line in lines)


def part_of(port: Port) -> str:
    """Return the index of a slice as text; it is empty for the whole `port`."""
    whole = port.index is None or port.elements().size == port.size
    return "" if whole else port.full_path.removeprefix(port.path)


def rows(
    diagram: Diagram, block: Block, symbol: Symbol, used: set[str]
) -> list[list[Row]]:
    """Return the rows of the inputs and outputs of a block, one for each wire.

    Text, curve or signs replace the name of a single input or output. Unused ports are not drawn.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    block : Block
        A block in it.
    symbol : Symbol
        Its symbol.
    used : set of str
        Paths of the connected ports.
    """
    inputs = []
    for port in block.inputs():
        wires = [wire for wire in diagram.wires if wire.target.path == port.path]
        for wire in wires:
            note = "0" if wire.source is None else brief(part_of(wire.source))
            name = brief(port.name + part_of(wire.target))
            inputs.append(Row(port, id(wire), name, note))
        is_open = port.declaration.default is None and port.path not in used
        if is_open or (port.path in used and not wires):
            inputs.append(Row(port, port.path, brief(port.name), "open" * is_open))
    outputs = [Row(p, p.path, brief(p.name)) for p in block.outputs() if p.path in used]
    if not (symbol.text or symbol.curve or symbol.pins):
        return [inputs, outputs]
    signs = dict(zip(block.inputs(), symbol.pins, strict=False))
    # Equations contain the names of ports; a formula does not.
    sides = (
        (block.inputs(), block.outputs()) if "=" in symbol.text else (inputs, outputs)
    )
    named = [len(side) > 1 and symbol.outline == "box" for side in sides]
    return [
        [row._replace(name=signs.get(row.port, row.name * is_named)) for row in side]
        for side, is_named in zip((inputs, outputs), named, strict=True)
    ]


def figure_of(block: Block, symbol: Symbol, sides: list[list[Row]]) -> Figure:
    """Return the figure of a `block` with this `symbol` and these rows on both `sides`, without pins."""
    wide = max(map(breadth, symbol.text.split("\n"))) > MAX_INNER_WIDTH
    if min(map(len, sides)) > 1 or (wide and max(map(len, sides)) > 1):
        # Between the names of ports, the text would make the block too wide.
        caption = f"{symbol.text}\n{symbol.caption}"
        symbol = replace(symbol, text="", caption=caption)
    captions = symbol.caption.split("\n")
    captions = [*filter(None, [*captions, str(block._described().facts["sampled"])])]
    # Port arithmetic makes names such as multiply_1.
    own = block.function.__name__ if isinstance(block, Operation) else "sum"
    made = isinstance(block, Sum | Operation) and re.fullmatch(
        rf"{own}_\d+", block.name
    )
    name = "" if made else brief(block.name)
    # `breadth` is for 11 px; names have 12 px, captions 9 px.
    below = max(breadth(name) * 12, *(breadth(line) * 9 for line in [*captions, ""]))
    below /= 11
    count = max(map(len, sides))
    if symbol.outline == "circle":
        tall = max(JUNCTION_SIZE, JUNCTION_PITCH * count)
        box = Box(JUNCTION_SIZE + below, tall + 2 * JUNCTION_LEAD, junction=True)
        outline = (0.0, JUNCTION_LEAD, JUNCTION_SIZE, tall)
        return Figure(block, symbol, box, outline, JUNCTION_SIZE / 2, name, captions)
    lines = symbol.text.split("\n")
    inner = max(20.0 * bool(symbol.text), *map(breadth, lines)) + 2 * SYMBOL_MARGIN
    tall = height_of(lines)
    if symbol.curve:
        inner, tall = CURVE_SIZE[0] + 2 * SYMBOL_MARGIN, CURVE_SIZE[1]
    left, right = (
        max((breadth(row.name) + 8 for row in side if row.name), default=0.0)
        for side in sides
    )
    width, middle = left + inner + right, left + inner / 2
    tall = max(tall + 2 * SYMBOL_MARGIN, PIN_PITCH * count + 4)
    if symbol.outline == "triangle":
        # The text is in the wide half.
        width, tall, middle = 1.4 * inner, tall + 10, inner / 2
    low = NAME_HEIGHT * bool(name) + CAPTION_HEIGHT * len(captions)
    box = Box(max(width, below), tall + low)
    x = (box.width - width) / 2
    return Figure(block, symbol, box, (x, 0.0, width, tall), x + middle, name, captions)


def scene_of(diagram: Diagram) -> Scene:
    """Return the scene of a `diagram`."""
    pins: dict[object, Pin] = {}
    figures, texts, edges = list[Figure](), dict[Pin, Row](), list[Box]()
    ends = [wire.ends for wire in diagram.wires]
    used = {port.path for inner in (*ends, *diagram.exposed.values()) for port in inner}
    for block in diagram.blocks.values():
        if not isinstance(block._symbol, Symbol):
            raise DiagramError(
                f"cannot draw block '{block.path}': _symbol of {type(block).__name__} must be a Symbol, "
                f"not {shown(block._symbol)}; write _symbol = Symbol(...)"
            )
        symbol = block._symbol.of(block)
        sides = rows(diagram, block, symbol, used)
        figure = figure_of(block, symbol, sides)
        figures.append(figure)
        x, y, width, height = figure.outline
        for side, found in enumerate(sides):
            dy = y + (height - len(found) * PIN_PITCH) / 2
            inset = figure.box.width - x - width if side else x
            for i, row in enumerate(found):
                note = breadth(row.note) * 9 / 11 + 6 if row.note else 0.0
                pin = figure.box.pin(side, dy + (i + 0.5) * PIN_PITCH, note, inset)
                pin.negative = row.name == "−"
                pins[row.key] = pin
                texts[pin] = row
    # One net per source, so that wires from one output share a stem.
    nets: dict[str, tuple[Net, Port]] = {}

    def link(source: Port, key: object) -> None:
        net, _ = nets.setdefault(source.path, (Net(pins[source.path], []), source))
        net.targets.append(pins[key])

    for name, inside in diagram.exposed.items():
        port = diagram.ports[name]
        width = breadth(brief(name)) + 12
        box = Box(width, PIN_PITCH, edge=-1 if port.is_input else 1)
        edges.append(box)
        pins[port.path] = box.pin(int(port.is_input), box.height / 2)
        texts[pins[port.path]] = Row(port, port.path, brief(name))
        for end in inside:
            link(*((port, end.path) if port.is_input else (end, port.path)))
    for wire in diagram.wires:
        if wire.source is not None:
            link(wire.source.block.ports[wire.source.name], id(wire))
    boxes = [*(figure.box for figure in figures), *edges]
    size = layout(boxes, [net for net, _ in nets.values()])
    return Scene(figures, texts, [*nets.values()], edges, *size)
