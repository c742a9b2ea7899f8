"""SVG text of a scene, for light and dark themes, screens and paper."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from html import escape
from itertools import pairwise
from math import dist

from trussflow.blocks.drawing.graph import JUNCTION_SIZE, Box, Net, Pin, Point
from trussflow.blocks.drawing.scene import (
    BAR_HEIGHT,
    CAPTION_HEIGHT,
    CURVE_SIZE,
    LINE_HEIGHT,
    RAISED,
    Figure,
    Row,
    Scene,
    breadth,
    height_of,
    scene_of,
)
from trussflow.blocks.framework.diagram import Diagram, leaves
from trussflow.blocks.framework.port import Port
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.support.texts import package_text

ARROWHEAD = (
    '<marker id="tf-tip" orient="auto" markerUnits="userSpaceOnUse" markerWidth="7" '
    'markerHeight="7" refX="7" refY="3.5"><path class="tip" d="M0 0v7l7 -3.5z"/></marker>'
)
"""Element of the arrowheads of wires."""

PICTURE_MARGIN = 12
"""Margin around the picture [px]."""


def svg_of(diagram: Diagram) -> str:
    """Return the picture of a `diagram`: each nested diagram is one block."""
    scene = scene_of(diagram)
    style = package_text("picture.css", "trussflow.blocks.drawing")
    width, height = scene.width + 2 * PICTURE_MARGIN, scene.height + 2 * PICTURE_MARGIN
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="tf" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}"><title>{escape(diagram.name)}</title><style>{style}</style>{ARROWHEAD}'
        f'<rect class="paper" width="{width:g}" height="{height:g}"/>'
        f'<g transform="translate({PICTURE_MARGIN},{PICTURE_MARGIN})">'
        f"{''.join(view(scene))}</g></svg>\n"
    )


def view(scene: Scene) -> Iterator[str]:
    """Yield the SVG elements of a `scene`."""
    for net, source in scene.wires:
        lines = ["M" + "L".join(f"{x:g} {y:g}" for x, y in p) for p in net.paths]
        # Lines of no length with round ends are dots.
        dots = "".join(f"M{x:g} {y:g}h0" for x, y in forks(net))
        kind = "wire" if source.whole_shape else "wire scalar"
        yield f'<g class="signal" data-path="{escape(source.path)}">{title(source)}'
        yield f'<path class="{kind}" d="{"".join(lines)}"/><path class="dot" d="{dots}"/>'
        # Wide transparent paths with arrowheads: the tooltip appears near a wire.
        yield from (f'<path class="near" d="{line}"/>' for line in lines)
        yield "</g>"
    for figure in scene.figures:
        box, block = figure.box, figure.block
        sampled = any(leaf.sample_time is not None for leaf in leaves(block))
        yield f'<g class="block" data-path="{escape(block.path)}" '
        yield f'transform="translate({box.x:g},{box.y:g})"><title>{escape(block._described().head)}</title>'
        yield from outlined(figure, "box" + " sampled" * sampled)
        yield from inscribed(figure)
        for pin in (*box.sides[0], *box.sides[1]):
            yield from labelled(scene.pins[pin], pin, box)
        yield "</g>"
    for box in scene.edges:
        for pin in (*box.sides[0], *box.sides[1]):
            yield from labelled(scene.pins[pin], pin)


def labelled(row: Row, pin: Pin, box: Box | None = None) -> Iterator[str]:
    """Yield the texts of a `row` at its `pin`, relative to a `box` [px]."""
    x, y = (pin.x - box.x, pin.dy) if box else (pin.x, pin.y)
    note = f'<text class="note faint end" x="{x - 4:g}" y="{y:g}" dy="-4">'
    if row.note:
        yield f"{note}{escape(row.note)}</text>"
    x, end = (x - 6, ' class="end"') if pin.side else (x + 6, "")
    if pin.box.junction:
        # Signs are in the circle, next to the ends of the wires.
        x = JUNCTION_SIZE / 2 - 2 if pin.entry else 3.5
        y = pin.box.height / 2 + pin.entry * 7 if pin.entry else y
    if row.name:
        yield f'<text{end} x="{x:g}" y="{y:g}" dy="4">{title(row.port)}{escape(row.name)}</text>'


def outlined(figure: Figure, kind: str) -> Iterator[str]:
    """Yield the outline of a `figure`, an element of the class `kind`."""
    x, y, width, height = figure.outline
    if figure.symbol.outline == "triangle":
        path = f"M{x:g} {y:g}v{height:g}l{width:g} {-height / 2:g}z"
        yield f'<path class="{kind}" d="{path}"/>'
        return
    corner = JUNCTION_SIZE / 2 if figure.box.junction else 4
    if any(pin.entry for pin in figure.box.sides[0]):
        y, height = (figure.box.height - JUNCTION_SIZE) / 2, JUNCTION_SIZE
    size = f'width="{width:g}" height="{height:g}"'
    yield f'<rect class="{kind}" x="{x:g}" y="{y:g}" {size} rx="{corner:g}"/>'
    if isinstance(figure.block, Diagram):
        size = f'width="{width - 6:g}" height="{height - 6:g}"'
        yield f'<rect class="{kind} open" x="{x + 3:g}" y="{y + 3:g}" {size} rx="2"/>'


def inscribed(figure: Figure) -> Iterator[str]:
    """Yield the symbol, the name and the captions of a `figure`."""
    _, y, _, height = figure.outline
    yield from symbol_of(figure.symbol, figure.middle, y + height / 2)
    x, end, low = figure.box.width / 2, "middle", y + height + 13
    if figure.box.junction:
        x, end, low = JUNCTION_SIZE - 6, "", 10.0
    if figure.name:
        yield f'<text class="name {end}" x="{x:g}" y="{low:g}">{escape(figure.name)}</text>'
        low += CAPTION_HEIGHT
    for line in figure.captions:
        yield f'<text class="note faint {end}" x="{x:g}" y="{low:g}">{raised(line)}</text>'
        low += CAPTION_HEIGHT


def symbol_of(symbol: Symbol, x: float, y: float) -> Iterator[str]:
    """Yield the content of a `symbol` around the point (`x`, `y`) [px]."""
    if symbol.curve:
        width, height = CURVE_SIZE
        left, top = x - width / 2, y - height / 2
        yield f'<path class="axes" d="M{left:g} {y:g}h{width:g}M{x:g} {top:g}v{height:g}"/>'
        yield f'<path class="curve" transform="translate({left:g},{top:g})" d="{escape(symbol.curve)}"/>'
    lines = symbol.text.split("\n")
    y -= height_of(lines) / 2
    half = max(map(breadth, lines)) / 2
    for line in lines:
        if line == "-":
            yield f'<path class="curve" d="M{x - half:g} {y + 2:g}h{2 * half:g}"/>'
        else:
            yield f'<text class="middle" x="{x:g}" y="{y + 11:g}">{raised(line)}</text>'
        y += BAR_HEIGHT if line == "-" else LINE_HEIGHT


def raised(text: str) -> str:
    """Return a `text` as SVG, with its superscripts."""
    parts = [escape(part) for part in RAISED.split(text)]
    # After a superscript, the text returns to its line.
    return parts[0] + "".join(
        f'<tspan class="note" dy="-4">{up}</tspan><tspan dy="4">{part}</tspan>'
        for up, part in zip(parts[1::2], parts[2::2], strict=True)
    )


def title(port: Port) -> str:
    """Return the tooltip of a `port`."""
    text = (
        f"{port.path}{port.summary.removeprefix(port.name)}\n{port.declaration.meaning}"
    )
    return f"<title>{escape(text.strip())}</title>"


def forks(net: Net) -> list[Point]:
    """Return the points at which the wires of a `net` branch."""
    points = sorted({point for path in net.paths for point in path})
    edges = {
        edge
        for path in net.paths
        for a, b in pairwise(path)
        for edge in pairwise(
            p for p in points if dist(a, p) + dist(p, b) < dist(a, b) + 1e-6
        )
    }
    ends = Counter(point for edge in edges for point in edge)
    return [point for point in points if ends[point] > 2]


# Set here, as the framework does not import the drawing package.
Diagram._artists[".svg"] = svg_of
