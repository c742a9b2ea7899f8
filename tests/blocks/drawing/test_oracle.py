"""Pictures beside those of elkjs, a layout engine of many tools: hardly more crossings, hardly more bends.

What elkjs makes of the same boxes is kept here, so that the tests need no node: version 0.12.1 with
``elk.algorithm: layered``, ``elk.edgeRouting: ORTHOGONAL``, ports free to be sorted on their side.
"""

from itertools import pairwise
from random import Random

import pytest

from trussflow.blocks.drawing.graph import Box, Net
from trussflow.blocks.drawing.layout import layout

HEAD, PITCH = 34.0, 18.0
MORE_CROSSINGS, MORE_BENDS = 1, 1.2
"""Than elkjs has: so many more, so many times as many."""


def scattered(number, density=1.6, back=0.1):
    """Return boxes wired to some that come shortly before them, and at times to any."""
    chance = Random(number)
    inputs, outputs = ([chance.randint(1, 3) for _ in range(number)] for _ in range(2))
    boxes = [Box(80.0, HEAD + PITCH * max(pins)) for pins in zip(inputs, outputs, strict=True)]
    nets = {}
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


GRAPHS = [
    (scattered(10), 0, 14),
    (scattered(20), 2, 36),
    (scattered(40), 43, 102),
    (scattered(100, 1.3, 0.05), 43, 174),
    pytest.param(scattered(200, 1.3, 0.05), 97, 310, marks=pytest.mark.campaign),
]
"""Boxes and nets, and the crossings and bends of elkjs."""


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


@pytest.mark.parametrize(("graph", "crossings", "bends"), GRAPHS)
def test_hardly_more_crossings_and_bends_than_elkjs_draws(graph, crossings, bends):
    boxes, nets = graph
    for side in (side for box in boxes for side in box.sides):
        side.sort(key=lambda pin: pin.dy)
    layout(boxes, nets)
    own = crossings_and_bends(nets)
    assert own[0] <= crossings + MORE_CROSSINGS
    assert own[1] <= MORE_BENDS * bends
