"""Assignment of boxes to layers, with as many signals as possible from left to right."""

from __future__ import annotations

from collections import Counter
from itertools import product

from trussflow.blocks.drawing.graph import Box, Channels, Net, Rail, way
from trussflow.blocks.drawing.placing import positions

Edges = Counter[tuple[Box, Box]]
"""Weights of the nets from one box to another: 2 for each, 1 for one to negative inputs of sums only."""


def edges_of(nets: list[Net]) -> Edges:
    """Return the edges of `nets`, without loops of a single box."""
    edges = Edges()
    for net in nets:
        # Once per net and box, as several pins of a box share most of the wire.
        weights = {pin.box: 1 for pin in net.targets}
        weights |= {pin.box: 2 for pin in net.targets if not pin.negative}
        weights.pop(net.source.box, None)
        edges.update({(net.source.box, box): w for box, w in weights.items()})
    return edges


def by_flow(boxes: list[Box], edges: Edges) -> list[Box]:
    """Return `boxes` in an order with few `edges` in the opposite direction.

    References
    ----------
    Eades, Lin, Smyth (1993), *A fast and effective heuristic for the feedback arc set problem*.
    """
    # Sugiyama, step 1: cycle removal. Edges against the order of the result are
    # feedback. Dictionaries keep the order, so that equal diagrams give equal pictures.
    left, right, rest = list[Box](), list[Box](), dict.fromkeys(boxes)
    while rest:
        gives, takes = Counter[Box](), Counter[Box]()
        for (a, b), number in edges.items():
            if a in rest and b in rest:
                gives[a] += number
                takes[b] += number
        # Sinks to the right end, sources to the left end: neither causes feedback.
        # Isolated boxes count as sources.
        if chosen := [box for box in rest if takes[box] and not gives[box]]:
            right = chosen + right
        else:
            first = [box for box in rest if not takes[box]]
            # Inside of cycles, a box that continues a path from the left makes feedback
            # run back to the start of the path; with the greatest excess of leaving
            # edges, it makes few feedback edges.
            fed = {b for a, b in edges if a not in rest}
            chosen = first or [
                max(rest, key=lambda box: (box in fed, gives[box] - takes[box]))
            ]
            left += chosen
        for box in chosen:
            del rest[box]
    return left + right


def into_layers(order: list[Box], edges: Edges) -> list[list[Box]]:
    """Return boxes by layer: after their sources by `edges` along the `order`, with short wires."""
    # Sugiyama, step 2: layer assignment, by the linear program of Gansner et al. It has
    # integer solutions, as its matrix is totally unimodular.
    rank = {box: i for i, box in enumerate(order)}
    # Feedback edges have no limit, so that they may run to the left. They still have a
    # weight below, so that they are short.
    ahead = [(a, b) for a, b in edges if rank[a] < rank[b]]
    back = {a for a, _ in edges} - {a for a, _ in ahead}
    limits = [
        (rank[a], rank[b], 1)
        for a, b in ahead
        # A box with feedback only, such as an observer, follows its first source.
        if b not in back or rank[a] == min(rank[c] for c, d in ahead if d is b)
    ]
    # Exposed inputs are in layers before all blocks, exposed outputs after them.
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
        # Sugiyama, step 3: a dummy node per passed layer, so that each wire connects
        # neighbouring layers only. All targets of a net share its dummy nodes.
        own, ways = net.source.box.layer, dict[int, Box]()
        reached = [pin.box.layer for pin in net.targets]
        for layer in [*range(own + 1, max(reached)), *range(min(reached), own + 1)]:
            ways[layer] = way(gap, layer)
            ways[layer].back = layer <= own
            layers[layer].append(ways[layer])
        # Channel k is on the left of layer k; the net starts in the channel on the
        # right of its source.
        for k in range(min(*reached, own + 1), max(*reached, own + 1) + 1):
            rail = Rail(net, [net.source] if k == own + 1 else [], [])
            rail.left += ways[k - 1].sides[1] if k - 1 in ways else []
            rail.right += ways[k].sides[0] if k in ways else []
            rail.right += [pin for pin in net.targets if pin.box.layer == k]
            channels[k].append(rail)
    return channels
