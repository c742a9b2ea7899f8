"""Layered layout of boxes and wires, by the method of Sugiyama, Tagawa and Toda (1981)."""

from __future__ import annotations

from itertools import pairwise
from random import Random

from trussflow.blocks.drawing.graph import Box, Channels, Net
from trussflow.blocks.drawing.layering import by_flow, edges_of, into_layers, rails
from trussflow.blocks.drawing.ordering import Ordering, crossings
from trussflow.blocks.drawing.placing import place
from trussflow.blocks.drawing.routing import route, tracks
from trussflow.blocks.support.progress import counted

BOX_GAP = 20.0
"""Vertical distance between boxes [px]."""

WIRE_GAP = 10.0
"""Distance between wires [px]."""

PIN_PITCH = 18.0
"""Distance between pins [px]."""

MAX_COMPARED_BOXES, MAX_ARRANGEMENTS = 400, 4
"""Largest number of boxes in all compared arrangements, and largest number of arrangements."""


def layout(boxes: list[Box], nets: list[Net]) -> tuple[float, float]:
    """Place boxes and wires; return the size of the picture [px].

    Parameters
    ----------
    boxes : list of Box
        Boxes to place.
    nets : list of Net
        The wires.

    Returns
    -------
    tuple of float
        Width and height [px].
    """
    if not boxes:
        return 0.0, 0.0
    # Attempts permute the pins of boxes, so that each begins with these heights.
    start = [(pin, pin.dy) for box in boxes for side in box.sides for pin in side]
    scores: dict[int, tuple[int, int]] = {}

    def attempt(variant: int) -> tuple[float, float]:
        for pin, dy in start:
            pin.dy = dy
        for side in (side for box in boxes for side in box.sides):
            side.sort(key=lambda pin: pin.dy)
        # Sugiyama, steps 1 to 5; only x and the routes are left.
        layers, channels = ordered(boxes, nets, variant)
        x = 0.0
        for k, channel in enumerate(channels):
            verticals = tracks(channel)
            x += 1.5 * WIRE_GAP if k else 0.0
            for rail, track in verticals.items():
                rail.x = x + track * WIRE_GAP
            x += WIRE_GAP * (1 + max(verticals.values(), default=-1))
            if k < len(layers):
                notes = (pin.note for box in layers[k] for pin in box.sides[0])
                x += max(notes, default=0.0)
                column = max(box.width for box in layers[k])
                for box in layers[k]:
                    box.x = x + (0.0 if box.edge < 0 else (column - box.width) / 2)
                x += column
        for box in boxes:
            box.x = x - box.width if box.edge > 0 else box.x
        scores[variant] = sum(map(crossings, channels)), route(nets, channels)
        return x, max(box.y + box.height for layer in layers for box in layer)

    for variant in counted(
        "drawing",
        range(max(1, min(MAX_ARRANGEMENTS, MAX_COMPARED_BOXES // len(boxes)))),
    ):
        size = attempt(variant)
    best = min(scores, key=scores.__getitem__)
    # Attempts write into the boxes, so that the best one is repeated unless it was the
    # last. Its random numbers depend on its number only.
    return size if best == variant else attempt(best)


def ordered(
    boxes: list[Box], nets: list[Net], variant: int
) -> tuple[list[list[Box]], Channels]:
    """Return layers and channels of `boxes` and `nets`; a `variant` > 0 is shuffled [-]."""
    edges, mixed, chance = edges_of(nets), list(boxes), Random(variant)
    if variant:
        # Heuristics of both orders break ties by position, so that a shuffle gives
        # another local optimum.
        chance.shuffle(mixed)
    order = by_flow(mixed, edges)
    layers = into_layers(order, edges)
    junctions = [box for box in boxes if box.junction]
    source = {pin: net.source.box for net in nets for pin in net.targets}
    for box in junctions:
        for pin in box.sides[0]:
            pin.last = source.get(pin, box).layer >= box.layer
        box.sides[0].sort(key=lambda pin: pin.last)
    channels = rails(nets, layers, WIRE_GAP)
    for layer in layers if variant else ():
        chance.shuffle(layer)
        layer.sort(key=lambda box: box.back)
    Ordering(layers, channels).sort()
    for box in junctions:
        # The longest path runs straight through the junction.
        pins = box.sides[0]
        box.join(
            max(pins, key=lambda p: -1 if p.last else order.index(source.get(p, box)))
        )
    place(layers, channels, BOX_GAP)
    for layer in layers:
        for box, below in pairwise(box for box in layer if box.width):
            box.floor = below.y
    return layers, channels
