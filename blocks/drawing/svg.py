"""A scene as SVG: one text, which reads in light and in dark, on screens and on paper."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from xml.sax.saxutils import escape

from trussflow.blocks.drawing.graph import Net, Point
from trussflow.blocks.drawing.loops import in_loops
from trussflow.blocks.drawing.scene import Scene, breadth, brief, scene_of
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.clock import Clock
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port

MARGIN = 12
RATES = "#1f77e0", "#8b5cf6", "#d9730d", "#0e9f6e", "#db2777", "#7f8c1d", "#0891b2"
"""Colours of sampled blocks by rate; beyond that many they repeat. They stand on light and on dark."""

LOOP = "#e5484d"
FONT = "ui-monospace,'DejaVu Sans Mono',Menlo,Consolas,monospace"


def rules(paper: str, ink: str, faint: str, line: str, box: str) -> str:
    """Return the rules of style with these colours."""
    return (
        f".tf .paper{{fill:{paper}}}.tf text{{fill:{ink}}}.tf .faint{{fill:{faint}}}.tf .wire{{stroke:{line}}}"
        f".tf .tip{{fill:{line}}}.tf .box{{fill:{box};stroke:{line}}}"
    )


STYLE = (
    f".tf text{{font:11px {FONT}}}.tf .name{{font:bold 12px {FONT}}}.tf .note{{font:9px {FONT}}}"
    ".tf .wire{fill:none}.tf .near{fill:none;stroke:transparent;stroke-width:8}.tf .end{text-anchor:end}"
    + rules("#ffffff", "#1f2328", "#656d76", "#57606a", "#f6f8fa")
    + f"@media screen and (prefers-color-scheme:dark){{{rules('#0d1117', '#e6edf3', '#9198a1', '#9198a1', '#161b22')}}}"
    + "".join(
        f".tf .{name}{{fill:{colour};fill-opacity:.16;stroke:{colour}}}"
        for name, colour in [*((f"rate{i}", colour) for i, colour in enumerate(RATES)), ("loop", LOOP)]
    )
    + ".tf .open{fill:none}"
)


def svg_of(diagram: Diagram, depth: int) -> str:
    """Return the picture of a diagram, `depth` levels of the diagrams in it open [-]."""
    scene, red = scene_of(diagram, depth), in_loops(diagram)
    clocks = sorted(clocks_of(diagram))
    rates = {clock: f"rate{i % len(RATES)}" for i, clock in enumerate(clocks)}

    def colour(block: Block) -> str:
        own = clocks_of(block)
        return "loop" if red & {*leaves(block)} else rates[own.pop()] if len(own) == 1 else ""

    legend = {}
    for clock, rate in rates.items():
        legend[f"every {float(clock.period):g} s" + f" from {float(clock.offset):g} s" * bool(clock.offset)] = rate
    legend |= {"algebraic loop": "loop"} if red else {}
    keys, x = "", 0.0
    for text, kind in legend.items():
        keys += f'<rect class="box {kind}" x="{x:g}" y="0" width="12" height="12"/>'
        keys += f'<text class="faint" x="{x + 17:g}" y="10">{text}</text>'
        x += breadth(text) + 34
    width = max(scene.width, x - 17, 40.0) + 2 * MARGIN
    height = scene.height + 2 * MARGIN + (28 if keys else 0)
    body = "".join(drawn(scene, colour))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="tf" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}"><title>{escape(diagram.name)}</title><style>{STYLE}</style>'
        f'<rect class="paper" width="{width:g}" height="{height:g}"/>'
        f'<g transform="translate({MARGIN},{MARGIN})">{body}</g>'
        f'<g transform="translate({MARGIN},{scene.height + MARGIN + 16:g})">{keys}</g></svg>\n'
    )


def leaves(block: Block) -> Iterator[Block]:
    """Return the blocks in a diagram and in those inside it, or a block that is none."""
    if not isinstance(block, Diagram):
        yield block
    for inner in block.blocks.values() if isinstance(block, Diagram) else ():
        yield from leaves(inner)


def clocks_of(block: Block) -> set[Clock]:
    """Return the clocks of a block, or of all in a diagram."""
    return {Clock.of(leaf) for leaf in leaves(block) if leaf.sample_time is not None}


def drawn(scene: Scene, colour: Callable[[Block], str]) -> Iterator[str]:
    """Return the elements of a scene."""
    for net, source in scene.wires:
        line = "".join("M" + "L".join(f"{x:g} {y:g}" for x, y in path) for path in net.paths)
        tips = "".join(f"M{x:g} {y:g}l-7 -3.5v7z" for x, y in (path[-1] for path in net.paths))
        dots = "".join(f"M{x - 2.5:g} {y:g}a2.5 2.5 0 1 1 0 .01z" for x, y in forks(net))
        yield f'<g>{title(source)}<path class="near" d="{line}"/><path class="wire" d="{line}"'
        yield f' stroke-width="{1.0 if source.whole_shape == () else 1.7}"/><path class="tip" d="{tips}{dots}"/></g>'
    for block, box, inner in scene.blocks:
        kind = f'class="box {colour(block)}{" open" if inner else ""}"'
        yield f'<g transform="translate({box.x:g},{box.y:g})"><title>{escape(block._described().head)}</title>'
        yield f'<rect {kind} width="{box.width:g}" height="{box.height:g}" rx="4"/>'
        if isinstance(block, Diagram) and not inner:
            yield f'<rect {kind} x="3" y="3" width="{box.width - 6:g}" height="{box.height - 6:g}" rx="2"/>'
        yield f'<text class="name" x="8" y="17">{escape(brief(block.name))}</text>'
        yield f'<text class="faint" x="8" y="31">{escape(brief(type(block).__name__))}</text>'
        yield from ("<g>", *drawn(inner, colour), "</g>") if inner else ()
        yield "</g>"
    for row, pin in scene.pins:
        x, end = (pin.box.x + 6, "") if row.port.is_input else (pin.box.x + pin.box.width - 6, ' class="end"')
        if row.name:
            yield f'<text{end} x="{x:g}" y="{pin.y + 4:g}">{title(row.port)}{escape(row.name)}</text>'
        if row.note:
            x, y = pin.box.x - 4, pin.y + (-4 if row.key else 3)
            yield f'<text class="note faint end" x="{x:g}" y="{y:g}">{escape(row.note)}</text>'


def title(port: Port) -> str:
    """Return what is shown of a port where the pointer rests."""
    rate = port.block.sample_time
    facts = f"{port.block.path}.{port.summary}", port.declaration.meaning, rate and f"every {rate:g} s"
    return f"<title>{escape(chr(10).join(filter(None, facts)))}</title>"


def forks(net: Net) -> list[Point]:
    """Return where the wires of a net part."""
    lines = [(a, b) for path in net.paths for a, b in zip(path, path[1:], strict=False)]
    found = []
    for x, y in dict.fromkeys(point for path in net.paths for point in path[1:-1]):
        ways = set()
        for (x1, y1), (x2, y2) in lines:
            if min(x1, x2) <= x <= max(x1, x2) and min(y1, y2) <= y <= max(y1, y2):
                ways |= {(a > x) - (a < x) + 2 * ((b > y) - (b < y)) for a, b in ((x1, y1), (x2, y2))} - {0}
        if len(ways) > 2:
            found.append((x, y))
    return found


Diagram._artist = svg_of
