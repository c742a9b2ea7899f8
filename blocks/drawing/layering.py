"""Assignment of boxes to layers, with as many signals as possible from left to right."""

from __future__ import annotations

from collections import Counter
from itertools import product

from trussflow.blocks.drawing.graph import Box, Channels, Net, Rail, way
from trussflow.blocks.drawing.placing import positions

Edges = Counter[tuple[Box, Box]]
"""Number of nets from one box to another."""


def edges_of(nets: list[Net]) -> Edges:
    """Return the edges of `nets`, without loops of a single box."""
    edges = Edges()
    for net in nets:
        own = net.source.box
        edges.update(
            (own, box)
            for box in dict.fromkeys(pin.box for pin in net.targets)
            if box is not own
        )
    return edges


def by_flow(boxes: list[Box], edges: Edges) -> list[Box]:
    """Return `boxes` in an order with few `edges` in the opposite direction.

    References
    ----------
    Eades, Lin, Smyth (1993), *A fast and effective heuristic for the feedback arc set problem*.
    """
    left, right, rest = list[Box](), list[Box](), dict.fromkeys(boxes)
    while rest:
        gives, takes = Counter[Box](), Counter[Box]()
        for (a, b), number in edges.items():
            if a in rest and b in rest:
                gives[a] += number
                takes[b] += number
        if chosen := [box for box in rest if takes[box] and not gives[box]]:
            right = chosen + right
        else:
            first = [box for box in rest if not takes[box]]
            chosen = first or [max(rest, key=lambda box: gives[box] - takes[box])]
            left += chosen
        for box in chosen:
            del rest[box]
    return left + right


def into_layers(order: list[Box], edges: Edges) -> list[list[Box]]:
    """Return boxes by layer: after their sources by `edges` along the `order`, with short wires."""
    rank = {box: i for i, box in enumerate(order)}
    limits = [(rank[a], rank[b], 1) for a, b in edges if rank[a] < rank[b]]
    limits += [
        (rank[a], rank[b], 1) for a, b in product(order, order) if a.edge < b.edge
    ]
    wires = [(rank[a], rank[b], 0, number) for (a, b), number in edges.items()]
    found = positions(len(order), limits, wires).round().tolist()
    for box, layer in zip(order, found, strict=True):
        box.layer = int(max(found) if box.edge > 0 else layer)
    return [
        [box for box in order if box.layer == i] for i in range(int(max(found)) + 1)
    ]


def rails(nets: list[Net], layers: list[list[Box]], gap: float) -> Channels:
    """Route `nets` through the `layers` between their ends, and return the rails in each channel.

    Feedback to a box further left, or to the box itself, passes all layers between, those of both ends
    included. Dummy nodes of height `gap` [px] are added at the lower end of each passed layer.
    """
    channels: Channels = [[] for _ in range(len(layers) + 1)]
    for net in nets:
        own, ways = net.source.box.layer, dict[int, Box]()
        reached = [pin.box.layer for pin in net.targets]
        for layer in [*range(own + 1, max(reached)), *range(min(reached), own + 1)]:
            ways[layer] = way(gap, layer)
            layers[layer].append(ways[layer])
        for k in range(min(*reached, own + 1), max(*reached, own + 1) + 1):
            rail = Rail(net, [net.source] if k == own + 1 else [], [])
            rail.left += ways[k - 1].sides[1] if k - 1 in ways else []
            rail.right += ways[k].sides[0] if k in ways else []
            rail.right += [pin for pin in net.targets if pin.box.layer == k]
            channels[k].append(rail)
    return channels
