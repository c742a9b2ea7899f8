"""The layout of boxes and wires: in layers, by the method of Sugiyama, Tagawa and Toda (1981)."""

from __future__ import annotations

from random import Random

from trussflow.blocks.drawing.graph import Box, Channels, Net
from trussflow.blocks.drawing.layering import against, by_flow, edges_of, into_layers, rails, sifted
from trussflow.blocks.drawing.ordering import Ordering
from trussflow.blocks.drawing.placing import Placing
from trussflow.blocks.drawing.routing import route, tracks

GAP = 20.0
"""Between boxes [px]."""

WIRE = 10.0
"""Between wires [px]."""

PITCH = 18.0
"""Between pins [px]."""

ROUNDS = 3
"""Of placing, each with an order that fits the heights of the one before."""

EFFORT = 300
"""How many boxes all arrangements together may have that are compared; at most 36 are."""


def layout(
    boxes: list[Box], nets: list[Net], width: float = 0.0, top: float = 0.0
) -> tuple[float, float]:
    """Place boxes and wires, what is not wired to each other one below the other; return the size [px].

    Parameters
    ----------
    boxes : list of Box
        What to place.
    nets : list of Net
        The wires.
    width : float
        At least so wide the picture is to be [px].
    top : float
        Where it begins [px].

    Returns
    -------
    tuple of float
        Width and height [px].
    """
    height, placed = top, []
    for some, theirs in components(boxes, nets):
        layers, channels, right = arranged(some, theirs)
        everything = [box for layer in layers for box in layer]
        highest = min(box.y for box in everything)
        inner = {pin.box: None for channel in channels for rail in channel for pin in rail.left + rail.right}
        for box in {**inner, **dict.fromkeys(everything)}:
            box.y += height - highest
        height = max(box.y + box.height for box in everything) + GAP
        width = max(width, right)
        placed.append((theirs, channels))
    for box in boxes:
        box.x = width - box.width if box.edge > 0 else box.x
    for theirs, channels in placed:
        route(theirs, channels)
    return width, max(top, height - GAP)


def components(boxes: list[Box], nets: list[Net]) -> list[tuple[list[Box], list[Net]]]:
    """Return what is wired to each other, directly or not, in the order of its first box."""
    groups = {box: {box: None} for box in boxes}
    for net in nets:
        for pin in net.targets:
            if groups[pin.box] is not groups[net.source.box]:
                groups[net.source.box].update(groups[pin.box])
                groups.update(dict.fromkeys(groups[pin.box], groups[net.source.box]))
    return [
        ([box for box in boxes if box in group], [net for net in nets if net.source.box in group])
        for group in {id(group): group for group in groups.values()}.values()
    ]


def arranged(boxes: list[Box], nets: list[Net]) -> tuple[list[list[Box]], Channels, float]:
    """Return layers, channels and width of the best of some arrangements: few crossings, then few bends."""
    start = [(pin, pin.dy) for box in boxes for side in box.sides for pin in side]
    scores: dict[int, tuple[int, int, int]] = {}

    def attempt(variant: int) -> tuple[list[list[Box]], Channels, float]:
        for pin, dy in start:
            pin.dy = dy
        for side in (side for box in boxes for side in box.sides):
            side.sort(key=lambda pin: pin.dy)
        layers, channels = ordered(boxes, nets, variant)
        x, crossings = 0.0, 0
        for k, channel in enumerate(channels):
            verticals, number = tracks(channel)
            crossings += number
            x += 1.5 * WIRE if k else 0.0
            for track in verticals:
                for rail in track:
                    rail.x = x
                x += WIRE
            if k < len(layers):
                x += max((pin.note for box in layers[k] for pin in box.sides[0]), default=0.0)
                column = max(box.width for box in layers[k])
                for box in layers[k]:
                    box.x = x + (0.0 if box.edge < 0 else (column - box.width) / 2)
                x += column
        scores[variant] = crossings, route(nets, channels), over(layers)
        return layers, channels, x

    for variant in range(max(1, min(36, EFFORT // len(boxes)))):
        found = attempt(variant)
    best = min(scores, key=scores.__getitem__)
    return found if best == variant else attempt(best)


def over(layers: list[list[Box]]) -> int:
    """Return how often a wire passes over a box, for it should pass below."""
    return sum(bool(b.width) and not a.width for layer in layers for i, b in enumerate(layer) for a in layer[:i])


def ordered(boxes: list[Box], nets: list[Net], variant: int) -> tuple[list[list[Box]], Channels]:
    """Return layers and channels, ordered and placed; the variants from 2 on begin in mixed order."""
    edges, mixed, chance = edges_of(nets), list(boxes), Random(variant)
    if variant > 1:
        chance.shuffle(mixed)
    orders = [sifted(by_flow(mixed, edges), edges), sifted(mixed, edges)]
    layers = into_layers(min(orders[:: 1 if variant % 2 else -1], key=lambda o: against(o, edges)), edges)
    channels = rails(nets, layers, WIRE, shared=variant % 4 < 2)
    for layer in layers if variant > 1 else ():
        chance.shuffle(layer)
    ordering = Ordering(layers, channels)
    ordering.sort()
    for again in range(ROUNDS):
        if again:
            for pin in ordering.rails:
                pin.rank = pin.y / PITCH
            ordering.swap()
        Placing(layers, GAP).place(channels)
    return layers, channels
