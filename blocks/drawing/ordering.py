"""Order of boxes in each layer, and of pins on their sides, with few crossings, by sweeps.

Vertical positions are ranks: pins of a box have the distance 1, regardless of that in the picture.
"""

from __future__ import annotations

import math
from itertools import combinations
from statistics import median
from typing import Any

from trussflow.blocks.drawing.graph import Box, Channels, Pin, Rail, Span, rails_by_pin

MAX_SWEEPS = 12
"""Number of sweeps, after which the best order is taken."""


def cuts(a: Span, b: Span) -> int:
    """Return the number of crossings of two rails if the vertical of `a` is left of that of `b`."""
    number = 0
    # Wires leave the vertical of `a` to the right and cross the vertical of `b`; wires
    # reach `b` from the left and cross the vertical of `a`.
    for y in a[1]:
        number += b[2] < y < b[3]
    for y in b[0]:
        number += a[2] < y < a[3]
    return number


def crossings(channel: list[Rail]) -> int:
    """Return the crossings of the rails of a channel, each pair in its better order."""
    number = 0
    for a, b in combinations([rail.span for rail in channel], 2):
        # Verticals without common heights do not cross. Tracks are chosen later, so
        # that the better order of two is assumed.
        if a[3] > b[2] and b[3] > a[2]:
            number += min(cuts(a, b), cuts(b, a))
    return number


class Ordering:
    """Ordering of layers and of the sides of their boxes, in place.

    Parameters
    ----------
    layers : list of list of Box
        The layers, from the left.
    channels : Channels
        Rails between the layers.
    """

    def __init__(self, layers: list[list[Box]], channels: Channels) -> None:
        self.layers = layers
        self.channels = channels
        self.rails = rails_by_pin(channels)

    def sort(self) -> None:
        """Sweep in both directions, and select the best order."""
        sides = [side for la in self.layers for box in la for side in box.sides]
        sorts: list[list[Any]] = [*self.layers, *sides]
        # Sugiyama, step 4: crossing reduction. Turn 0 counts the initial order.
        best, found = math.inf, sorts
        for layer in self.layers:
            rank(layer)
        for turn in range(MAX_SWEEPS):
            if turn:
                self._sweep(turn % 2)
            for rail in self.rails.values():
                rail.measure(ranked=True)
            number = sum(map(crossings, self.channels))
            if number < best:
                best, found = number, [list(items) for items in sorts]
        for items, kept in zip(sorts, found, strict=True):
            items[:] = kept
        for side in sides:
            # The places on a side stay, in the new order of the pins.
            for pin, dy in zip(side, sorted(pin.dy for pin in side), strict=True):
                pin.dy = dy

    def _sweep(self, side: int) -> None:
        """Sort by the neighbours of right sides (1), from the right, or of left sides (0), from the left."""
        for layer in reversed(self.layers) if side else self.layers:
            wanted = {box: self._wanted(box, side) for box in layer}
            # Feedback runs below. The sort is stable: boxes with equal medians keep
            # their order.
            layer.sort(key=lambda box: (box.back, wanted[box]))
            for box in layer:
                box.sides[side].sort(key=lambda pin: (pin.last, self._drawn_to(pin)))
            # Now, as the next layer is sorted by the new positions.
            rank(layer)

    def _wanted(self, box: Box, side: int) -> float:
        """Return the median position of a box for straight wires at one side, or the other, or its own."""
        for pins in (box.sides[side], box.sides[1 - side]):
            if shifts := [
                # Position of the box with this pin level with its ends.
                self._drawn_to(pin) - (pin.rank - box.rank)
                for pin in pins
                if pin in self.rails
            ]:
                return median(shifts)
        return box.rank

    def _drawn_to(self, pin: Pin) -> float:
        """Return the mean rank of the pins connected to a pin, those across the channel if there are any."""
        rail = self.rails.get(pin)
        if rail is None:
            return pin.rank
        facing, beside = (
            (rail.left, rail.right) if pin in rail.right else (rail.right, rail.left)
        )
        others = [p.rank for p in facing or beside if p.box is not pin.box]
        return sum(others) / len(others) if others else pin.rank


def extent(box: Box) -> float:
    """Return the height of a box in ranks."""
    return max(1, *map(len, box.sides)) + 1


def rank(layer: list[Box]) -> None:
    """Set the ranks of the boxes of a layer one below the other, centred at 0."""
    y = -sum(map(extent, layer)) / 2
    for box in layer:
        box.rank, y = y, y + extent(box)
        for side in box.sides:
            for i, pin in enumerate(side):
                pin.rank = box.rank + i
