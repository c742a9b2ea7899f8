"""Graph to lay out: boxes with pins on their sides, and nets from one pin to others."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

Point = tuple[float, float]

Span = tuple[list[float], list[float], float, float]
"""Heights of the left and right pins of a rail, and of its upper and lower end."""

JUNCTION_SIZE = 30.0
"""Diameter of a junction [px]."""

JUNCTION_LEAD = 14.0
"""Height above and below a junction, in which wires turn to its top and bottom [px]."""

JUNCTION_PITCH = 14.0
"""Distance of the pins of a junction that all are on its left [px]."""


@dataclass(eq=False, slots=True)
class Pin:
    """End of a wire at a box: an input on the left side, an output on the right side.

    Attributes
    ----------
    box : Box
        The box.
    side : int
        0 for an input, 1 for an output [-].
    dy : float
        Distance below the upper edge of the box [px].
    note : float
        Width of the text next to the pin [px].
    inset : float
        Distance of the drawn outline from the side of the box [px].
    entry : int
        -1 for a wire that enters a junction at its top, 1 at its bottom, 0 at its side [-].
    negative : bool
        Whether the signal is subtracted.
    last : bool
        Whether the pin is the lowest of its side, for feedback to a junction.
    rank : float
        Vertical position during the ordering [-].
    """

    box: Box
    side: int
    dy: float
    note: float = 0.0
    inset: float = 0.0
    entry: int = 0
    negative: bool = False
    last: bool = False
    rank: float = 0.0

    @property
    def x(self) -> float:
        """Horizontal position in the picture [px]."""
        return self.box.x + (self.box.width - self.inset if self.side else self.inset)

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
    junction : bool
        Whether it is a circle at the left of the box, such as a summing junction.
    back : bool
        Whether it is a dummy node of feedback.
    sides : tuple of list of Pin
        Input pins and output pins.
    layer : int
        Index of the column [-].
    x, y : float
        Left upper corner [px].
    rank : float
        Vertical position during the ordering [-].
    floor : float
        Upper edge of the next box below in the layer [px].
    """

    width: float
    height: float
    edge: int = 0
    junction: bool = False
    back: bool = False
    sides: tuple[list[Pin], list[Pin]] = field(default_factory=lambda: ([], []))
    layer: int = 0
    x: float = 0.0
    y: float = 0.0
    rank: float = 0.0
    floor: float = math.inf

    def pin(self, side: int, dy: float, note: float = 0.0, inset: float = 0.0) -> Pin:
        """Add a pin on the left `side` (0) or the right (1); return it.

        Parameters
        ----------
        side : int
            Side of the box [-].
        dy, note, inset : float
            Place, width of its text, and distance of the outline, as for `Pin` [px].
        """
        self.sides[side].append(Pin(self, side, dy, note, inset))
        return self.sides[side][-1]

    def join(self, main: Pin) -> None:
        """Let the wires of a junction enter: `main` at the left, one before it at the top, one after it below."""
        pins = self.sides[0]
        place, middle = pins.index(main), self.height / 2
        around = place < 2 and len(pins) - place < 3
        for i, pin in enumerate(pins):
            pin.entry = i - place if around else 0
            if around:
                pin.dy = middle + pin.entry * (middle - 2.0)
            else:
                pin.dy = middle + (i - (len(pins) - 1) / 2) * JUNCTION_PITCH


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
