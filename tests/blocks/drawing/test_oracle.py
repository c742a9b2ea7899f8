"""Pictures beside those of elkjs, a layout engine of many tools: hardly more crossings, hardly more bends.

What elkjs makes of the same boxes is kept here, so that the tests need no node: version 0.12.1 with
``elk.algorithm: layered``, ``elk.edgeRouting: ORTHOGONAL``, ports free to be sorted on their side.
"""

from collections.abc import Callable
from itertools import pairwise
from random import Random

import pytest

from trussflow.blocks.drawing.graph import Box, Net
from trussflow.blocks.drawing.layout import layout
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport, transport_diagram

HEAD, PITCH = 34.0, 18.0
MORE_CROSSINGS, MORE_BENDS = 1, 1.2
"""Than elkjs has: so many more, so many times as many."""

Graph = tuple[list[Box], list[Net]]


def wired(diagram):
    """Return boxes with a pin for each driver of each input, and one for each output."""
    drivers: dict[str, list[tuple[str, str, str]]] = {name: [] for name in diagram.blocks}
    for wire in diagram.wires:
        if wire.source is not None:
            drivers[wire.target.block.name].append(
                (wire.target.name, wire.source.block.name, wire.source.name)
            )
    boxes: dict[str, Box] = {}
    nets: dict[tuple[str, str], tuple[float, list[tuple[str, float]]]] = {}
    for name, block in diagram.blocks.items():
        inputs, outputs = ([port.name for port in ports] for ports in (block.inputs(), block.outputs()))
        drivers[name] = [
            driver for port in inputs for driver in dict.fromkeys(drivers[name]) if driver[0] == port
        ]
        rows = max(1, len(drivers[name]), len(outputs))
        letters = max([len(d[0]) for d in drivers[name]], default=0) + max(map(len, outputs), default=0)
        boxes[name] = Box(max(60.0, 6.0 * letters + 20.0, 7.0 * len(name) + 10.0), HEAD + PITCH * rows)
        for i, output in enumerate(outputs):
            nets[name, output] = HEAD + PITCH * (i + 0.5), []
    for name, found in drivers.items():
        for i, (_, block_name, output) in enumerate(found):
            nets[block_name, output][1].append((name, HEAD + PITCH * (i + 0.5)))
    return list(boxes.values()), [
        Net(boxes[name].pin(1, y), [boxes[target].pin(0, at) for target, at in targets])
        for (name, _), (y, targets) in nets.items()
        if targets
    ]


def scattered(number, density=1.6, back=0.1):
    """Return boxes wired to some that come shortly before them, and at times to any."""
    chance = Random(number)
    inputs, outputs = ([chance.randint(1, 3) for _ in range(number)] for _ in range(2))
    boxes = [Box(80.0, HEAD + PITCH * max(pins)) for pins in zip(inputs, outputs, strict=True)]
    nets: dict[tuple[int, int], Net] = {}
    free = [(i, k) for i in range(number) for k in range(inputs[i])]
    chance.shuffle(free)
    for i, k in free[: int(density * number)]:
        if chance.random() < back:
            source = chance.randrange(number)
        else:
            source = max(0, i - 1 - min(int(chance.expovariate(0.35)), i))
        if source == i and chance.random() < 0.9:
            continue
        pin = source, chance.randrange(outputs[source])
        if pin not in nets:
            nets[pin] = Net(boxes[source].pin(1, HEAD + PITCH * (pin[1] + 0.5)), [])
        nets[pin].targets.append(boxes[i].pin(0, HEAD + PITCH * (k + 0.5)))
    return boxes, list(nets.values())


def transport(hardware=None):
    return wired(transport_diagram(Mission.of_case(1), SpaceTruss.consistent(), hardware=hardware))


def mean_axes():
    return mean_axes_transport(Mission.of_case(1), SpaceTruss.consistent(), hardware=Hardware.flight())


GRAPHS: dict[str, tuple[Callable[[], Graph], int, int]] = {
    "transport": (lambda: wired(transport_diagram(Mission.of_case(1), SpaceTruss.published())), 1, 28),
    "mode-neutral": (transport, 1, 34),
    "hardware": (lambda: transport(hardware=Hardware.flight()), 2, 52),
    "mean axes": (lambda: wired(mean_axes()), 0, 30),
    "controller": (lambda: wired(mean_axes().controller), 1, 28),
    "10 boxes": (lambda: scattered(10), 0, 14),
    "20 boxes": (lambda: scattered(20), 2, 36),
    "40 boxes": (lambda: scattered(40), 43, 102),
    "100 boxes": (lambda: scattered(100, 1.3, 0.05), 43, 174),
    "200 boxes": (lambda: scattered(200, 1.3, 0.05), 97, 310),
}
"""What there is to draw, and how many crossings and bends elkjs draws it with."""


def crossings_and_bends(nets):
    """Return at how many points wires of different nets cross, and how often wires turn."""
    level, upright = [], []
    for number, net in enumerate(nets):
        for (x, y), (x2, y2) in (line for path in net.paths for line in pairwise(path)):
            if y == y2:
                level.append((number, y, *sorted((x, x2))))
            else:
                upright.append((number, x, *sorted((y, y2))))
    points = {
        (min(one, other), max(one, other), x, y)
        for one, y, left, right in level
        for other, x, low, high in upright
        if one != other and left < x < right and low < y < high
    }
    return len(points), sum(len(path) - 2 for net in nets for path in net.paths)


@pytest.mark.parametrize("name", GRAPHS)
def test_hardly_more_crossings_and_bends_than_elkjs_draws(name):
    make, crossings, bends = GRAPHS[name]
    boxes, nets = make()
    for side in (side for box in boxes for side in box.sides):
        side.sort(key=lambda pin: pin.dy)
    layout(boxes, nets)
    own = crossings_and_bends(nets)
    assert own[0] <= crossings + MORE_CROSSINGS
    assert own[1] <= MORE_BENDS * bends
