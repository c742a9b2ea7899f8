"""SVG text of a scene, for light and dark themes, screens and paper."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from html import escape
from importlib.resources import files
from itertools import pairwise

from trussflow.blocks.drawing.graph import Net, Point
from trussflow.blocks.drawing.scene import Scene, breadth, brief, scene_of
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import Clock
from trussflow.blocks.framework.diagram import Diagram, leaves
from trussflow.blocks.framework.port import Port

RATE_COLOURS = 6
"""Number of colours of rates in the style sheet; more rates reuse them."""

PICTURE_MARGIN = 12
"""Margin around the picture [px]."""


def svg_of(diagram: Diagram) -> str:
    """Return the picture of a `diagram`, each nested diagram as one block."""
    scene = scene_of(diagram)
    style = (
        files("trussflow.blocks.drawing")
        .joinpath("picture.css")
        .read_text(encoding="utf-8")
    )
    rates = {
        clock: f"rate{i % RATE_COLOURS}"
        for i, clock in enumerate(sorted(clocks_of(diagram)))
    }

    def colour(block: Block) -> str:
        own = clocks_of(block)
        return rates[own.pop()] if len(own) == 1 else ""

    keys, x, y = "", float(PICTURE_MARGIN), scene.height + PICTURE_MARGIN + 16
    for clock, kind in rates.items():
        text = every(float(clock.period), float(clock.offset))
        keys += f'<rect class="box {kind}" x="{x:g}" y="{y:g}" width="12" height="12"/>'
        keys += f'<text class="faint" x="{x + 17:g}" y="{y + 10:g}">{text}</text>'
        x += breadth(text) + 34
    width, height = (
        max(scene.width + 2 * PICTURE_MARGIN, x),
        y + PICTURE_MARGIN * (2 if keys else 0) - 4,
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="tf" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}"><title>{escape(diagram.name)}</title><style>{style}</style>'
        f'<rect class="paper" width="{width:g}" height="{height:g}"/>'
        f'<g transform="translate({PICTURE_MARGIN},{PICTURE_MARGIN})">'
        f"{''.join(drawn(scene, colour))}</g>{keys}</svg>\n"
    )


def every(period: float, offset: float) -> str:
    """Return the text of a clock with this `period` and `offset` [s]."""
    return f"every {period:g} s from {offset:g} s" if offset else f"every {period:g} s"


def clocks_of(block: Block) -> set[Clock]:
    """Return the clock of a `block`, or the clocks of all blocks in a diagram."""
    return {Clock.of(leaf) for leaf in leaves(block) if leaf.sample_time is not None}


def drawn(scene: Scene, colour: Callable[[Block], str]) -> Iterator[str]:
    """Yield the SVG elements of a `scene`; `colour` returns the class of a block."""
    for net, source in scene.wires:
        line = "".join(
            "M" + "L".join(f"{x:g} {y:g}" for x, y in path) for path in net.paths
        )
        tips = "".join(
            f"M{x:g} {y:g}l-7 -3.5v7z" for x, y in (path[-1] for path in net.paths)
        )
        # Ends that are 0.01 px apart, as an arc between equal ends is empty.
        dots = "".join(
            f"M{x - 2.5:g} {y:g}a2.5 2.5 0 1 1 0 .01z" for x, y in forks(net)
        )
        kind = "wire scalar" if source.whole_shape == () else "wire"
        # The first path is wide and transparent: the tooltip appears near a wire.
        yield f'<g>{title(source)}<path class="near" d="{line}"/><path class="{kind}" d="{line}"/>'
        yield f'<path class="tip" d="{tips}{dots}"/></g>'
    for block, box in scene.blocks:
        kind = f'class="box {colour(block)}"'
        yield f'<g transform="translate({box.x:g},{box.y:g})">'
        yield f"<title>{escape(block._described().head)}</title>"
        yield f'<rect {kind} width="{box.width:g}" height="{box.height:g}" rx="4"/>'
        if isinstance(block, Diagram):
            size = f'width="{box.width - 6:g}" height="{box.height - 6:g}"'
            yield f'<rect {kind[:-1]} open" x="3" y="3" {size} rx="2"/>'
        yield f'<text class="name" x="8" y="17">{escape(brief(block.name))}</text>'
        yield f'<text class="faint" x="8" y="31">{escape(brief(type(block).__name__))}</text>'
        yield "</g>"
    for row, pin in scene.pins:
        x, end = (
            (pin.box.x + 6, "")
            if row.port.is_input
            else (pin.box.x + pin.box.width - 6, ' class="end"')
        )
        if row.name:
            yield f'<text{end} x="{x:g}" y="{pin.y + 4:g}">{title(row.port)}{escape(row.name)}</text>'
        if row.note:
            x, y = pin.box.x - 4, pin.y + (-4 if row.key else 3)
            yield f'<text class="note faint end" x="{x:g}" y="{y:g}">{escape(row.note)}</text>'


def title(port: Port) -> str:
    """Return the tooltip of a `port`."""
    block = port.block
    facts = [f"{port.path}{port.summary.removeprefix(port.name)}"]
    facts.append(port.declaration.meaning)
    if block.sample_time is not None:
        facts.append(every(block.sample_time, block.sample_offset))
    return f"<title>{escape(chr(10).join(filter(None, facts)))}</title>"


def forks(net: Net) -> list[Point]:
    """Return the points at which the wires of a `net` branch."""
    lines = [line for path in net.paths for line in pairwise(path)]
    found = []
    for x, y in dict.fromkeys(point for path in net.paths for point in path[1:-1]):
        # Directions in which wires leave this point: two are a bend, three a branch.
        ways = set()
        for (x1, y1), (x2, y2) in lines:
            if min(x1, x2) <= x <= max(x1, x2) and min(y1, y2) <= y <= max(y1, y2):
                ways |= {
                    ((a > x) - (a < x), (b > y) - (b < y))
                    for a, b in ((x1, y1), (x2, y2))
                }
        if len(ways - {(0, 0)}) > 2:
            found.append((x, y))
    return found


# Set here, as the framework does not import the drawing package.
Diagram._artist = svg_of
