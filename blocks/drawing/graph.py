"""Graph to lay out: boxes with pins on their sides, and nets from one pin to others."""

from __future__ import annotations

from dataclasses import dataclass, field

Point = tuple[float, float]

Span = tuple[list[float], list[float], float, float]
"""Heights of the left and right pins of a rail, and of its upper and lower end."""


@dataclass(eq=False, slots=True)
class Pin:
    """End of a wire at a box: an input on the left side, an output on the right side.

    Attributes
    ----------
    box : Box
        The box.
    dy : float
        Distance below the upper edge of the box [px].
    note : float
        Width of the text next to the pin [px].
    rank : float
        Vertical position during the ordering [-].
    """

    box: Box
    dy: float
    note: float = 0.0
    rank: float = 0.0

    @property
    def y(self) -> float:
        """Vertical position in the picture [px]."""
        return self.box.y + self.dy


@dataclass(eq=False, slots=True)
class Box:
    """A rectangle in a layer; a box without width is a dummy node of a net that passes the layer.

    Attributes
    ----------
    width, height : float
        Size [px].
    edge : int
        -1 for a box at the left edge of the picture, 1 at the right edge, 0 anywhere [-].
    sides : tuple of list of Pin
        Input pins and output pins.
    layer : int
        Index of the column [-].
    x, y : float
        Left upper corner [px].
    rank : float
        Vertical position during the ordering [-].
    """

    width: float
    height: float
    edge: int = 0
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
    """Wires from the pin `source` of an output to the pins `targets`, with their `paths` [px]."""

    source: Pin
    targets: list[Pin]
    paths: list[list[Point]] = field(default_factory=list)


@dataclass(eq=False, slots=True)
class Rail:
    """Part of a `net` in the channel between two layers: pins `left` and `right`, joined at `x` [px].

    The `span` is in ranks [-] or in the picture [px].
    """

    net: Net
    left: list[Pin]
    right: list[Pin]
    x: float = 0.0
    span: Span = ([], [], 0.0, 0.0)

    def measure(self, *, ranked: bool) -> None:
        """Store the vertical positions of the pins and ends, in ranks if `ranked`."""
        left, right = (
            [p.rank if ranked else p.y for p in pins]
            for pins in (self.left, self.right)
        )
        self.span = left, right, min(left + right), max(left + right)


def way(height: float, layer: int) -> Box:
    """Return a dummy node for a net that passes a `layer`, with a `height` [px]."""
    box = Box(0.0, height, layer=layer)
    box.pin(0, height / 2)
    box.pin(1, height / 2)
    return box


Channels = list[list[Rail]]
"""Rails before each layer, and after the last one."""


def rails_by_pin(channels: Channels) -> dict[Pin, Rail]:
    """Return the rail in `channels` to which each pin belongs."""
    rails = [rail for channel in channels for rail in channel]
    return {pin: rail for rail in rails for pin in rail.left + rail.right}
