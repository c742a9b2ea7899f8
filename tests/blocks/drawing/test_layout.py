"""Laws of every picture: nothing overlaps, every wire ends where it should, no oracle needed."""

import time
from itertools import combinations, pairwise
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.blocks.drawing.graph import Box, Net, Rail
from trussflow.blocks.drawing.layout import layout
from trussflow.blocks.drawing.routing import NEVER, route, tracks

GENEROUS = 20.0
"""What a picture of 200 blocks may take on a busy machine [s]; it takes one."""

Line = tuple[tuple[float, float], tuple[float, float]]


def random_graph(seed, number, wires):
    """Return boxes with up to four pins on each side, wired mostly forwards."""
    chance = Random(seed)
    boxes = [Box(chance.choice([40.0, 80.0, 160.0]), 0.0) for _ in range(number)]
    nets = []
    for box in boxes:
        pins = [chance.randint(0, 4), chance.randint(0, 4)]
        box.height = 40.0 + 18.0 * max(pins)
        box.fixed = chance.random() < 0.2
        for side in (0, 1):
            for i in range(pins[side]):
                box.pin(side, 49.0 + 18.0 * i, note=chance.choice([0.0, 20.0]) if side == 0 else 0.0)
        nets += [Net(pin, []) for pin in box.sides[1]]
    for i, box in enumerate(boxes):
        for pin in box.sides[0]:
            near = [net for net in nets if boxes.index(net.source.box) >= i - 5] or nets
            if near and chance.random() < wires:
                chance.choice(near if chance.random() < 0.9 else nets).targets.append(pin)
    return boxes, [net for net in nets if net.targets]


def lines(net):
    return [line for path in net.paths for line in pairwise(path)]


def overlap(a, b):
    """Tell whether two lines lie upon each other along more than a point."""
    for i in (0, 1):
        same = a[0][i] == a[1][i] == b[0][i] == b[1][i]
        low = max(min(a[0][1 - i], a[1][1 - i]), min(b[0][1 - i], b[1][1 - i]))
        high = min(max(a[0][1 - i], a[1][1 - i]), max(b[0][1 - i], b[1][1 - i]))
        if same and low < high:
            return True
    return False


def check_laws(boxes, nets, width, height):
    """Check all that holds of every picture."""
    for box in boxes:
        assert 0 <= box.x <= width - box.width + 1e-9
        assert 0 <= box.y <= height - box.height + 1e-9
    for a, b in combinations(boxes, 2):
        assert a.x + a.width <= b.x or b.x + b.width <= a.x or a.y + a.height <= b.y or b.y + b.height <= a.y
    for net in nets:
        source = (net.source.box.x + net.source.box.width, net.source.y)
        for path, pin in zip(net.paths, net.targets, strict=True):
            assert path[0] == source
            assert path[-1] == (pin.box.x, pin.y)
            assert all((p[0] == q[0]) != (p[1] == q[1]) for p, q in pairwise(path))  # level or upright
            assert path[1][0] > path[0][0]  # leaves to the right
            assert path[-2][0] < path[-1][0]  # and comes from the left
    for start, end in (line for net in nets for line in lines(net)):
        (x1, x2), (y1, y2) = sorted((start[0], end[0])), sorted((start[1], end[1]))
        for box in boxes:
            beside = x2 <= box.x or box.x + box.width <= x1 or y2 <= box.y or box.y + box.height <= y1
            assert beside, "a wire runs through a box"
    for one, other in combinations(nets, 2):
        shared = [(p, q) for p in lines(one) for q in lines(other) if overlap(p, q)]
        assert not shared, "wires of two sources share a segment"


@given(st.integers(0, 10**6), st.integers(1, 12), st.floats(0.0, 1.0))
def test_laws_hold(seed, number, wires):
    boxes, nets = random_graph(seed, number, wires)
    check_laws(boxes, nets, *layout(boxes, nets))


@pytest.mark.parametrize("number", [50, pytest.param(200, marks=pytest.mark.campaign)])
def test_laws_hold_for_large_diagrams_in_good_time(number):
    boxes, nets = random_graph(1, number, 0.7)
    started = time.perf_counter()
    width, height = layout(boxes, nets)
    assert time.perf_counter() - started < GENEROUS
    check_laws(boxes, nets, width, height)


def test_parallel_wires_between_two_boxes_are_straight():
    a, b = Box(50.0, 100.0), Box(50.0, 100.0)
    nets = [Net(a.pin(1, 20.0 + 18 * i), [b.pin(0, 40.0 + 18 * i)]) for i in range(3)]
    layout([a, b], nets)
    assert all(len(path) == 2 for net in nets for path in net.paths)
    assert a.x < b.x


def test_feedback_goes_back_below():
    boxes = [Box(50.0, 60.0) for _ in range(3)]
    nets = [Net(a.pin(1, 30.0), [b.pin(0, 30.0)]) for a, b in zip(boxes, boxes[1:] + boxes[:1], strict=True)]
    layout(boxes, nets)
    assert boxes[0].x < boxes[1].x < boxes[2].x
    assert [len(net.paths[0]) for net in nets] == [2, 2, 6]
    assert max(y for _, y in nets[2].paths[0]) > 60.0


def test_crossed_levels_are_led_over_two_tracks():
    """Each wire has to end at the height at which the other begins: neither vertical can stand first."""
    boxes = [Box(40.0, 40.0, layer=i // 2, x=i // 2 * 100.0, y=i % 2 * 100.0) for i in range(4)]
    a, b, c, d = boxes
    nets = [Net(a.pin(1, 20.0), [d.pin(0, 20.0)]), Net(b.pin(1, 20.0), [c.pin(0, 20.0)])]
    channel = [Rail(net, [net.source], net.targets) for net in nets]
    places, crossings = tracks(channel)
    for rail, place in places.items():
        rail.x = 50.0 + 10.0 * place
    assert route(nets, [[], channel, []]) == 4 + 2
    assert crossings < NEVER
    check_laws(boxes, nets, 140.0, 140.0)
