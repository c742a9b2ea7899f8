"""Order of boxes in each layer, and of pins on their sides, with few crossings: sweeps and swaps.

Vertical positions are ranks: pins of a box have the distance 1, regardless of that in the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

from trussflow.blocks.drawing.graph import Box, Channels, Pin, Rail, Span

Sides = tuple[list[Rail], ...]
MAX_SWEEPS = 12
MAX_SWAP_ROUNDS = 20
"""Largest number of rounds of swaps, which may cycle as each swap changes the heights of rails."""


def cuts(a: Span, b: Span) -> int:
    """Return the number of crossings of two rails if the vertical of `a` is left of that of `b`."""
    number = 0
    for y in a[1]:
        number += b[2] < y < b[3]
    for y in b[0]:
        number += a[2] < y < a[3]
    return number


def crossings(some: list[Rail], others: list[Rail]) -> int:
    """Return the crossings of `some` rails with `others` of their channel, each pair in its better order."""
    number = 0
    for one in some:
        a = one.span
        for other in others:
            b = other.span
            if a[3] > b[2] and b[3] > a[2] and one is not other:
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
        self.layers, self.channels = layers, channels
        self.rails = {
            pin: rail
            for channel in channels
            for rail in channel
            for pin in rail.left + rail.right
        }
        self.sides: dict[Box, Sides] = {
            b: tuple(map(self._rails, b.sides)) for la in layers for b in la
        }

    def _rails(self, pins: Iterable[Pin]) -> list[Rail]:
        return list(dict.fromkeys(self.rails[pin] for pin in pins if pin in self.rails))

    def sort(self) -> None:
        """Sweep in both directions, select the best order, and swap neighbours in it."""
        sorts: list[list[Any]] = [
            *self.layers,
            *(side for box in self.sides for side in box.sides),
        ]
        best, found = math.inf, sorts
        for layer in self.layers:
            rank(layer)
        for turn in range(MAX_SWEEPS):
            if turn:
                self._sweep(turn % 2)
            self._measure()
            number = sum(
                crossings([a], c[:i]) for c in self.channels for i, a in enumerate(c)
            )
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
        """Sort by the neighbours of right sides (1), from the right, or of left sides (0), from the left."""
        for layer in reversed(self.layers) if side else self.layers:
            wanted = {box: self._wanted(box, side) for box in layer}
            layer.sort(key=wanted.__getitem__)
            for box in layer:
                if not box.fixed:
                    box.sides[side].sort(key=self._drawn_to)
            rank(layer)

    def _wanted(self, box: Box, side: int) -> float:
        """Return the mean position of a box for straight wires at one side, or the other, or its own."""
        for pins in (box.sides[side], box.sides[1 - side]):
            if shifts := [
                self._drawn_to(pin) - (pin.rank - box.rank)
                for pin in pins
                if pin in self.rails
            ]:
                return sum(shifts) / len(shifts)
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

    def swap(self) -> None:
        """Swap neighbouring boxes and pins if this reduces the number of crossings."""
        self._measure()
        for _ in range(MAX_SWAP_ROUNDS):
            swapped = False
            for layer in self.layers:
                swapped |= self._swap(layer, self.sides.__getitem__, exchange)
                for side in (
                    side for box in layer if not box.fixed for side in box.sides
                ):
                    swapped |= self._swap(side, lambda pin: (self._rails([pin]),), flip)
            if not swapped:
                break
        for side in (side for box in self.sides for side in box.sides):
            for pin, dy in zip(side, sorted(pin.dy for pin in side), strict=True):
                pin.dy = dy

    def _swap(
        self,
        items: list[Any],
        rails: Callable[[Any], Sides],
        exchanged: Callable[[Any, Any], None],
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


def exchange(upper: Box, lower: Box) -> None:
    """Exchange the ranks of two neighbours, `upper` and `lower` before the exchange."""
    for box, shift in ((upper, extent(lower)), (lower, -extent(upper))):
        box.rank += shift
        for pin in box.sides[0] + box.sides[1]:
            pin.rank += shift


def flip(upper: Pin, lower: Pin) -> None:
    """Exchange the ranks of two pins, `upper` and `lower` before the exchange."""
    upper.rank, lower.rank = lower.rank, upper.rank
