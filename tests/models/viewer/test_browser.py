"""Pages as a browser shows them: positions, what is visible, what moves, what the controls do."""

import io
from collections import defaultdict
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.testing import assert_allclose

from trussflow.models import EULER, QUATERNION, ModelError, SpaceTruss, arm_terms
from trussflow.models.geometry.rotation import fixed_rotation, rotation_about_z
from trussflow.models.robots.hand_motion import hand_motion
from trussflow.models.robots.urdf_reading import Pose
from trussflow.models.robots.visuals import Visual
from trussflow.models.viewer import Section, replay, still
from trussflow.models.viewer.scene import frame_rods
from trussflow.models.viewer.solids import box_of

campaign = pytest.mark.campaign

TOLERANCE = 1e-6  # m; coordinates of the root are float64, joints and modes float32

LONGEST = 2.5  # m; of the arrows
ARROWS = {"base_force": "thrust", "base_torque": "torque"}

DRAWN = """(t) => {
  const points = ({ x, y, z }) => x.map((_, i) => [x[i], y[i], z[i]]);
  const value = (trace) => ({ name: trace.name, type: trace.type, points: points(trace) });
  return page.show(t).then(() => document.getElementById("picture").data.map(value));
}"""


def drawn(page, t):
    """Return the points of what the page draws at an instant, by name; meshes are bases."""
    found = defaultdict(list)
    for trace in page.evaluate(DRAWN, t):
        name = "base" if trace["type"] == "mesh3d" else trace["name"]
        found[name].append(np.array(trace["points"], dtype=float))
    return found


def seen(arm, angles, axes, place):
    """Return the corners of all visuals of an arm whose hand has these axes and this place."""
    frames = [(axes, place)]
    for joint, angle in enumerate(angles):
        place, axes = (
            place + axes @ arm.joint_origins[joint],
            axes @ arm.joint_rotations[joint],
        )
        slid = angle if arm.sliding[joint] else 0.0
        place, axes = place + axes[:, 2] * slid, axes @ rotation_about_z(angle - slid)
        frames.append((axes, place))
    each = [(frames[visual.body], visual.triangles()[0]) for visual in arm.visuals]
    return np.concatenate([points @ axes.T + place for (axes, place), points in each])


def check_positions(page, truss, rods, run):
    """Compare ten instants with the equations of motion's own kinematics."""
    pushes = {
        name: np.linalg.norm(run[f"truss.{name}"], axis=2).max() for name in ARROWS
    }
    dynamics, modes = truss.dynamics, truss.dynamics.modes
    for i in np.linspace(0, len(run["time"]) - 1, 10).astype(int):
        shown, q = (
            drawn(page, float(run["time"][i])),
            run["truss.coordinates"].values[i],
        )
        end, modal, rigid = dynamics.attitude.end, q[truss.rigid_q :], np.zeros(6)
        rotation = dynamics.attitude.rotation(q[3:end])

        def check(points, expected, q=q, rotation=rotation):
            assert_allclose(
                points, q[:3] + expected @ rotation.T, rtol=0, atol=TOLERANCE
            )

        (segments,) = shown["truss"]
        check(
            segments.reshape(-1, 3, 3)[:, :2],
            (modes.positions + modes.shapes @ modal)[rods],
        )
        first = end
        for k, arm in enumerate(dynamics.arms):
            hand = hand_motion(modes.data, k, modal, rigid, 0.0 * modal, exact=True)
            angles = q[first : first + arm.joints]
            terms = arm_terms(
                arm, angles, 0.0 * angles, hand.rotation, hand.position, rigid, rigid
            )
            (chain,) = shown[f"robot {k + 1}"]
            check(chain[[0, -1]], np.stack([hand.position, terms.base_position]))
            # A joint that turns lies on its axis: the screw is (p x axis, axis) for each of its points p.
            turns = ~np.array(arm.sliding, dtype=bool)
            joints = (chain[1:-1] - q[:3])[turns] @ rotation
            moments, axes = np.split(terms.screws[turns], 2, axis=1)
            assert_allclose(np.cross(joints, axes), moments, rtol=0, atol=TOLERANCE)
            signs = np.array(list(product((-1, 1), repeat=3)))[:, ::-1]
            corners = (
                terms.base_position + (signs * box_of(arm)) @ terms.base_rotation.T
            )
            if arm.visuals:
                corners = seen(
                    arm, angles, hand.rotation @ arm.hand_rotation, hand.position
                )
            check(shown["base"][k], corners)
            for name, longest in pushes.items():
                push = run[f"truss.{name}"].values[i, k] * LONGEST / longest
                (arrow,) = (
                    points
                    for part, (points, *_) in shown.items()
                    if part.startswith(ARROWS[name])
                )
                each = len(arrow) // len(dynamics.arms)
                check(
                    arrow[each * k + 1],
                    terms.base_position + terms.base_rotation @ push,
                )
            first += arm.joints


def test_positions_are_those_of_the_result(window, truss, run):
    window.page.locator("#exaggeration").fill("1")
    check_positions(window.page, truss, frame_rods(truss.dynamics.modes), run)
    assert window.complaints == []


def test_nothing_is_asked_of_a_network(window, page_file):
    assert [request.partition("#")[0] for request in window.requests] == [
        page_file.as_uri()
    ]


@pytest.mark.parametrize("attitude", [pytest.param(EULER, marks=campaign), QUATERNION])
def test_positions_of_any_truss(opened, random_system, make_run, tmp_path, attitude):
    dynamics = random_system((2, "RPRRP", ""), 4, elastic_integrals=True)
    pose = Pose(fixed_rotation(np.array([0.3, -1.0, 2.0])), np.array([0.1, 0.2, -0.3]))
    shapes = [("box", [0.1, 0.2, 0.3]), ("cylinder", [0.1, 0.6]), ("sphere", [0.2])]
    looks = tuple(
        Visual(2 * k, pose, kind, np.array(size))
        for k, (kind, size) in enumerate(shapes)
    )
    first, second, third = dynamics.arms
    dynamics = replace(dynamics, arms=(first, replace(second, visuals=looks), third))
    truss = SpaceTruss(replace(dynamics, attitude=attitude))
    run, rods = make_run(truss, modal=0.1), np.array([[0, 7], [3, 14]])
    window = opened()
    page = window.open(
        replay(run, truss, tmp_path / "any.html", rods=rods), exaggeration=1
    )
    check_positions(page, truss, rods, run)
    assert window.complaints == []


def pixels(page, selector="#picture"):
    """Return a picture of a part of the page, colours from 0 to 255."""
    raw = page.locator(selector).screenshot()
    return np.asarray(imread(io.BytesIO(raw), format="png")[..., :3] * 255.0)


def changes(first, second):
    """Return how many pixels of two pictures differ."""
    return (np.abs(first - second).max(axis=2) > 40.0).sum()


def count(picture, colour, distance=40.0):
    """Return how many pixels have about a colour."""
    wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
    return (np.abs(picture - wanted).max(axis=2) < distance).sum()


RODS = {"light": "#5a6b7b", "dark": "#b8c6d4"}
THRUST, TORQUE = "#dc2626", "#a855f7"
ROBOTS = "#0072B2", "#D55E00", "#009E73", "#CC79A7"


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=campaign)])
def test_all_of_it_is_seen_and_moves(window, scheme):
    page = window.page
    page.emulate_media(color_scheme=scheme)
    page.locator("#exaggeration").fill("1")
    page.evaluate("page.show(2)")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == (
        "rgb(17, 24, 39)" if scheme == "dark" else "rgb(255, 255, 255)"
    )
    # Without the legend: what is counted is the picture.
    page.evaluate("Plotly.relayout('picture', { showlegend: false })")
    before = pixels(page)
    for colour, least in ((RODS[scheme], 1500), (THRUST, 100), (TORQUE, 100)):
        assert count(before, colour) > least, colour
    for colour in ROBOTS:
        assert count(before, colour, 60.0) > 60, colour
    still_there = pixels(page)
    page.evaluate("page.show(5)")
    after = pixels(page)
    assert changes(still_there, before) == 0
    assert changes(after, before) > 2000
    page.locator("#exaggeration").fill("500")
    assert changes(pixels(page), after) > 1000
    for chart in page.locator(".chart .plot").all():
        assert len(chart.locator(".scatterlayer .trace").all()) >= 1
    assert window.complaints == []


def test_controls(window):
    page, now = window.page, window.page.locator("#now")
    page.locator("#time").fill("0")
    page.locator("#exaggeration").fill("1")
    assert now.inner_text() == "0.00 s"
    page.locator("#forth").click()
    page.locator("#forth").click()
    page.locator("#back").click()
    page.wait_for_function("page.t === 0.02")
    page.locator("#time").fill("6")
    assert now.inner_text() == "6.00 s"
    page.locator("#play").click()
    page.wait_for_function("page.t > 6.2")
    page.wait_for_function("page.t === 8 && !page.playing")
    # A chart: its middle is the middle of the run, a click goes there, and so does the line in all charts.
    chart = page.locator(".chart .plot").nth(1)
    box = chart.bounding_box()
    page.mouse.move(box["x"] + 62 + (box["width"] - 174) / 2, box["y"] + 70)
    page.mouse.down()
    page.mouse.up()
    page.wait_for_function("Math.abs(page.t - 4) < 0.05")
    lines = [line.bounding_box()["x"] for line in page.locator(".cursor").all()]
    assert max(lines) - min(lines) < 1.0
    assert abs(lines[0] - box["x"] - 62 - (box["width"] - 174) / 2) < 3.0
    # Zooming one zooms all; another signal can be had.
    page.evaluate(
        "Plotly.relayout(page.charts[0].place, { 'xaxis.range[0]': 2, 'xaxis.range[1]': 3 })"
    )
    page.wait_for_function(
        "page.charts.every((chart) => chart.place.layout.xaxis.range[1] === 3)"
    )
    assert page.locator(".cursor").first.is_hidden()
    page.locator(".chart select").first.select_option("truss.energy")
    page.wait_for_function("page.charts[0].place.data.length === 1")
    # The camera: presets, and what it follows; a metre is as long along every axis.
    for camera in ("front", "side", "top"):
        before = pixels(page)
        page.locator("#camera").select_option(camera)
        page.wait_for_timeout(200)
        assert changes(pixels(page), before) > 1000, camera
    for follow, width in (("truss", 16.0), ("2", 4.0)):
        page.locator("#follow").select_option(follow)
        page.evaluate("page.show(1)")
        scene = page.evaluate("picture.layout.scene")
        axes = [(scene[f"{a}axis"]["range"], scene["aspectratio"][a]) for a in "xyz"]
        lengths = [(high - low) / side for (low, high), side in axes]
        assert_allclose(lengths, lengths[0], rtol=1e-9)
        assert axes[0][0][1] - axes[0][0][0] == pytest.approx(width)
    assert window.complaints == []


def test_two_runs_lie_over_each_other(opened, truss, run, make_run, tmp_path):
    second = make_run(SpaceTruss.published(), phase=0.4)
    below = '<div class="chart"><div class="plot" data-signal="truss.base_force"></div></div>'
    file = replay(
        run,
        truss,
        tmp_path / "two.html",
        other=second,
        other_truss="published",
        names=("first", "second"),
        sections=[Section("Figures", below)],
    )
    window = opened()
    page = window.open(file, t=3)
    page.evaluate("Plotly.relayout('picture', { showlegend: false })")
    picture = pixels(page)
    assert count(picture, "#5a6b7b") > 1000
    assert count(picture, "#c2410c") > 1000
    shown = drawn(page, 3.0)
    assert {"truss, first", "truss, second", "target"} <= set(shown)
    place = second["truss.coordinates"].values[150, :3]
    assert_allclose(shown["truss, second"][0][0], place, rtol=0, atol=TOLERANCE)
    assert page.locator("#second").inner_text() == "faint curves: second"
    assert page.evaluate("page.charts.map((chart) => chart.place.data.length)") == [
        68,
        24,
        24,
        2,
        24,
    ]
    faint = page.evaluate("page.charts[0].place.data.map((curve) => curve.opacity < 1)")
    assert faint == [False] * 34 + [True] * 34
    assert window.complaints == []


def test_narrow_windows_scroll_downwards_only(window):
    page = window.page
    page.set_viewport_size({"width": 380, "height": 760})
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for selector in ("#picture", ".chart .plot >> nth=0", "#play", "#exaggeration"):
        box = page.locator(selector).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 380, selector
    page.set_viewport_size({"width": 1000, "height": 700})


def test_a_damaged_page_says_so(opened, page_file, tmp_path):
    text = page_file.read_text(encoding="utf-8")
    damaged = tmp_path / "damaged.html"
    damaged.write_text(text.replace('id="blob">', 'id="blob">AAAA'), encoding="utf-8")
    page = opened().page
    page.goto(damaged.as_uri())
    page.wait_for_function(
        "document.getElementById('trouble').textContent.includes('cannot be shown')"
    )


@campaign
def test_a_run_that_went_far_is_still_seen(opened, truss, run, tmp_path):
    """The picture follows the truss, or all of it would be a dot, and shows the charts to the end."""
    values = run["truss.coordinates"].values.copy()
    values[200:] *= 10.0 ** np.linspace(0.0, 60.0, len(values) - 200)[:, None]
    far = run.assign({"truss.coordinates": (("time", "c"), values)})
    window = opened()
    page = window.open(replay(far, truss, tmp_path / "far.html"), t=3)
    assert page.locator("#follow").input_value() == "truss"
    page.evaluate("Plotly.relayout('picture', { showlegend: false })")
    assert count(pixels(page), "#5a6b7b") > 1500
    page.evaluate("page.show(8)")
    assert page.evaluate("page.t") == 8
    assert window.complaints == []


@campaign
def test_what_cannot_be_shown_is_no_picture(page_file, tmp_path):
    picture, damaged, other = (
        tmp_path / name for name in ("none.png", "damaged.html", "other.html")
    )
    text = page_file.read_text(encoding="utf-8")
    damaged.write_text(text.replace('id="blob">', 'id="blob">AAAA'), encoding="utf-8")
    other.write_text("<p>Of another tool", encoding="utf-8")
    for file, time, message in (
        (page_file, 30.0, r"there is no t = 30.0 s, the run is from 0 to 8 s"),
        (
            damaged,
            1.0,
            r"cannot take a picture of '.*damaged.html': it cannot be shown: ",
        ),
        (
            other,
            1.0,
            r"cannot take a picture of '.*other.html': replay did not write it",
        ),
    ):
        with pytest.raises(ModelError, match=message):
            still(file, picture, time=time)
    assert not picture.exists()


def test_a_still_picture_shows_its_instant(opened, page_file, tmp_path):
    page = opened(640, 480).open(page_file, still=480)
    assert not any(
        page.locator(hidden).is_visible() for hidden in ("h1", "#controls", "#charts")
    )
    file = still(page_file, tmp_path / "5.png", time=5.0, size=(640, 480))
    picture = imread(file)[..., :3] * 255.0
    assert picture.shape == (480, 640, 3)
    assert count(picture, "#5a6b7b") > 500
    assert changes(picture, pixels(page)) > 1000
    page.evaluate("page.show(5)")
    assert changes(picture, pixels(page)) < 1000
