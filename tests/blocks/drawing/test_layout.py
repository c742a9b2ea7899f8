"""Laws of every picture: nothing overlaps, every wire ends where it should, no oracle needed."""

from itertools import combinations, pairwise
from random import Random

import campaign
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.blocks.drawing.graph import JUNCTION_LEAD, JUNCTION_SIZE, Box, Net, Rail
from trussflow.blocks.drawing.layout import layout
from trussflow.blocks.drawing.routing import route, tracks

BOX_HEAD, PIN_PITCH = 34.0, 18.0
MORE_CROSSINGS, MORE_BENDS = 1, 1.2
"""Limits: so many crossings more, and so many times as many bends, as elkjs has."""


def scattered(number, density=1.6, back=0.1, seed=None):
    """Return boxes wired to some that come shortly before them, and at times to any."""
    chance = Random(number if seed is None else seed)
    inputs, outputs = ([chance.randint(1, 3) for _ in range(number)] for _ in range(2))
    boxes = [
        Box(80.0, BOX_HEAD + PIN_PITCH * max(pins))
        for pins in zip(inputs, outputs, strict=True)
    ]
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
            nets[pin] = Net(
                boxes[source].pin(1, BOX_HEAD + PIN_PITCH * (pin[1] + 0.5)), []
            )
        nets[pin].targets.append(boxes[i].pin(0, BOX_HEAD + PIN_PITCH * (k + 0.5)))
    for side in (side for box in boxes for side in box.sides):
        side.sort(key=lambda pin: pin.dy)
    return boxes, list(nets.values())


def lines(net):
    return [line for path in net.paths for line in pairwise(path)]


def overlap(a, b):
    """Tell whether two lines lie upon each other along more than a point."""
    (p, q), (r, s) = sorted(a), sorted(b)
    return any(
        p[i] == q[i] == r[i] == s[i]
        and max(p[1 - i], r[1 - i]) < min(q[1 - i], s[1 - i])
        for i in (0, 1)
    )


def check_laws(boxes, nets, width, height):
    """Check all that holds of every picture."""
    for box in boxes:
        assert 0 <= box.x <= width - box.width + 1e-9
        assert 0 <= box.y <= height - box.height + 1e-9
    for a, b in combinations(boxes, 2):
        assert (
            a.x + a.width <= b.x
            or b.x + b.width <= a.x
            or a.y + a.height <= b.y
            or b.y + b.height <= a.y
        )
    for net in nets:
        source = (net.source.box.x + net.source.box.width, net.source.y)
        for path, pin in zip(net.paths, net.targets, strict=True):
            assert path[0] == source
            # level or upright
            assert all((p[0] == q[0]) != (p[1] == q[1]) for p, q in pairwise(path))
            assert path[1][0] > path[0][0]  # leaves to the right
            if pin.entry:  # ends at the top or bottom of the circle
                low = pin.box.y + pin.box.height / 2 + pin.entry * JUNCTION_SIZE / 2
                assert path[-1] == (pin.box.x + JUNCTION_SIZE / 2, low)
                assert (path[-2][1] - path[-1][1]) * pin.entry > 0
            else:
                assert path[-1] == (pin.box.x, pin.y)
                assert path[-2][0] < path[-1][0]  # and comes from the left
    for start, end in (line for net in nets for line in lines(net)):
        (x1, x2), (y1, y2) = sorted((start[0], end[0])), sorted((start[1], end[1]))
        for box in boxes:
            lead = JUNCTION_LEAD if box.junction else 0.0
            if any(pin.entry for pin in box.sides[0]):
                lead = (box.height - JUNCTION_SIZE) / 2
            beside = (
                x2 <= box.x
                or box.x + box.width <= x1
                or y2 <= box.y + lead
                or box.y + box.height - lead <= y1
            )
            assert beside, "a wire runs through a box"
    for one, other in combinations(nets, 2):
        shared = [(p, q) for p in lines(one) for q in lines(other) if overlap(p, q)]
        assert not shared, "wires of two sources share a segment"


@given(st.integers(0, 10**6), st.integers(1, 12), st.floats(0.0, 3.0))
def test_laws_hold(seed, number, wires):
    boxes, nets = scattered(number, wires, seed=seed)
    chance = Random(seed)
    for box in boxes:
        box.width = chance.choice([40.0, 80.0, 160.0])
        for pin in box.sides[0]:
            pin.note = chance.choice([0.0, 20.0])
        inputs, outputs = box.sides
        if chance.random() < 0.4 and len(inputs) > 1 and len(outputs) < 2:
            box.junction, box.width, box.height = True, JUNCTION_SIZE, 70.0
            for pin in outputs:
                pin.dy = 35.0
    size = layout(boxes, nets)
    check_laws(boxes, nets, *size)
    source = {pin: net.source.box for net in nets for pin in net.targets}
    for net in nets:
        for (x1, y), (x2, _) in lines(net):
            if x2 < x1:  # feedback is below all boxes that it passes
                passed = [b for b in boxes if x2 < b.x and b.x + b.width < x1]
                assert all(b.y + b.height <= y for b in passed)
    for box in boxes:
        if box.junction:
            for pin in box.sides[0]:
                # feedback to a sum is below its other inputs
                back = source.get(pin, box).layer >= box.layer
                assert not back or pin.entry >= 0
            # one wire at each of its sides, or all at the left
            entries = sorted(pin.entry for pin in box.sides[0])
            assert len(set(entries)) == len(entries) or not any(entries)


GRAPHS = [
    (scattered(10), 0, 14),
    (scattered(20), 2, 36),
    (scattered(40), 43, 102),
    (scattered(100, 1.3, 0.05), 43, 174),
    campaign.only(scattered(200, 1.3, 0.05), 97, 310),
]
"""Boxes and nets, and the crossings and bends in the picture of elkjs, a layout engine of many tools.

Version 0.12.1 with ``elk.algorithm: layered``, ``elk.edgeRouting: ORTHOGONAL``, ports free to be sorted.
"""


def crossings_and_bends(nets):
    """Return at how many points wires of different nets cross, and how often wires turn."""
    level, upright = [], []
    for number, net in enumerate(nets):
        for (x, y), (x2, y2) in lines(net):
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


@pytest.mark.parametrize("graph, crossings, bends", GRAPHS)
def test_hardly_more_crossings_and_bends_than_elkjs_draws(graph, crossings, bends):
    boxes, nets = graph
    size = layout(boxes, nets)
    check_laws(boxes, nets, *size)
    own = crossings_and_bends(nets)
    assert own[0] <= crossings + MORE_CROSSINGS
    assert own[1] <= MORE_BENDS * bends


def wired(*pairs):
    """Return nets from box to box, each to a new pin in the middle."""
    return [
        Net(a.pin(1, a.height / 2), [b.pin(0, b.height / 2) for b in targets])
        for a, *targets in pairs
    ]


def junction():
    return Box(JUNCTION_SIZE, 54.0, junction=True)


def test_parallel_wires_between_two_boxes_are_straight():
    a, b = Box(50.0, 100.0), Box(50.0, 100.0)
    nets = [Net(a.pin(1, 20.0 + 18 * i), [b.pin(0, 40.0 + 18 * i)]) for i in range(3)]
    layout([a, b], nets)
    assert all(len(path) == 2 for net in nets for path in net.paths)
    assert a.x < b.x


@pytest.mark.parametrize("first", [0, 1])
def test_negative_input_of_a_sum_is_its_feedback(first):
    """If both sums of a loop have an input, the sum of the subtracted signal comes first."""
    sums, others = [junction(), junction()], [Box(50.0, 40.0) for _ in range(3)]
    (a, b), (c, *sources) = sums, others
    nets = wired((a, b), (b, c), (c, a), (sources[0], a), (sources[1], b))
    back = nets[2 * (1 - first)].targets[0]
    back.negative = True
    layout([*sums, *others], nets)
    assert sums[first].x < sums[1 - first].x
    assert back.entry == 1  # from below


@pytest.mark.parametrize("number, total, end", [(6, 1, 5), (5, 2, 3)])
def test_signals_run_on_at_one_height_and_feedback_is_below(number, total, end):
    """A chain with feedback from a box to a sum is level and in order."""
    boxes = [Box(50.0, 40.0) for _ in range(number)]
    boxes[total] = junction()
    nets = wired(*pairwise(boxes))
    if end == number - 1:
        nets += wired((boxes[end], boxes[total]))
    else:
        nets[end].targets.append(boxes[total].pin(0, 40.0))
    layout(boxes[::-1], nets)
    back = nets[end].paths[-1]
    assert [box.x for box in boxes] == sorted(box.x for box in boxes)
    chained = nets[: number - 1]
    assert len({p.y for net in chained for p in (net.source, net.targets[0])}) == 1
    assert max(y for _, y in back) > max(
        box.y + box.height for box in boxes if not box.junction
    )
    # straight up into the sum
    assert back[-1][0] == back[-2][0]
    assert len(back) == 5


def test_feedback_does_not_rise_through_a_box_below_a_sum():
    """Two sums in one layer, each with feedback that passes below both."""
    sums, plants = [junction(), junction()], [Box(50.0, 40.0), Box(50.0, 40.0)]
    boxes = [Box(50.0, 40.0), *sums, *plants]
    pairs = zip(sums, plants, strict=True)
    nets = wired(boxes[:3], *(wire for a, b in pairs for wire in ((a, b), (b, a))))
    check_laws(boxes, nets, *layout(boxes, nets))


def test_box_in_the_feedback_is_beside_its_first_source():
    """An observer of command and motion, whose estimate goes back, makes the picture no wider."""
    boxes = [Box(60.0, 60.0) for _ in range(5)]
    law, plant, observer, source, drive = boxes
    nets = wired(
        (source, law),
        (law, drive, observer),
        (drive, plant),
        (plant, law, observer),
        (observer, law),
    )
    for box in boxes:
        for i, pin in enumerate(box.sides[0]):
            pin.dy = 15.0 * (i + 1)
    size = layout(boxes, nets)
    assert source.x < law.x < drive.x < plant.x
    assert observer.x == drive.x
    check_laws(boxes, nets, *size)


def test_crossed_levels_are_led_over_two_tracks():
    """Two wires end at the heights at which the other begins, so neither vertical can be first."""
    boxes = [
        Box(40.0, 40.0, layer=i // 2, x=i // 2 * 100.0, y=i % 2 * 100.0)
        for i in range(4)
    ]
    a, b, c, d = boxes
    nets = [
        Net(a.pin(1, 20.0), [d.pin(0, 20.0)]),
        Net(b.pin(1, 20.0), [c.pin(0, 20.0)]),
    ]
    channel = [Rail(net, [net.source], net.targets) for net in nets]
    for rail, place in tracks(channel).items():
        rail.x = 50.0 + 10.0 * place
    assert route(nets, [[], channel, []]) == 4 + 2
    check_laws(boxes, nets, 140.0, 140.0)
