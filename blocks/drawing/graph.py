"""What is laid out: boxes with pins on their sides, and nets from one pin to others."""

from __future__ import annotations

from dataclasses import dataclass, field

Point = tuple[float, float]

Span = tuple[list[float], list[float], float, float]
"""Heights of a rail's pins left and right, and of its upper and lower end."""


@dataclass(eq=False, slots=True)
class Pin:
    """Where a wire ends at a box: on its left side if it is an input, on its right side otherwise.

    Attributes
    ----------
    box : Box
        The box.
    dy : float
        How far below its upper edge [px].
    note : float
        Width of what is written beside it [px].
    rank : float
        Where it is while the order is sought [-].
    """

    box: Box
    dy: float
    note: float = 0.0
    rank: float = 0.0

    @property
    def y(self) -> float:
        """Its height in the picture [px]."""
        return self.box.y + self.dy


@dataclass(eq=False, slots=True)
class Box:
    """A rectangle in a layer; one without width is where a net passes.

    Attributes
    ----------
    width, height : float
        Size [px].
    edge : int
        -1: it belongs to the left edge of the picture, 1: to the right one, 0: anywhere [-].
    fixed : bool
        Whether its pins stay in their order.
    sides : tuple of list of Pin
        Its inputs, and its outputs.
    layer : int
        Its column [-].
    x, y : float
        Left upper corner [px].
    rank : float
        Where it is while the order is sought [-].
    """

    width: float
    height: float
    edge: int = 0
    fixed: bool = False
    sides: tuple[list[Pin], list[Pin]] = field(default_factory=lambda: ([], []))
    layer: int = 0
    x: float = 0.0
    y: float = 0.0
    rank: float = 0.0

    def pin(self, side: int, dy: float, note: float = 0.0) -> Pin:
        """Add a pin on the left `side` (0) or the right (1), `dy` below the upper edge; `note` [px]."""
        self.sides[side].append(Pin(self, dy, note))
        return self.sides[side][-1]


@dataclass(eq=False, slots=True)
class Net:
    """What the output at the pin `source` feeds: its `targets`, and the `paths` of the wires [px]."""

    source: Pin
    targets: list[Pin]
    paths: list[list[Point]] = field(default_factory=list)


@dataclass(eq=False, slots=True)
class Rail:
    """The part of a `net` in the channel between two layers: its pins `left` and `right`, joined at `x` [px].

    Its `span` was measured last in ranks [-] or on paper [px].
    """

    net: Net
    left: list[Pin]
    right: list[Pin]
    x: float = 0.0
    span: Span = ([], [], 0.0, 0.0)

    def measure(self, *, ranked: bool) -> None:
        """Note where its pins and its ends are, in ranks if `ranked`."""
        left, right = ([p.rank if ranked else p.y for p in pins] for pins in (self.left, self.right))
        self.span = left, right, min(left + right), max(left + right)


def way(height: float, layer: int) -> Box:
    """Return a place where a net passes through a `layer`, of some `height` [px]."""
    box = Box(0.0, height, layer=layer)
    box.pin(0, height / 2)
    box.pin(1, height / 2)
    return box


Channels = list[list[Rail]]
"""The rails before each layer, and behind the last one."""
