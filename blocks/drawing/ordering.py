"""The order of boxes in each layer, and of pins on their sides: few crossings, by sweeps and swaps.

Heights are ranks here: pins of a box are 1 apart, whatever they will be on paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

from trussflow.blocks.drawing.graph import Box, Channels, Pin, Rail, Span

Sides = tuple[list[Rail], ...]
SWEEPS = 12
SWAPS = 20
"""So often at most: heights of rails with many pins change with each swap, and it may turn in circles."""


def cuts(a: Span, b: Span) -> int:
    """Return how often rails cross if the vertical of `a` stands left of that of `b`."""
    number = 0
    for y in a[1]:
        number += b[2] < y < b[3]
    for y in b[0]:
        number += a[2] < y < a[3]
    return number


def crossings(some: list[Rail], others: list[Rail]) -> int:
    """Return how often `some` rails cross `others` of their channel, each pair in its better order."""
    number = 0
    for one in some:
        a = one.span
        for other in others:
            b = other.span
            if a[3] > b[2] and b[3] > a[2] and one is not other:
                number += min(cuts(a, b), cuts(b, a))
    return number


class Ordering:
    """Layers, which are sorted in place, as are the sides of their boxes.

    Parameters
    ----------
    layers : list of list of Box
        The boxes, from the left.
    channels : Channels
        What joins them.
    """

    def __init__(self, layers: list[list[Box]], channels: Channels) -> None:
        self.layers, self.channels = layers, channels
        self.rails = {pin: rail for channel in channels for rail in channel for pin in rail.left + rail.right}
        self.sides: dict[Box, Sides] = {b: tuple(map(self._rails, b.sides)) for la in layers for b in la}

    def _rails(self, pins: Iterable[Pin]) -> list[Rail]:
        return list(dict.fromkeys(self.rails[pin] for pin in pins if pin in self.rails))

    def sort(self) -> None:
        """Sweep to and fro, keep the best order, and swap neighbours in it."""
        sorts: list[list[Any]] = [*self.layers, *(side for box in self.sides for side in box.sides)]
        best, found = math.inf, sorts
        for layer in self.layers:
            rank(layer)
        for turn in range(SWEEPS):
            if turn:
                self._sweep(turn % 2)
            self._measure()
            number = sum(crossings([a], c[:i]) for c in self.channels for i, a in enumerate(c))
            if number < best:
                best, found = number, [list(items) for items in sorts]
        for items, kept in zip(sorts, found, strict=True):
            items[:] = kept
        for layer in self.layers:
            rank(layer)
        self.swap()

    def _measure(self) -> None:
        for channel in self.channels:
            for rail in channel:
                rail.measure(ranked=True)

    def _sweep(self, side: int) -> None:
        """Sort by what is wired to right sides (1), from the right, or to left sides (0), from the left."""
        for layer in reversed(self.layers) if side else self.layers:
            wanted = {box: self._wanted(box, side) for box in layer}
            layer.sort(key=wanted.__getitem__)
            for box in layer:
                if not box.fixed:
                    box.sides[side].sort(key=self._drawn_to)
            rank(layer)

    def _wanted(self, box: Box, side: int) -> float:
        """Return where the pins of one side want a box to be, or those of the other, or where it is."""
        for pins in (box.sides[side], box.sides[1 - side]):
            if shifts := [self._drawn_to(pin) - (pin.rank - box.rank) for pin in pins if pin in self.rails]:
                return sum(shifts) / len(shifts)
        return box.rank

    def _drawn_to(self, pin: Pin) -> float:
        """Return the mean height of what a pin is wired to, across the channel if there is any."""
        rail = self.rails.get(pin)
        if rail is None:
            return pin.rank
        facing, beside = (rail.left, rail.right) if pin in rail.right else (rail.right, rail.left)
        others = [p.rank for p in facing or beside if p.box is not pin.box]
        return sum(others) / len(others) if others else pin.rank

    def swap(self) -> None:
        """Swap neighbours, boxes and pins, wherever that saves crossings."""
        self._measure()
        for _ in range(SWAPS):
            swapped = False
            for layer in self.layers:
                swapped |= self._swap(layer, self.sides.__getitem__, exchange)
                for side in (side for box in layer if not box.fixed for side in box.sides):
                    swapped |= self._swap(side, lambda pin: (self._rails([pin]),), flip)
            if not swapped:
                break
        for side in (side for box in self.sides for side in box.sides):
            for pin, dy in zip(side, sorted(pin.dy for pin in side), strict=True):
                pin.dy = dy

    def _swap(
        self, items: list[Any], rails: Callable[[Any], Sides], exchanged: Callable[[Any, Any], None]
    ) -> bool:
        swapped = False
        for i, _ in enumerate(pairwise(items)):
            upper, lower = items[i : i + 2]
            some, others = rails(upper), rails(lower)
            before = sum(map(crossings, some, others))
            for a, b in ((upper, lower), (lower, upper)) if before else ():
                exchanged(a, b)
                items[i : i + 2] = b, a
                for rail in (rail for side in some + others for rail in side):
                    rail.measure(ranked=True)
                if sum(map(crossings, some, others)) < before:
                    swapped = True
                    break
        return swapped


def extent(box: Box) -> float:
    """Return how many ranks a box takes."""
    return max(1, *map(len, box.sides)) + 1


def rank(layer: list[Box]) -> None:
    """Put boxes one below the other, around 0."""
    y = -sum(map(extent, layer)) / 2
    for box in layer:
        box.rank, y = y, y + extent(box)
        for side in box.sides:
            for i, pin in enumerate(side):
                pin.rank = box.rank + i


def exchange(upper: Box, lower: Box) -> None:
    """Exchange the ranks of neighbours, which are `upper` and `lower` before."""
    for box, shift in ((upper, extent(lower)), (lower, -extent(upper))):
        box.rank += shift
        for pin in box.sides[0] + box.sides[1]:
            pin.rank += shift


def flip(upper: Pin, lower: Pin) -> None:
    """Exchange the ranks of two pins, `upper` and `lower` before."""
    upper.rank, lower.rank = lower.rank, upper.rank
