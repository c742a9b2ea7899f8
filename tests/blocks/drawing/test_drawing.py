"""Pictures of diagrams: texts, colours, hierarchy, files."""

import pickle
import re
import sys
import xml.etree.ElementTree as ET
from itertools import combinations
from math import dist
from types import SimpleNamespace

import numpy as np
import pytest
from systems import ring, series

from trussflow.blocks import (
    PID,
    Block,
    Constant,
    Diagram,
    Gain,
    Input,
    Integrator,
    MatrixGain,
    Output,
    Step,
    Sum,
    TransferFunction,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.drawing.scene import breadth
from trussflow.blocks.errors import DiagramError

LONG_NAME = "a_name_that_is_longer_than_any_picture_can_show_in_a_box"
SVG = "{http://www.w3.org/2000/svg}"


def nested(depth):
    """Return a chain of two gains, the second of which is such a chain, and so on."""
    diagram = Diagram("nested")
    gain = diagram.add(gain=Gain(2.0))
    if depth:
        inner = diagram.add(inner=nested(depth - 1))
        gain >> inner.u
    diagram.expose(u=gain.u, y=inner.y if depth else gain.y)
    return diagram


def mixed():
    """Return a diagram with slices on both sides, a fan-out, long names, grounded and open inputs."""
    diagram = Diagram("mixed <&>")
    plant, ones = diagram.add(plant=MatrixGain(np.eye(4)), ones=Constant(np.ones(2)))
    long = diagram.add(LONG_NAME, Integrator(shape=2))
    plant.y[:2] >> long.u
    ones >> plant.u[0:2]
    diagram.ground(plant.u[2])
    for i in range(20):
        plant.y[i % 4] >> diagram.add(f"gain_{i}", Gain(1.0)).u
    diagram.add(alone=Gain(1.0), slow=ZeroOrderHold(0.5), fast=UnitDelay(0.1))
    diagram.add(inner=nested(2))
    diagram.gain_0.y >> diagram.inner.u
    diagram.expose(shown=long.y)
    return diagram


EDGE_MARGIN = 12.0
"""Margin around a picture [px]."""

SIZES = {"name": 12.0, "note": 9.0}
"""Sizes of letters by class; others have 11 px."""


def texts(element, x=0.0, y=0.0):
    """Yield the texts in an SVG element with the rectangles that they fill [px]."""
    shift = re.match(
        r"translate\(([-\d.e]+),([-\d.e]+)\)", element.get("transform", "")
    )
    if shift:
        x, y = x + float(shift[1]), y + float(shift[2])
    if element.tag == f"{SVG}text":
        title = element.find(f"{SVG}title")
        text = "".join(element.itertext())
        if title is not None:
            text = text.removeprefix(title.text)
        kinds = element.get("class", "").split()
        size = min([11.0, *(SIZES[kind] for kind in kinds if kind in SIZES)])
        width = breadth(text) * size / 11
        left = x + float(element.get("x"))
        left -= {"end": 1.0, "middle": 0.5}.get(kinds[-1] if kinds else "", 0.0) * width
        low = y + float(element.get("y")) + float(element.get("dy", 0.0))
        yield text, (left, low - 0.7 * size, left + width, low)
    for child in element:
        yield from texts(child, x, y)


def test_no_two_texts_overlap_and_all_are_in_the_picture():
    diagram = mixed()
    a, b = diagram.gain_3, diagram.gain_4
    loop = diagram.add(sum=Sum("+-"), lag=TransferFunction([1.0], [1.0, 2.0]))
    (a.y * b.y) >> loop[0].u1
    loop[0] >> loop[1] >> loop[0].u2
    step, pid = diagram.add(step=Step(1.0), pid=PID(1.0, 2.0, 3.0))
    step >> pid.reference
    loop[1] >> pid.measurement
    root = ET.fromstring(diagram.draw())
    found = [each for each in texts(root) if each[0]]
    for (one, (a, b, c, d)), (other, (e, f, g, h)) in combinations(found, 2):
        assert c <= e or g <= a or d <= f or h <= b, f"{one} and {other}"
    width, height = float(root.get("width")), float(root.get("height"))
    for _, (left, top, right, low) in found:
        assert left >= 0
        assert right <= width
        assert top >= 0
        assert low <= height


def ends(root):
    """Return the ends of all wires [px] with the paths of their signals."""
    return [
        (float(x), float(y), group.get("data-path"))
        for group in root.findall(f".//{SVG}g[@class='signal']")
        for line in group.findall(f"{SVG}path[@class='near']")
        for x, y in [line.get("d").split("L")[-1].split()]
    ]


@pytest.mark.parametrize("signs", ["+-", "-+", "+--", "++-+", "-+-+-"])
def test_each_sign_is_at_the_wire_that_it_counts(signs):
    """The nearest wire end of each sign comes from the block of that input; one input is feedback."""
    diagram = Diagram("signs")
    total, back = diagram.add(total=Sum(signs), back=Integrator())
    total >> back >> total.ports[f"u{len(signs)}"]
    for i in range(1, len(signs)):
        diagram.add(f"in_{i}", Constant(float(i))) >> total.ports[f"u{i}"]
    root = ET.fromstring(diagram.draw())
    seen = {}
    for sign, (a, b, c, d) in texts(root):
        if sign in {"+", "−"}:
            middle = (a + c) / 2 - EDGE_MARGIN, (b + d) / 2 - EDGE_MARGIN
            distance, path = min((dist(middle, end[:2]), end[2]) for end in ends(root))
            assert distance < 20.0
            seen[path] = sign.replace("−", "-")
    sources = [f"in_{i}.y" for i in range(1, len(signs))]
    assert seen == dict(zip([*sources, "back.y"], signs, strict=True))


def test_unused_ports_of_large_blocks_are_in_their_tooltips_only():
    class Large(Block):
        used = Output()
        a, b, c, d = (Output() for _ in range(4))
        other = Input(default=0.0)
        wanted = Input()

    diagram = series(large=Large())
    diagram.large.used >> diagram.add(gain=Gain(1.0)) >> diagram.large.wanted
    shown = {text for text, _ in texts(ET.fromstring(diagram.draw()))}
    assert shown >= {"used", "wanted", "Large"}
    assert not shown & {"a", "b", "other"}


def test_picture_is_xml_with_every_name_and_tooltips():
    diagram = mixed()
    root = ET.fromstring(diagram.draw())
    written = {text for text, _ in texts(root)}
    assert written >= {
        "plant",
        "K u",
        "gain_7",
        "u[0:2]",
        "[:2]",
        "shown",
        "every 0.1 s",
        "every 0.5 s",
    }
    titles = [element.text for element in root.iter(f"{SVG}title")]
    assert titles[0] == "mixed <&>"
    assert "\nplant.y (4,)" in "\n".join(titles)
    assert LONG_NAME in "".join(titles)


def test_picture_is_the_same_each_time_and_leaves_the_diagram_alone():
    diagram = mixed()
    assert diagram.draw() == mixed().draw()
    loop = ring(a=Gain(1.0), b=Gain(1.0))
    loop.draw()
    assert loop.a.u.shape is None
    vector = loop.add(vector=Constant(np.ones(3)))
    (vector.y + loop.b.y) >> loop.add(end=Gain(1.0)).u
    assert loop.a.u.shape == (3,)


def test_nested_diagrams_are_drawn_by_themselves():
    """A group is one box, with the names of its blocks below."""
    diagram = nested(1)
    for picture, notes in ((diagram.draw(), ["gain"]), (diagram.inner.draw(), [])):
        assert len(re.findall(r'class="name [^>]*>gain<', picture)) == 1
        assert re.findall(r'class="note [^>]*>([^<]*)<', picture) == notes
    diagram.inner.add(LONG_NAME, Gain(2.0))
    assert f">gain, {LONG_NAME[:27]}…<" in diagram.draw()


def test_sampled_blocks_are_coloured_with_their_rates():
    text = mixed().draw()
    assert text.count('class="box sampled"') == 2
    assert re.findall(">(every [^<]*)</text>", text) == ["every 0.5 s", "every 0.1 s"]
    group = nested(1)
    assert "box sampled" not in group.draw()
    group.inner.gain.sampled(0.1)
    # The outline of a group has two lines.
    assert group.draw().count("box sampled") == 2


def test_notebooks_show_the_diagram_of_an_error(monkeypatch):
    """The message is as without; where no diagram is known there is no picture; other processes get none."""
    shown = []
    tracebacks = SimpleNamespace(
        structured_traceback=lambda *error: [error[0].__name__, str(error[1])]
    )
    shell = SimpleNamespace(
        get_ipython=lambda: SimpleNamespace(InteractiveTB=tracebacks)
    )
    monkeypatch.setitem(sys.modules, "IPython", shell)
    pictures = SimpleNamespace(SVG=str, display=shown.append)
    monkeypatch.setitem(sys.modules, "IPython.display", pictures)
    loop, twice = Diagram("loop"), Diagram("twice")
    gain, other = loop.add(gain=Gain(2.0), other=Gain(1.0))
    gain >> other >> gain
    one, two = twice.add(one=Constant(np.ones(2)), two=Gain(np.ones(3)))
    for diagram, fault, colour in (
        (loop, lambda: simulate(loop, 1.0, step=0.1), "box"),
        (twice, lambda: one.y >> two.u, "box"),
        (nested(0), lambda: nested(0).draw("picture.png"), ""),
    ):
        with pytest.raises(DiagramError) as caught:
            fault()
        assert caught.value._render_traceback_()[1] == str(caught.value)
        assert [colour in text for text in shown] == [True] * bool(colour)
        assert f"<title>{diagram.name}</title>" in "".join(shown) or not colour
        assert pickle.loads(pickle.dumps(caught.value)).diagram is None
        shown.clear()


def test_file_holds_the_picture(tmp_path):
    text = nested(1).draw(tmp_path / "picture.svg")
    assert (tmp_path / "picture.svg").read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    "name, fault",
    [
        ("picture.png", "pictures are SVG, pages HTML; name the file .svg or .html"),
        ("missing/picture.svg", "No such file"),
    ],
)
def test_file_that_cannot_be_written(tmp_path, name, fault):
    with pytest.raises(
        DiagramError, match=f"cannot draw diagram 'nested' to .*{fault}"
    ):
        nested(0).draw(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_empty_diagrams():
    assert ET.fromstring(Diagram("empty").draw()).tag == f"{SVG}svg"
    outer = series(inner=Diagram("empty"))
    assert ">inner<" in outer.draw()
