"""Where the verticals of wires stand in the channels between layers, and the paths that follow."""

from __future__ import annotations

from trussflow.blocks.drawing.graph import Channels, Net, Point, Rail, way
from trussflow.blocks.drawing.ordering import cuts

NEVER = 1000
"""What it costs that two wires lie upon each other [crossings]."""

CLOSE = 4.0
"""Heights nearer than that look like one [px]."""


def cost(a: Rail, b: Rail) -> int:
    """Return crossings, and wires upon each other, if `a` stands left of `b`."""
    same = a.net is not b.net and any(abs(y - z) < CLOSE for y in a.span[1] for z in b.span[0])
    return cuts(a.span, b.span) + NEVER * same


def tracks(channel: list[Rail]) -> tuple[dict[Rail, int], int]:
    """Return on which track of a `channel` verticals stand, from the left, and how often wires cross.

    Where none can come next without lying upon others, one is led over two tracks.
    """
    for rail in channel:
        rail.measure(ranked=False)
    bent = [rail for rail in channel if rail.span[2] < rail.span[3]]
    costs = {(a, b): cost(a, b) for a in bent for b in bent}
    place: dict[Rail, int] = {}
    while waiting := [rail for rail in bent if rail not in place]:
        regret = {a: sum(max(0, costs[a, b] - costs[b, a]) for b in waiting) for a in waiting}
        rail = min(regret, key=regret.__getitem__)
        if any(costs[rail, other] >= NEVER for other in waiting):
            _split(rail, channel)
            return tracks(channel)
        _, _, low, high = rail.span
        near = [place[b] for b in place if b.span[2] - CLOSE <= high and low <= b.span[3] + CLOSE]
        place[rail] = max(near, default=-1) + 1
    flat = [rail.span[2] for rail in channel if rail not in place]
    number = sum(rail.span[2] < y < rail.span[3] for rail in bent for y in flat)
    number += sum(costs[a, b] for a in bent for b in bent if place[a] < place[b])
    return place, number


def _split(rail: Rail, channel: list[Rail]) -> None:
    """Lead a rail over two tracks, with a level between them that no other has."""
    taken = [y for other in channel for y in (*other.span[0], *other.span[1])]
    middle = way(0.0, -1)
    middle.y = (rail.span[2] + rail.span[3]) / 2
    while any(abs(middle.y - y) < CLOSE for y in taken):
        middle.y += CLOSE
    channel.append(Rail(rail.net, middle.sides[1], rail.right))
    rail.right = middle.sides[0]


def route(nets: list[Net], channels: Channels) -> int:
    """Lead the wires of `nets` through `channels`, back from each target; return how often they bend."""
    rails = {pin: rail for channel in channels for rail in channel for pin in rail.left + rail.right}
    for net in nets:
        net.paths = []
        for target in net.targets:
            ahead, pin = target.box.layer > net.source.box.layer, target
            path = [(pin.box.x, pin.y)]
            while pin is not net.source:
                rail, old = rails[pin], pin
                if net.source in rail.left:
                    pin = net.source
                else:
                    pin = rail.left[0] if ahead else next(p for p in rail.right if not p.box.width)
                path += [(rail.x, old.y), (rail.x, pin.y)]
                pin = pin if pin is net.source else pin.box.sides[not ahead][0]
            net.paths.append(_simplified([*path, (pin.box.x + pin.box.width, pin.y)])[::-1])
    return sum(len(path) - 2 for net in nets for path in net.paths)


def _simplified(path: list[Point]) -> list[Point]:
    """Return a path without points in the middle of straight lines."""
    found: list[Point] = []
    for p in path:
        if len(found) > 1 and any(found[-2][i] == found[-1][i] == p[i] for i in (0, 1)):
            found[-1] = p
        elif found[-1:] != [p]:
            found.append(p)
    return found
