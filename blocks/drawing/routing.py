"""Routing: tracks of the vertical parts of wires in the channels between layers, and paths of wires."""

from __future__ import annotations

from trussflow.blocks.drawing.graph import (
    JUNCTION_SIZE,
    Channels,
    Net,
    Pin,
    Point,
    Rail,
    rails_by_pin,
    way,
)
from trussflow.blocks.drawing.ordering import cuts

OVERLAP_COST = 1000
"""Cost of the overlap of two wires [crossings]."""

HEIGHT_TOLERANCE = 4.0
"""Largest difference of two heights that appear equal [px]."""


def cost(a: Rail, b: Rail) -> int:
    """Return the cost of crossings and overlaps if `a` is left of `b`."""
    # A wire that leaves `a` to the right, at the height of one that reaches `b` from
    # the left, runs on top of it.
    same = a.net is not b.net and any(
        abs(y - z) < HEIGHT_TOLERANCE for y in a.span[1] for z in b.span[0]
    )
    return cuts(a.span, b.span) + OVERLAP_COST * same


def tracks(channel: list[Rail]) -> dict[Rail, int]:
    """Return the track of each vertical in a `channel`, from the left.

    If every remaining vertical would overlap another, one of them is split over two tracks.
    """
    for rail in channel:
        rail.measure(ranked=False)
    # Level wires have no vertical and need no track.
    bent = [rail for rail in channel if rail.span[2] < rail.span[3]]
    costs = {(a, b): cost(a, b) for a in bent for b in bent}
    place: dict[Rail, int] = {}
    while waiting := [rail for rail in bent if rail not in place]:
        # From the left: the vertical that costs least by being left of all others,
        # compared with being right of them.
        regret = {
            a: sum(max(0, costs[a, b] - costs[b, a]) for b in waiting) for a in waiting
        }
        rail = min(regret, key=regret.__getitem__)
        if any(costs[rail, other] >= OVERLAP_COST for other in waiting):
            _split(rail, channel)
            return tracks(channel)
        _, _, low, high = rail.span
        # The leftmost track on the right of those placed verticals that have common
        # heights with this one.
        near = [
            place[b]
            for b in place
            if b.span[2] - HEIGHT_TOLERANCE <= high
            and low <= b.span[3] + HEIGHT_TOLERANCE
        ]
        place[rail] = max(near, default=-1) + 1
    return place


def _split(rail: Rail, channel: list[Rail]) -> None:
    """Split a rail over two tracks, joined at a height that no other wire has."""
    taken = [y for other in channel for y in (*other.span[0], *other.span[1])]
    middle = way(0.0, -1)
    middle.y = (rail.span[2] + rail.span[3]) / 2
    while any(abs(middle.y - y) < HEIGHT_TOLERANCE for y in taken):
        middle.y += HEIGHT_TOLERANCE
    channel.append(Rail(rail.net, middle.sides[1], rail.right))
    rail.right = middle.sides[0]


def route(nets: list[Net], channels: Channels) -> int:
    """Route the wires of `nets` through `channels`, from each target back; return the number of bends."""
    rails = rails_by_pin(channels)
    for net in nets:
        net.paths = []
        for target in net.targets:
            # Forward wires pass dummy nodes from the left, feedback from the right.
            ahead, pin = target.box.layer > net.source.box.layer, target
            path = _entry(target)
            while pin is not net.source:
                rail, old = rails[pin], pin
                if net.source in rail.left:
                    pin = net.source
                else:
                    pin = (
                        rail.left[0]
                        if ahead
                        else next(p for p in rail.right if not p.box.width)
                    )
                path += [(rail.x, old.y), (rail.x, pin.y)]
                pin = pin if pin is net.source else pin.box.sides[not ahead][0]
            net.paths.append(
                _shortened(target, _simplified([*path, (pin.x, pin.y)]))[::-1]
            )
    return sum(len(path) - 2 for net in nets for path in net.paths)


def _entry(pin: Pin) -> list[Point]:
    """Return the end of the path to a pin, from the box: at the top or bottom of a junction with a turn."""
    if not pin.entry:
        return [(pin.x, pin.y)]
    middle = pin.box.x + JUNCTION_SIZE / 2
    end = pin.box.y + (pin.box.height + pin.entry * JUNCTION_SIZE) / 2
    return [(middle, end), (middle, pin.y)]


def _shortened(pin: Pin, path: list[Point]) -> list[Point]:
    """Return a path that does not pass under a junction and back to its bottom, if there is no box between."""
    if pin.entry > 0 and len(path) > 4:
        (x, y), (_, level), _, (_, low), (after, _) = path[:5]
        if after > x and level < low < pin.box.floor:
            return [(x, y), (x, low), *path[4:]]
    return path


def _simplified(path: list[Point]) -> list[Point]:
    """Return a path without intermediate points of straight lines."""
    found: list[Point] = []
    for p in path:
        if len(found) > 1 and any(found[-2][i] == found[-1][i] == p[i] for i in (0, 1)):
            found[-1] = p
        elif found[-1:] != [p]:
            found.append(p)
    return found
