"""Live pages: defaults, sliders, messages, links, panels, hostile names, and refusals."""

import ast
import base64
import json
import re
import zlib

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import (
    Ball,
    Counter,
    Lag,
    Oscillator,
    PythonBall,
    approach,
    assert_near,
    ring,
    series,
)

from trussflow.blocks import (
    PID,
    Constant,
    Diagram,
    Function,
    Gain,
    Integrator,
    Noise,
    Parameter,
    Step,
    StopWhen,
    TransferFunction,
    simulate,
)
from trussflow.blocks.errors import DiagramError, NameLookupError, SimulationError
from trussflow.blocks.live.page import Panel
from trussflow.blocks.tracing import compiler
from trussflow.blocks.tracing.compile_cache import CompilationError


def pid():
    diagram = Diagram("pid loop")
    step, law, plant = diagram.add(
        step=Step(0.5, initial_value=0.0, final_value=1.0),
        law=PID(12.0, 6.0, 4.0, lower=-50.0, upper=50.0),
        plant=TransferFunction([1.0], [1.0, 0.8, 2.0]),
    )
    step >> law.reference
    plant >> law.measurement
    law >> plant
    diagram.expose(position=plant.y, torque=law.y)
    return diagram


def made(diagram, tmp_path, **settings):
    """Return the data of a page, and its file."""
    file = diagram.live(tmp_path / "page.html", **settings)
    text = file.read_text(encoding="utf-8")
    (found,) = re.findall(
        r'<script type="application/json" id="data">(.*)</script>', text
    )
    return json.loads(found), file


@pytest.fixture(scope="module")
def pid_page(tmp_path_factory):
    return made(pid(), tmp_path_factory.mktemp("pid"), duration=5.0, step=0.01)[1]


@pytest.mark.usefixtures("ziglang")
def test_defaults_are_gains_first_and_exposed_outputs(tmp_path):
    data, _ = made(pid(), tmp_path)
    names = [control["name"] for control in data["controls"]]
    assert names[:3] == ["law.kp", "law.ki", "law.kd"]
    assert len(names) <= 12
    ports = {name: port for name, port, _ in data["channels"]}
    assert ports == {"position": "plant.y", "torque": "law.y"}
    assert data["steps"] * data["tick"][0] / data["tick"][1] == 10.0


@pytest.mark.usefixtures("ziglang")
def test_the_step_resolves_the_fastest_mode_and_divides_sample_times(tmp_path):
    stiff = series(spring=Oscillator(stiffness=1e6))  # 1000 rad/s
    stiff.ground(stiff.spring.u)
    data, _ = made(stiff, tmp_path, duration=1.0)
    step = data["tick"][0] / data["tick"][1]
    assert 1.0 / 50e3 < step <= 1.0 / 20e3
    stiff.add(count=Counter().sampled(7e-4))
    data, _ = made(stiff, tmp_path, duration=0.7)
    step = data["tick"][0] / data["tick"][1]
    assert step <= 1.0 / 20e3
    assert 7e-4 / step == pytest.approx(round(7e-4 / step), rel=1e-12)


@pytest.mark.usefixtures("ziglang")
def test_ranges_respect_limits_and_contain_the_value(tmp_path):
    diagram = Diagram("limits")
    diagram.add(ball=Ball(), gain=Gain(0.0), negative=Gain(-2.0))
    diagram.blocks["ball"].height >> diagram.blocks["gain"].u
    diagram.blocks["gain"].y >> diagram.blocks["negative"].u
    data, _ = made(
        diagram,
        tmp_path,
        step=0.01,
        parameters={"ball.restitution": (0.1, 0.9)}
        | dict.fromkeys(["gain.gain", "negative.gain", "ball.start"]),
    )
    ranges = {c["name"]: (c["low"], c["high"]) for c in data["controls"]}
    assert ranges == {
        "ball.restitution": (0.1, 0.9),
        "gain.gain": (-1.0, 1.0),
        "negative.gain": (-8.0, -0.5),
        "ball.start": (0.25, 4.0),
    }


@pytest.mark.usefixtures("ziglang")
def test_signals_of_one_unit_share_a_chart_and_arrays_have_their_own(tmp_path):
    diagram = Diagram("charts")
    _, _, _, many = diagram.add(
        ratio=Constant(0.5),
        one=Constant(1.0, unit="m"),
        two=Constant(2.0, unit="m"),
        many=Integrator(np.zeros(9)),
    )
    diagram.ground(many.u)
    data, _ = made(diagram, tmp_path, step=0.01)
    found = [(c["unit"], len(c["curves"])) for c in data["charts"]]
    assert found == [("", 1), ("m", 2), ("", 9)]


@pytest.mark.usefixtures("ziglang")
def test_pages_of_sampled_blocks_are_small(tmp_path):
    diagram = series(law=Gain(2.0).sampled(1e-3), state=Integrator())
    diagram.ground(diagram.law.u)
    _, file = made(diagram, tmp_path, duration=100.0, step=1e-3)
    assert file.stat().st_size < 100_000


def test_a_moved_slider_changes_the_charts(pid_page, window):
    window.open(pid_page)
    assert [url for url in window.requests if not url.startswith("blob:")] == [
        pid_page.as_uri()
    ]
    assert pid_page.stat().st_size < 100_000
    before = window.rows()[1]
    slider = window.page.get_by_label("law.kp", exact=True)
    slider.fill("900")
    window.wait("document.body.dataset.shown > 1")
    after = window.rows()[1]
    assert abs(after - before).max() > 0.1
    # The copied call repeats the run.
    (_, call) = ast.parse(window.page.evaluate("trussflowLive.python()")).body
    settings = {k.arg: ast.literal_eval(k.value) for k in call.value.keywords}
    duration = ast.literal_eval(call.value.args[1])
    (value,) = settings["parameters"].values()
    assert value == pytest.approx(12.0 * 4.0**0.8, rel=1e-3)
    result = simulate(pid(), duration, **settings)
    found = np.column_stack([result["position"], result["torque"]])
    assert_near(after, found, 1e-11)
    # A double click brings the value back.
    slider.dblclick()
    window.wait("document.body.dataset.shown == asked")
    assert_array_equal(window.rows()[1], before)
    # A value beyond its limits starts no run.
    number = window.page.evaluate("asked")
    field = window.page.get_by_label("law.filter_time, number", exact=True)
    field.fill("-1")
    field.dispatch_event("change")
    window.wait("document.querySelector('input:invalid')")
    assert window.page.evaluate("asked") == number
    assert not window.complaints


def test_a_link_holds_the_values(pid_page, window):
    window.open(pid_page)
    window.set("law.ki", 2.5)
    expected = window.rows()
    link = window.page.evaluate("trussflowLive.address()").partition("#")[2]
    window.open(pid_page, link)
    for one, other in zip(window.rows(), expected, strict=True):
        assert_array_equal(one, other)
    # Values that are not allowed are left out.
    window.open(pid_page, "law.ki=nonsense&law.filter_time=-1&other=3")
    assert abs(window.rows()[1] - expected[1]).max() > 1e-3
    assert not window.complaints


def test_metrics_are_those_of_a_first_order_lag(window, tmp_path):
    diagram = approach()
    diagram.expose(filling=diagram.blocks["level"].y)
    window.open(diagram.live(tmp_path / "page.html", duration=20.0, step=0.01))
    found = window.page.evaluate(
        "trussflowLive.metrics(trussflowLive.run.time, trussflowLive.run.log)"
    )
    # y = 1 - exp(-t), to the resolution of the log.
    steady, rise, overshoot, settling = found
    assert rise == pytest.approx(np.log(9.0), abs=0.02)
    assert settling == pytest.approx(np.log(50.0), abs=0.02)
    assert steady == pytest.approx(1.0, abs=1e-8)
    assert overshoot == pytest.approx(0.0, abs=1e-6)


def test_a_kept_run_stays_behind_until_it_is_forgotten(pid_page, window):
    window.open(pid_page)
    places = [window.page.locator(name) for name in ("#metrics", ".legend >> nth=0")]
    assert not any("(" in place.inner_text() for place in places)
    window.page.locator("#keep").click()
    window.set("law.kp", 30.0)
    assert all("(" in place.inner_text() for place in places)
    window.page.locator("#keep").click()
    window.set("law.kp", 31.0)
    assert not any("(" in place.inner_text() for place in places)


def test_divergence_names_state_and_time(window, tmp_path):
    diagram = ring(square=Function(np.square), x=Integrator(0.5))
    window.open(diagram.live(tmp_path / "page.html", duration=5.0, step=0.01))
    # x = 1 / (2 - t)
    said = re.search(
        r"'x\.\w+' stopped being finite at t = ([\d.]+) s", window.trouble()
    )
    assert said
    assert 1.9 < float(said[1]) < 2.2
    assert window.rows()[0][-1] < 2.2
    window.set("x.initial_value", 0.1)
    assert not window.trouble()


def test_a_run_ends_at_a_terminal_event(window, tmp_path):
    """The integral of one ends the run at 1.237 s; a slower one does not reach the limit."""
    diagram = Diagram("until")
    one, x, stop = diagram.add(one=Constant(1.0), x=Integrator(), stop=StopWhen())
    one >> x
    x.y - 1.237 >> stop
    window.open(diagram.live(tmp_path / "page.html", duration=5.0, step=0.01))
    assert "a block ended the run at t = 1.237 s" in window.trouble()
    assert window.rows()[0][-1] == pytest.approx(1.23)
    window.set("one.value", 0.1)
    assert not window.trouble()


def test_a_page_that_cannot_simulate_shows_the_reason(pid_page, window, tmp_path):
    text = pid_page.read_text(encoding="utf-8")
    damaged = base64.b64encode(zlib.compress(b"no module")).decode()
    file = tmp_path / "damaged.html"
    file.write_text(re.sub('id="module">.*<', f'id="module">{damaged}<', text))
    window.page.goto(file.as_uri())
    window.wait("!document.getElementById('trouble').hidden")
    assert "cannot simulate: WebAssembly.compile" in window.trouble()


HOSTILE = (
    "</script><script>alert(1)</script><img src=x onerror=alert(2)>'\"`${1}\u2028ü𝄞"
)


class Labelled(Lag):
    """A lag whose parameter has a hostile unit and meaning."""

    start = Parameter(0.0, meaning=HOSTILE)


def test_hostile_names_do_no_harm(window, tmp_path):
    diagram = Diagram(HOSTILE)
    lag = diagram.add("ü", Labelled())
    diagram.ground(lag.u)
    name = HOSTILE.replace("/", "")
    file = diagram.live(
        tmp_path / "page.html", duration=1.0, step=0.01, signals={name: lag.y}
    )
    window.open(file)
    for element, text in (("h1", HOSTILE), ("h2", name), (".legend", name)):
        found = window.page.evaluate(f"document.querySelector('{element}').textContent")
        assert text in found
    found = window.page.evaluate("document.querySelector('.control label').title")
    assert found == HOSTILE
    assert window.page.evaluate("document.images.length") == 0
    assert not window.complaints


def test_panels_follow_the_cursor(window, tmp_path):
    script = """window.trussflowPanels.push({
      mount(element) { this.box = element; this.closed = "</script>"; },
      update(time, signals) { this.box.textContent = JSON.stringify([time, signals]); } });"""
    diagram = pid()
    panel = Panel(script, ["plant.y", "law.y"])
    broken = Panel(
        "window.trussflowPanels.push({ mount() { throw Error('no WebGL'); } });"
    )
    window.open(
        diagram.live(
            tmp_path / "page.html",
            duration=5.0,
            step=0.01,
            panels=[broken, panel],
            signals=["law.y"],
        )
    )
    window.page.evaluate(
        "document.getElementById('cursor').value = 0.5; document.getElementById('cursor').oninput()"
    )
    last = "document.querySelector('.panel:last-child').textContent"
    window.wait(f"JSON.parse({last})[0] === 2.5")
    _, signals = json.loads(window.page.evaluate(last))
    assert "no WebGL" in window.page.locator(".panel").first.inner_text()
    found = simulate(diagram, 5.0, step=0.01).sel(time=2.5)
    assert signals["plant.y"] == pytest.approx([float(found["plant.y"])], rel=1e-12)
    assert signals["law.y"] == pytest.approx([float(found["law.y"])], rel=1e-12)


def test_a_long_run_shows_its_progress_and_gives_way_to_new_values(window, tmp_path):
    window.open(pid().live(tmp_path / "page.html", duration=2000.0, step=1e-4))
    window.wait("!document.getElementById('progress').hidden")
    window.page.evaluate("p[0] = 0.5; ask(); null")
    window.wait("trussflowLive.run.id == 2")
    window.wait("document.body.dataset.shown == 2")
    assert window.rows()[0][-1] == 2000.0


def test_cursor_runs_charts_zoom_and_everything_is_reset(pid_page, window):
    window.open(pid_page)
    window.set("law.kp", 20.0)
    page = window.page
    page.locator("#play").click()
    window.wait("view.cursor > 0.05 && view.cursor < 5")
    page.locator("#play").click()
    stopped = page.evaluate("view.cursor")
    page.wait_for_timeout(50)
    assert page.evaluate("view.cursor") == stopped
    box = page.locator("canvas").first.bounding_box()
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] * 0.4, middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.6, middle, steps=3)
    page.mouse.up()
    low, high = page.evaluate("view.range")
    assert 0.5 < low < high < 4.5
    page.locator("canvas").first.dblclick()
    assert page.evaluate("view.range") is None
    page.locator("#reset").click()
    window.wait("document.body.dataset.shown > 2")
    assert page.evaluate("location.hash + python()").count("kp") == 0
    assert not window.complaints


def of(block):
    diagram = series(own=block)
    for port in block.inputs():
        diagram.ground(port)
    return diagram


@pytest.mark.parametrize(
    "diagram, settings, error, message",
    [
        (
            of(PythonBall()),
            {},
            DiagramError,
            r"'own' \(PythonBall\) computes in Python",
        ),
        (
            of(Noise(1.0, 0.01, seed=2)),
            {"parameters": ["own.seed"]},
            SimulationError,
            "'own.seed' cannot have a slider: initial",
        ),
        (
            of(Noise(1.0, 0.01, seed=2)),
            {"parameters": {"own.seed": (0.0, 2.0)}},
            SimulationError,
            "'own.seed' cannot have a slider: initial",
        ),
        (pid(), {"parameters": ["law.kx"]}, NameLookupError, "no parameter 'law.kx'"),
        (
            pid(),
            {"parameters": {"law.kp": (20.0, 30.0)}},
            SimulationError,
            "20 to 30 .*must contain its value 12",
        ),
        (
            of(Gain(1e308)),
            {"parameters": ["own.gain"]},
            SimulationError,
            "'own.gain' is infinite; give the ends",
        ),
        (pid(), {"pace": 1.0}, SimulationError, "leave out the path"),
        (pid(), {"step": 0.3}, SimulationError, "10 s is not a whole number"),
        (pid(), {"duration": -1.0}, SimulationError, "duration"),
    ],
)
def test_what_a_page_cannot_do_is_refused(diagram, settings, error, message, tmp_path):
    with pytest.raises(error, match=message):
        diagram.live(tmp_path / "page.html", **({"step": 0.01} | settings))
    assert not list(tmp_path.iterdir())


def test_a_missing_compiler_has_a_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(compiler.sys.modules, "ziglang", None)
    monkeypatch.delenv("WASM_CC", raising=False)
    with pytest.raises(CompilationError, match="pip install ziglang"):
        pid().live(tmp_path / "page.html")
    monkeypatch.setenv("WASM_CC", f"{compiler.sys.executable} -c raise+SystemExit")
    with pytest.raises(CompilationError, match="failed"):
        pid().live(tmp_path / "page.html")
    assert not list(tmp_path.iterdir())
