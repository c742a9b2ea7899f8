"""Pictures of diagrams: texts, colours, hierarchy, files."""

import pickle
import re
import sys
import xml.etree.ElementTree as ET
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Integrator,
    MatrixGain,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.drawing.scene import HEAD_HEIGHT, breadth, scene_of
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


def texts(scene):
    """Return the rectangles that texts fill [px]."""
    found = []
    for row, pin in scene.pins:
        if row.name:
            left = (
                pin.box.x + 6
                if row.port.is_input
                else pin.box.x + pin.box.width - 6 - breadth(row.name)
            )
            found.append((left, pin.y - 6, left + breadth(row.name), pin.y + 6))
        if row.note:
            right, low = pin.box.x - 4, pin.y + (-4 if row.key else 3)
            found.append((right - breadth(row.note) * 9 / 11, low - 7, right, low))
    return found


def test_no_two_texts_overlap_and_those_of_blocks_are_inside():
    scene = scene_of(mixed())
    for (a, b, c, d), (e, f, g, h) in combinations(texts(scene), 2):
        assert c <= e or g <= a or d <= f or h <= b
    for row, pin in scene.pins:
        assert breadth(row.name) + 12 <= pin.box.width
        assert pin.dy >= HEAD_HEIGHT or pin.box.edge
    assert min(a for a, *_ in texts(scene)) >= -12  # the margin


def test_picture_is_xml_with_every_name_and_tooltips():
    diagram = mixed()
    root = ET.fromstring(diagram.draw())
    written = {element.text or element[0].tail for element in root.iter(f"{SVG}text")}
    assert written >= {
        "plant",
        "MatrixGain",
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
    loop = Diagram("open shapes")
    a, b = loop.add(a=Gain(1.0), b=Gain(1.0))
    a >> b >> a
    loop.draw()
    assert a.u.shape is None
    vector = loop.add(vector=Constant(np.ones(3)))
    (vector.y + b.y) >> loop.add(end=Gain(1.0)).u
    assert a.u.shape == (3,)


def test_nested_diagrams_are_drawn_by_themselves():
    diagram = nested(1)
    assert diagram.draw().count(">gain<") == 1
    assert diagram.inner.draw().count(">gain<") == 1


def test_rates_have_colours():
    kinds = re.findall(r'class="box (rate\d)"', mixed().draw())
    assert sorted(kinds) == ["rate0", "rate0", "rate1", "rate1"]


def test_picture_reads_in_light_dark_and_print():
    text = nested(0).draw()
    assert "@media screen and (prefers-color-scheme: dark)" in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


def test_notebooks_show_pictures():
    diagram = nested(1)
    assert diagram._repr_svg_() == diagram.draw()._repr_svg_() == diagram.draw()


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
    ("name", "fault"),
    [
        ("picture.png", "pictures are SVG; name the file .svg"),
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
    outer = Diagram("outer")
    outer.add(inner=Diagram("empty"))
    assert ">inner<" in outer.draw()
