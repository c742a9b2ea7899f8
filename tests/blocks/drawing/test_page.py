"""Pages of diagrams: what they contain, and their groups, search, camera and charts in a browser."""

import json
import re
from itertools import combinations

import numpy as np
import pytest
from browsing import Watched, unpacked
from numpy.testing import assert_allclose, assert_array_equal
from systems import series

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Integrator,
    Sine,
    Sum,
    TransferFunction,
    simulate,
)
from trussflow.blocks.drawing import scene
from trussflow.blocks.errors import DiagramError

HOSTILE = '</script><script>alert("1")</script><b title="'


def servo(depth):
    """Return a loop around a gain, or around a group of such loops."""
    diagram = Diagram("servo")
    error, lag, law = diagram.add(
        error=Sum("+-"),
        lag=TransferFunction([1.0], [0.1, 1.0]),
        law=servo(depth - 1) if depth else Gain(2.0),
    )
    error.y >> (law.command if depth else law.u)
    (law.position if depth else law.y) >> lag.u
    lag >> error.u2
    if depth:
        beside = diagram.add(beside=servo(depth - 1), end=Integrator())
        error.y >> beside[0].command
        beside[0].position >> beside[1].u
    diagram.expose(command=error.u1, position=lag.y)
    return diagram


def machine(name="machine"):
    """Return a diagram with three levels of groups."""
    diagram = Diagram(name)
    goal, arm, still = diagram.add(
        goal=Sine(2.0, 0.5), arm=servo(2), still=Constant(1.0)
    )
    goal >> arm.command
    (arm.position + still.y) >> diagram.add(total=Integrator()).u
    return diagram


@pytest.fixture(scope="module")
def result():
    diagram = machine()
    log = [port for block in diagram.within() for port in block.outputs()]
    return simulate(diagram, 4.0, step=1e-3, log=log)


def data_of(file):
    text = file.read_text(encoding="utf-8")
    text = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1]
    return json.loads(text, object_hook=unpacked)


def test_chart_has_the_values_of_the_result(tmp_path, result):
    machine().draw(tmp_path / "page.html", result=result)
    data = data_of(tmp_path / "page.html")
    assert [*data["signals"]] == sorted(map(str, result))
    time = np.array(data["time"])
    assert (time[0], time[-1]) == (0.0, 4.0)
    for name, signal in data["signals"].items():
        own = np.interp(time, result["time"], result[name])
        assert_allclose(signal["lines"][0], own, rtol=1e-5, atol=1e-9)


def test_values_that_are_not_finite_stay(tmp_path):
    diagram = series(source=Constant([1.0, 2.0], unit="m"))
    found = simulate(diagram, 1.0, step=0.5, log=[diagram.source.y])
    found["source.y"].values[1, 0] = np.nan
    diagram.draw(tmp_path / "page.html", result=found)
    signal = data_of(tmp_path / "page.html")["signals"]["source.y"]
    assert signal["unit"] == "m"
    assert_array_equal(signal["lines"], [[1.0, np.nan, 1.0], [2.0, 2.0, 2.0]])


def test_page_is_one_file_without_network_and_escapes_names(tmp_path):
    machine(HOSTILE).draw(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "alert" in text
    assert HOSTILE not in text
    assert text.count("<script") == 2  # the data and the program
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)""", text)
    assert "default-src 'none'" in text


def test_result_of_another_diagram_is_refused(tmp_path, result):
    other = Diagram("other")
    no_page = r"with a result: only a page shows one; name a file \.html"
    with pytest.raises(DiagramError, match="'other' with 5: it is no result of a run"):
        other.draw(tmp_path / "page.html", result=5)
    for path, fault in (
        (tmp_path / "page.html", "no signal of diagram 'other'; give the result"),
        (tmp_path / "picture.svg", no_page),
        (None, no_page),
    ):
        with pytest.raises(DiagramError, match=fault):
            other.draw(path, result=result)
    assert not list(tmp_path.iterdir())


def test_each_picture_of_a_page_is_laid_out_once(tmp_path, monkeypatch):
    calls, layout = [], scene.layout
    monkeypatch.setattr(scene, "layout", lambda *of: calls.append(1) or layout(*of))
    diagram = machine()
    diagram.draw(tmp_path / "page.html")
    inner = [each for each in diagram.within() if isinstance(each, Diagram)]
    assert len(calls) == 1 + len(inner) == 8


# -- in a browser -----------------------------------------------------------------------------


@pytest.fixture
def page(chromium, result, tmp_path):
    """Return the page of a machine with a hostile name; it must not complain or request anything."""
    machine(HOSTILE).draw(tmp_path / "page.html", result=result)
    window = chromium.new_page(viewport={"width": 1200, "height": 800})
    watched = Watched(window, "log", "info", "warning", "error")
    window.on("dialog", lambda dialog: watched.complaints.append(dialog.message))
    watched.load((tmp_path / "page.html").as_uri())
    yield window
    assert watched.complaints == []
    requests = [url for url in watched.requests if not url.startswith("data:")]
    assert requests == [window.url]
    window.close()


def boxes(page):
    """Return the outlines of all blocks that are shown, by path."""
    return page.evaluate(
        """() => Object.fromEntries([...document.querySelectorAll(".block")].map((block) => {
            const box = block.querySelector(":scope > .box").getBoundingClientRect();
            return [block.dataset.path, [box.left, box.top, box.right, box.bottom]];
        }).filter(([, box]) => box[2] > box[0]))"""
    )


def loose_ends(page):
    """Return the largest distance of a wire end from the blocks and ports of its view [px on the screen]."""
    return page.evaluate(
        """() => Math.max(...[...document.querySelectorAll("svg > g:first-of-type")].flatMap((view) => {
            const own = [...view.children].filter((one) => one.matches(".block, text"));
            const places = own.map((one) => (one.querySelector(":scope > .box") ?? one).getBoundingClientRect());
            return [...view.children].filter((one) => one.matches(".signal")).flatMap((signal) => {
                const line = signal.querySelector(".wire");
                if (!line.getBoundingClientRect().width) return [0];
                return line.getAttribute("d").split("M").slice(1).flatMap((path) => {
                    const points = path.split("L"), matrix = line.getScreenCTM();
                    return [points[0], points[points.length - 1]].map((point) => {
                        const at = new DOMPoint(...point.split(" ").map(Number)).matrixTransform(matrix);
                        return Math.min(...places.map((box) => Math.hypot(
                            Math.max(box.left - at.x, 0, at.x - box.right),
                            Math.max(box.top - at.y, 0, at.y - box.bottom))));
                    });
                });
            });
        }))"""
    )


def check_places(page):
    """Check that no two blocks overlap unless one is in the other, and that wires end at blocks."""
    found = boxes(page)
    for (one, a), (other, b) in combinations(found.items(), 2):
        if other.startswith(f"{one}."):
            inside = a[0] < b[0] and a[1] < b[1] and b[2] < a[2] and b[3] < a[3]
            assert inside, other
        else:
            apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
            assert apart, f"{one} and {other}"
    assert loose_ends(page) <= 8 * page.evaluate("svg.getScreenCTM().a")
    return found


def picture(page):
    """Return the elements of the outermost diagram."""
    return page.evaluate(
        """() => {
            const copy = svg.cloneNode(true);
            copy.querySelectorAll(".block > svg").forEach((inner) => inner.remove());
            return copy.querySelector("g").outerHTML;
        }"""
    )


def test_groups_open_and_close_in_any_order(page):
    first = check_places(page)
    assert set(first) == {*machine().blocks}
    closed = picture(page)
    page.click("#open")
    assert len(check_places(page)) == sum(1 for _ in machine().within())
    page.click("#close")
    assert picture(page) == closed
    for path in ("arm", "arm.beside", "arm.law", "arm.law.law", "arm.beside.beside"):
        # a click at the name
        page.click("#fit")
        page.locator(f'[data-path="{path}"] > .name').dispatch_event("click")
        assert any(each.startswith(f"{path}.") for each in check_places(page))
        # The picture of the group fills the window.
        inner = page.locator(f'[data-path="{path}"] > svg').bounding_box()
        whole = page.locator("#picture").bounding_box()
        assert 0.5 < max(inner[k] / whole[k] for k in ("width", "height")) < 1.0
    page.locator('[data-path="arm"] > .name').dispatch_event("click")
    assert set(check_places(page)) == set(first)


def test_wheel_zooms_about_the_pointer_and_dragging_moves(page):
    def under(x, y):
        return page.evaluate(f"(({{ x, y }}) => [x, y])(at({x}, {y}))")

    before, width = under(400, 300), page.evaluate("eye[2]")
    page.mouse.move(400, 300)
    page.mouse.wheel(0, -300)
    page.wait_for_function(f"eye[2] < {width}")
    assert under(400, 300) == pytest.approx(before, abs=1e-3)
    page.mouse.down()
    page.mouse.move(460, 250)
    page.mouse.up()
    assert under(460, 250) == pytest.approx(before, abs=1e-3)
    page.click("#fit")
    assert page.evaluate("eye[2]") == width


def test_search_opens_the_groups_around_a_block(page):
    page.fill("#search", "LAW.lag")
    assert page.inner_text("#hits") == "3 found"
    for _ in range(4):
        page.press("#search", "Enter")
    assert page.inner_text("#hits").startswith("1 of 3: arm.")
    path = page.inner_text("#hits").partition(": ")[2]
    left, top, right, low = boxes(page)[path]
    middle = page.evaluate(
        "(({x, y, width, height}) => [x + width / 2, y + height / 2])(svg.getBoundingClientRect())"
    )
    assert [(left + right) / 2, (top + low) / 2] == pytest.approx(middle, abs=12.0)
    page.fill("#search", "nothing of this name")
    assert page.inner_text("#hits") == "0 found"


def test_click_on_a_wire_shows_its_chart(page):
    assert not page.is_visible("#chart")
    page.evaluate(
        """() => document.querySelector('.signal[data-path="goal.y"] .near')
            .dispatchEvent(new MouseEvent("click", { bubbles: true }))"""
    )
    assert page.is_visible("#chart")
    drawn = page.evaluate(
        """() => { const at = document.querySelector("canvas");
            return at.getContext("2d").getImageData(0, 0, at.width, at.height).data.filter((v) => v).length }"""
    )
    assert drawn > 1000
    assert page.inner_text("#chart h2") == "goal.y"
    page.click("#chart button")
    assert not page.is_visible("#chart")
