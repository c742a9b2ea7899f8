"""Vertical placement of boxes, with as many straight wires as the order in the layers allows."""

from __future__ import annotations

from collections import Counter, deque
from itertools import pairwise
from statistics import median_low

from trussflow.blocks.drawing.graph import Box, Channels


class Placing:
    """Placement of boxes with minimum distances in each layer, and ties by straight wires.

    All constraints have the form y_b >= y_a + w; a straight wire is two of them.

    Parameters
    ----------
    layers : list of list of Box
        The layers from the left, each with its boxes from above.
    gap : float
        Distance between boxes [px].
    """

    def __init__(self, layers: list[list[Box]], gap: float) -> None:
        self.limits: dict[Box, list[tuple[Box, float]]] = {
            b: [] for layer in layers for b in layer
        }
        self.above: dict[Box, list[tuple[Box, float]]] = {
            box: [] for box in self.limits
        }
        self.tied = {box: [box] for box in self.limits}
        for layer in layers:
            layer[0].y = 0.0
            for upper, lower in pairwise(layer):
                distance = upper.height + (gap if upper.width or lower.width else 0.0)
                lower.y = upper.y + distance
                self.limits[upper].append((lower, distance))
                self.above[lower].append((upper, distance))

    def place(self, channels: Channels) -> None:
        """Straighten wires in `channels`, move boxes towards their neighbours, and all to the top."""
        self._straighten(channels)
        self._settle(channels)
        highest = min(box.y for box in self.limits)
        for box in self.limits:
            box.y -= highest

    def _straighten(self, channels: Channels) -> None:
        """Straighten wires, those through layers and those in bundles first."""
        weights = Counter[tuple[Box, Box, float]]()
        for channel in channels:
            for rail in channel:
                for a in rail.left:
                    for b in rail.right:
                        weights[a.box, b.box, a.dy - b.dy] += (
                            1 + (not a.box.width) + (not b.box.width)
                        )
        for (upper, lower, shift), _ in weights.most_common():
            self._tie(upper, lower, shift)

    def _tie(self, a: Box, b: Box, shift: float) -> None:
        """Tie b at `shift` below a, if no other constraint is violated."""
        if self.tied[a] is self.tied[b]:
            return
        old: dict[Box, float] = {}
        if self._lower(a, b, shift, old) and self._lower(b, a, -shift, old):
            self.limits[a].append((b, shift))
            self.limits[b].append((a, -shift))
            self.tied[a] += self.tied[b]
            for box in self.tied[b]:
                self.tied[box] = self.tied[a]
        else:
            for box, y in old.items():
                box.y = y

    def _lower(self, a: Box, b: Box, shift: float, old: dict[Box, float]) -> bool:
        """Move b at least `shift` below a, with the boxes that it pushes; return False if it pushes a."""
        if b.y >= a.y + shift:
            return True
        old.setdefault(b, b.y)
        b.y, waiting = a.y + shift, deque([b])
        while waiting:
            box = waiting.popleft()
            for other, distance in self.limits[box]:
                if other.y < box.y + distance:
                    if other is a:
                        return False
                    old.setdefault(other, other.y)
                    other.y = box.y + distance
                    waiting.append(other)
        return True

    def _settle(self, channels: Channels) -> None:
        """Move groups of tied boxes towards the median of their neighbours, as far as there is space."""
        wires: dict[Box, list[tuple[Box, float]]] = {box: [] for box in self.limits}
        for channel in channels:
            for rail in channel:
                for a in rail.left:
                    for b in rail.right:
                        wires[a.box].append((b.box, a.dy - b.dy))
                        wires[b.box].append((a.box, b.dy - a.dy))
        groups = list({id(group): group for group in self.tied.values()}.values())
        for turn in range(12):
            for group in groups if turn % 2 else reversed(groups):
                own = set(group)
                pulls = [
                    b.y - a.y - shift
                    for a in group
                    for b, shift in wires[a]
                    if b not in own
                ]
                room = [
                    b.y - a.y - distance
                    for a in group
                    for b, distance in self.limits[a]
                    if b not in own
                ]
                back = [
                    b.y + distance - a.y
                    for a in group
                    for b, distance in self.above[a]
                    if b not in own
                ]
                if pulls:
                    shift = max(
                        min([median_low(sorted(pulls)), *room]), max(back, default=-1e9)
                    )
                    for box in group:
                        box.y += shift
