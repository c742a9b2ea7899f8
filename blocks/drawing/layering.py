"""Which box stands in which layer: signals go right wherever they can."""

from __future__ import annotations

from collections import Counter

from trussflow.blocks.drawing.graph import Box, Channels, Net, Pin, Rail, way

Edges = Counter[tuple[Box, Box]]


def edges_of(nets: list[Net]) -> Edges:
    """Return how many nets go from one box to another."""
    edges = Edges()
    for net in nets:
        for box in dict.fromkeys(pin.box for pin in net.targets):
            edges[net.source.box, box] += box is not net.source.box
    return +edges


def by_flow(boxes: list[Box], edges: Edges) -> list[Box]:
    """Return boxes in an order that few wires run against.

    References
    ----------
    Eades, Lin, Smyth (1993), *A fast and effective heuristic for the feedback arc set problem*.
    """
    left, right, rest = list[Box](), list[Box](), dict.fromkeys(boxes)
    while rest:
        inner = {edge: number for edge, number in edges.items() if rest.keys() >= {*edge}}
        surplus = Counter(dict.fromkeys(rest, 0))
        for (a, b), number in inner.items():
            surplus[a] += number
            surplus[b] -= number
        gives, takes = {a for a, _ in inner}, {b for _, b in inner}
        if chosen := [box for box in rest if box in takes and box not in gives]:
            right = chosen + right
        else:
            chosen = [box for box in rest if box not in takes] or [max(rest, key=surplus.__getitem__)]
            left += chosen
        for box in chosen:
            del rest[box]
    return left + right


def into_layers(order: list[Box], edges: Edges) -> list[list[Box]]:
    """Give each box its layer: behind all that feeds it and comes before it, and near what it is wired to."""
    rank = {box: i for i, box in enumerate(order)}
    near: dict[Box, list[Box]] = {box: [] for box in order}
    before: dict[Box, list[Box]] = {box: [] for box in order}
    after: dict[Box, list[Box]] = {box: [] for box in order}
    for (a, b), number in edges.items():
        near[a] += [b] * number
        near[b] += [a] * number
        if rank[a] < rank[b]:
            before[b].append(a)
            after[a].append(b)
    first = int(any(box.edge < 0 for box in order))
    for box in order:
        box.layer = 0 if box.edge < 0 else max((a.layer + 1 for a in before[box]), default=first)
    last = max((box.layer for box in order if box.edge <= 0), default=0)
    for box in order:
        box.layer = last + 1 if box.edge > 0 else box.layer
    for box in (box for _ in range(4) for box in reversed(order) if not box.edge):
        low = max((a.layer + 1 for a in before[box]), default=first)
        high = min((b.layer - 1 for b in after[box]), default=last)
        pull = sum((other.layer > box.layer) - (other.layer < box.layer) for other in near[box])
        box.layer = high if pull > 0 else low if pull < 0 else box.layer
    return [[box for box in order if box.layer == i] for i in range(1 + max(b.layer for b in order))]


def rails(nets: list[Net], layers: list[list[Box]], gap: float, shared: bool) -> Channels:
    """Lead nets through the layers between their ends, and return what joins them in each channel.

    What a net feeds further left, or itself, it reaches by a way back through all layers between, its own
    included. Boxes without width mark the ways, at the lower ends of their layers. A net forks late if ways
    are `shared`, else in its first channel.
    """
    channels: Channels = [[] for _ in range(len(layers) + 1)]
    for net in nets:
        own = net.source.box.layer
        first = Rail(net, [net.source], [])
        channels[own + 1].append(first)
        groups: dict[Box | None, list[Pin]] = {}
        for pin in net.targets:
            groups.setdefault(None if shared else pin.box, []).append(pin)
        for group in groups.values():
            reached = [pin.box.layer for pin in group]
            ways: dict[int, Box] = {}
            for layer in [*range(own + 1, max(reached)), *range(min(reached), own + 1)]:
                ways[layer] = way(gap, layer)
                layers[layer].append(ways[layer])
            for k in range(min(*reached, own + 1), max(*reached, own + 1) + 1):
                rail = first if k == own + 1 else Rail(net, [], [])
                rail.left += ways[k - 1].sides[1] if k - 1 in ways else []
                rail.right += ways[k].sides[0] if k in ways else []
                rail.right += [pin for pin in group if pin.box.layer == k]
                channels[k] += [] if rail is first else [rail]
    return channels
