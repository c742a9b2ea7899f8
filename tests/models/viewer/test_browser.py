"""Pages as a browser shows them: positions, what is visible, what moves, what the controls do."""

import base64
import io
from dataclasses import replace
from itertools import pairwise, product

import campaign
import numpy as np
import pytest
from matplotlib.image import imread
from numpy.testing import assert_allclose
from PIL import Image, ImageSequence
from systems import assert_near

from trussflow.blocks.support.texts import package_text
from trussflow.models import EULER, QUATERNION, ModelError, SpaceTruss, arm_terms
from trussflow.models.geometry.rotation import fixed_rotation, rotation_about_z
from trussflow.models.robots.hand_motion import hand_motion
from trussflow.models.robots.urdf_reading import Pose
from trussflow.models.robots.visuals import Visual
from trussflow.models.viewer import movie, replay, scene_panel, still
from trussflow.models.viewer.scene import frame_rods
from trussflow.models.viewer.solids import box_of

TOLERANCE = 1e-6  # m; coordinates of the root are float64, joints and modes float32

LONGEST = 2.5  # m; of the arrows
ARROWS = {"base_force": "thrust", "base_torque": "torque"}

DRAWN = """(t) => {
  page.show(t);
  const ends = ([a, , b]) => [a, b];
  return page.scene.parts().map(({ name, capsules, corners }) =>
    [name, capsules.map(ends), (corners ?? []).map((point) => Array.from(point))]);
}"""


def drawn(page, t):
    """Return the ends of the capsules, or the corners of the triangles, that the page draws at an instant, by name."""
    found = {}
    for name, capsules, corners in page.evaluate(DRAWN, t):
        found.setdefault(name, np.array(capsules or corners, dtype=float))
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
            assert_near(points, q[:3] + expected @ rotation.T, TOLERANCE)

        check(
            shown["truss"][: len(rods)], (modes.positions + modes.shapes @ modal)[rods]
        )
        first = end
        for k, arm in enumerate(dynamics.arms):
            hand = hand_motion(modes.data, k, modal, rigid, 0.0 * modal, exact=True)
            angles = q[first : first + arm.joints]
            terms = arm_terms(
                arm, angles, 0.0 * angles, hand.rotation, hand.position, rigid, rigid
            )
            links = shown[f"robot {k + 1}"][: arm.joints + 1]
            assert_near(links[1:, 0], links[:-1, 1], TOLERANCE)
            chain = np.concatenate([links[:1, 0], links[:, 1]])
            check(chain[[0, -1]], np.stack([hand.position, terms.base_position]))
            # A joint that turns lies on its axis: the screw is (p x axis, axis) for each of its points p.
            turns = ~np.array(arm.sliding, dtype=bool)
            joints = (chain[1:-1] - q[:3])[turns] @ rotation
            moments, axes = np.split(terms.screws[turns], 2, axis=1)
            assert_near(np.cross(joints, axes), moments, TOLERANCE)
            signs = np.array(list(product((-1, 1), repeat=3)))[:, ::-1]
            corners = (
                terms.base_position + (signs * box_of(arm)) @ terms.base_rotation.T
            )
            if arm.visuals:
                corners = seen(
                    arm, angles, hand.rotation @ arm.hand_rotation, hand.position
                )
            check(shown[f"base {k + 1}"], corners)
            for name, longest in pushes.items():
                push = run[f"truss.{name}"].values[i, k] * LONGEST / longest
                (arrow,) = (  # its last capsule ends at the tip
                    capsules
                    for part, capsules in shown.items()
                    if part.startswith(ARROWS[name])
                )
                each = len(arrow) // len(dynamics.arms)
                check(
                    arrow[each * (k + 1) - 1, 1],
                    terms.base_position + terms.base_rotation @ push,
                )
            first += arm.joints


def test_positions_are_those_of_the_result(window, truss, run):
    window.page.locator("#exaggeration").fill("1")
    check_positions(window.page, truss, frame_rods(truss.dynamics.modes), run)


def test_nothing_is_asked_of_a_network(window, page_file):
    assert [request.partition("#")[0] for request in window.requests] == [
        page_file.as_uri()
    ]


@pytest.mark.parametrize("attitude", [campaign.only(EULER), QUATERNION])
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
    file = replay(run, truss, tmp_path / "any.html", rods=rods)
    page = opened().open(file, exaggeration=1)
    check_positions(page, truss, rods, run)


def pixels(page, selector="#picture"):
    """Return a picture of a part of the page, colours from 0 to 255."""
    raw = page.locator(selector).screenshot()
    return imread(io.BytesIO(raw), format="png")[..., :3] * 255.0


def changes(first, second, least=40.0):
    """Return how many pixels of two pictures differ."""
    return (np.abs(first - second).max(axis=2) > least).sum()


def check_visible(page, *names, least=300):
    """Check that pixels change when an entry of the legend is clicked, and change back."""
    before = pixels(page)
    for name in names:
        entry = page.locator("#legend .entry", has_text=name)
        entry.click()
        assert changes(pixels(page), before, 20.0) > least, name
        entry.click()
    assert changes(pixels(page), before) == 0


@pytest.mark.parametrize("scheme", ["light", campaign.only("dark")])
def test_all_of_it_is_seen_and_moves(window, scheme):
    page = window.page
    page.emulate_media(color_scheme=scheme)
    page.locator("#exaggeration").fill("1")
    page.evaluate("page.show(2)")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == (
        "rgb(17, 24, 39)" if scheme == "dark" else "rgb(255, 255, 255)"
    )
    check_visible(page, "truss")
    names = [f"robot {k}" for k in range(1, 5)]
    check_visible(page, *names, "thrust", "torque", "target", least=20)
    before = pixels(page)
    page.evaluate("page.show(5)")
    after = pixels(page)
    assert changes(after, before) > 1000
    page.locator("#exaggeration").fill("500")
    assert changes(pixels(page), after) > 500
    for axes in page.locator(".chart .axes").all():
        raw = axes.screenshot()
        image = imread(io.BytesIO(raw), format="png")[..., :3]
        assert (np.ptp(image, axis=2) > 0.3).sum() > 100  # coloured curves


def test_picture_and_charts_follow_the_theme(opened, page_file):
    page = opened().open(page_file)
    for place in ("#picture", ".axes >> nth=0"):
        for scheme in ("dark", "light"):
            page.emulate_media(color_scheme=scheme)
            page.wait_for_timeout(200)
            before = pixels(page, place)
            page.evaluate("page.scene.draw(); page.view.changed(true)")
            assert changes(pixels(page, place), before) == 0


@pytest.mark.parametrize("camera", ["oblique", campaign.only("side")])
def test_bodies_are_where_a_pinhole_camera_sees_them(opened, page_file, camera):
    """The red pixels of the thrusts extend as far as the projections of both ends of the arrows."""
    page = opened(900, 700).open(
        page_file, t=3, camera=camera, exaggeration=1, follow="truss"
    )
    for entry in page.locator("#legend .entry").all():
        if "thrust" not in entry.inner_text():
            entry.click()
    (azimuth, elevation), distance, target = page.evaluate(
        "[page.scene.angles, page.scene.distance, page.scene.target]"
    )
    turn = rotation_about_z(azimuth) @ fixed_rotation(np.array([0.0, -elevation, 0.0]))
    back, right, up = turn.T
    (ends,) = (
        points for name, points in drawn(page, 3.0).items() if name.startswith("thrust")
    )
    ends = ends.reshape(-1, 3) - target
    picture = pixels(page)
    height, width, _ = picture.shape
    unit = height / 2.0 / np.tan(0.55 / 2.0) / (distance - ends @ back)
    x, y = width / 2.0 + unit * (ends @ right), height / 2.0 - unit * (ends @ up)
    red = picture[..., 0] - picture[..., 1:].max(axis=2) > 60.0
    red[-80:, :80] = False  # the axes of the picture
    rows, columns = np.nonzero(red)
    for seen, expected in ((columns, x), (rows, y)):
        assert np.ptp(expected) > 50.0
        assert_near([seen.min(), seen.max()], [expected.min(), expected.max()], 7.0)


def test_charts_have_units_that_suit_and_one_line_for_equal_curves(
    opened, truss, run, tmp_path
):
    """Equal curves share an entry of the legend; values are those of the result in the unit of the axis."""
    values = run["truss.base_torque"].values.copy()
    values[:, 1] = values[:, 0]
    values[:, 2, 0] = values[:, 2, 1]
    shown = run.assign(
        {"truss.base_torque": run["truss.base_torque"].copy(data=values)}
    )
    scales = {"truss.energy": (2e-6, 1e6, "µJ"), "law.error": (3.0, 1e3, "10⁻³ m, rad")}
    for name, (size, _, _) in scales.items():
        shown[name] = shown[name].copy(data=size * shown[name].values)
    page = opened().open(replay(shown, truss, tmp_path / "charts.html"), t=3)
    entries = page.evaluate("JSON.parse(page.charts[2].names)")
    assert sorted(entries) == sorted(
        [f"1 {a} = 2 {a}" for a in "xyz"]
        + ["3 x = 3 y", "3 z"]
        + [f"4 {a}" for a in "xyz"]
    )
    widths = page.evaluate(
        "[...document.querySelectorAll('.legend')].map((l) => l.scrollWidth - l.clientWidth)"
    )
    assert max(widths) <= 0
    for name, (_, factor, unit) in scales.items():
        page.locator("#charts select").first.select_option(name)
        found = page.evaluate(
            "[...page.charts[0].legend.querySelectorAll('b')].map((b) => Number(b.textContent))"
        )
        expected = shown[name].sel(time=3.0).values.ravel() * factor
        assert_allclose(found, expected, rtol=1e-3)
        size = abs(shown[name].values).max()
        axis = page.evaluate("(a) => scaled(...a)", [size, run[name].units])
        assert axis == [pytest.approx(factor), unit]


def test_controls(window):
    page, now = window.page, window.page.locator("#now")
    page.locator("#time").fill("0")
    page.locator("#exaggeration").fill("1")
    assert now.inner_text() == "0.00 s"
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft"):
        page.locator("#time").press(key)
    page.wait_for_function("Math.abs(page.t - 0.02) < 1e-9")
    page.locator("#time").fill("7.4")
    assert now.inner_text() == "7.40 s"
    page.locator("#play").click()
    page.wait_for_function("page.t > 7.5")
    page.wait_for_function("page.t === 8")
    # A chart: its middle is the middle of the run, a click goes there, and so does the line in all charts.
    chart = page.locator(".chart .axes").nth(1)
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    middle = box["x"] + 58 + (box["width"] - 70) / 2
    page.mouse.move(middle, box["y"] + 70)
    page.mouse.down()
    page.mouse.up()
    page.wait_for_function("Math.abs(page.t - 4) < 0.05")
    lines = [line.bounding_box()["x"] for line in page.locator(".cursor").all()]
    assert max(lines) - min(lines) < 1.0
    assert abs(lines[0] - middle) < 3.0
    # A dragged part is shown by all charts, a double click shows all again; another signal can be had.
    page.mouse.down()
    page.mouse.move(middle + (box["width"] - 70) / 8, box["y"] + 70)
    page.mouse.up()
    ranges = np.array(page.evaluate("page.charts.map((chart) => chart.ends)"))
    assert_near(ranges, np.tile([4.0, 5.0], (len(ranges), 1)), 0.05)
    page.mouse.move(0, 0)
    page.evaluate("page.show(6)")
    assert page.locator(".cursor").first.is_hidden()
    page.mouse.dblclick(middle, box["y"] + 70)
    assert page.evaluate("page.charts[0].ends") == [0, 8]
    page.locator("#charts select").first.select_option("truss.energy")
    assert page.evaluate("page.charts[0].curves.length") == 1
    # The camera: presets, and what it follows; a metre is as long along every axis.
    pictures = []
    for camera in ("oblique", "front", "side", "top"):
        page.locator("#camera").select_option(camera)
        page.wait_for_timeout(200)
        pictures.append(pixels(page))
    assert all(changes(*pair) > 500 for pair in pairwise(pictures))
    page.locator("#follow").select_option("truss")
    page.evaluate("page.show(1)")
    seen = drawn(page, 1.0)["truss"]
    target, distance = page.evaluate("[page.scene.target, page.scene.distance]")
    assert np.abs(seen.reshape(-1, 3).mean(axis=0) - target).max() < 1.0
    assert 2.0 < distance < 40.0
    # The reader turns and approaches; a double click brings the view back.
    page.locator("#picture").scroll_into_view_if_needed()
    box = page.locator("#picture").bounding_box()
    angles = page.evaluate("page.scene.angles")
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 260, box["y"] + 180)
    page.mouse.up()
    page.mouse.wheel(0, -300)
    page.wait_for_function("page.scene.zoom < 0.8")
    assert page.evaluate("page.scene.angles") != angles
    page.mouse.dblclick(box["x"] + 200, box["y"] + 200)
    assert page.evaluate("page.scene.angles") == angles


def test_narrow_windows_scroll_downwards_only(window):
    page = window.page
    page.set_viewport_size({"width": 380, "height": 760})
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for selector in ("#picture", ".chart .axes >> nth=0", "#play", "#exaggeration"):
        box = page.locator(selector).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 380, selector
    page.set_viewport_size({"width": 760, "height": 560})


def test_a_damaged_page_says_so(opened, page_file, tmp_path):
    text = page_file.read_text(encoding="utf-8")
    damaged = tmp_path / "damaged.html"
    damaged.write_text(text.replace('id="head">', 'id="head">AAAA'), encoding="utf-8")
    window = opened()
    window.page.goto(damaged.as_uri())
    window.page.wait_for_function(
        "document.getElementById('trouble').textContent.includes('cannot be shown')"
    )
    window.complaints.clear()


@pytest.mark.campaign
def test_a_run_that_went_far_is_still_seen(opened, truss, run, tmp_path):
    """The picture follows the truss, or all of it would be a dot, and shows the charts to the end."""
    values = run["truss.coordinates"].values.copy()
    values[200:] *= 10.0 ** np.linspace(0.0, 60.0, len(values) - 200)[:, None]
    far = run.assign({"truss.coordinates": (("time", "c"), values)})
    page = opened().open(replay(far, truss, tmp_path / "far.html"), t=3)
    assert page.locator("#follow").input_value() == "truss"
    check_visible(page, "truss")
    page.evaluate("page.show(8)")
    assert page.evaluate("page.t") == 8


@pytest.mark.campaign
def test_what_cannot_be_shown_is_no_picture(page_file, tmp_path):
    picture, damaged, other = (
        tmp_path / name for name in ("none.png", "damaged.html", "other.html")
    )
    text = page_file.read_text(encoding="utf-8")
    damaged.write_text(text.replace('id="head">', 'id="head">AAAA'), encoding="utf-8")
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
    page = opened(320, 240).open(page_file, still=240)
    assert not any(
        page.locator(hidden).is_visible() for hidden in ("h1", "#controls", "#charts")
    )
    file = still(page_file, tmp_path / "5.png", time=5.0, size=(320, 240))
    picture = imread(file)[..., :3] * 255.0
    assert picture.shape == (240, 320, 3)
    assert changes(picture, pixels(page, "#left")) > 250
    page.evaluate("page.show(5)")
    assert changes(picture, pixels(page, "#left")) < 250


def test_a_panel_shows_the_state_that_it_is_given(opened, truss, run, tmp_path):
    """Its positions are those of the page of the run; it needs no log, and only charts of the page."""
    panel = scene_panel(truss, target=run.attrs["target"])
    chart = package_text("chart.js", "trussflow.blocks.support")
    scripts = f"{chart}window.trussflowPanels = [];</script><script>{panel.script}"
    text = f"<p>Panel<div id=here></div><script>{scripts}</script>"
    (tmp_path / "panel.html").write_text(
        f"<!DOCTYPE html><meta charset=utf-8><body data-state=ready>{text}",
        encoding="utf-8",
    )
    page = opened().open(tmp_path / "panel.html")
    page.evaluate("window.panel = trussflowPanels[0]; panel.mount(here)")
    before = pixels(page, "#here")
    signals = {name: run[name].values[150].ravel().tolist() for name in panel.signals}
    page.evaluate("(signals) => panel.update(3, signals)", signals)
    assert changes(pixels(page, "#here"), before) > 1000
    page.evaluate("window.page = { show() {}, scene: panel.scene }; null")
    shown = drawn(page, 3.0)
    q = run["truss.coordinates"].values[150]
    modes = truss.dynamics.modes
    rotation = truss.dynamics.attitude.rotation(q[3:6])
    expected = q[:3] + (modes.positions + modes.shapes @ q[-6:]) @ rotation.T
    rods = frame_rods(modes)
    assert_near(shown["truss"][: len(rods)], expected[rods], TOLERANCE)
    assert len(shown["target"]) == len(rods)
    assert any(name.startswith("thrust") for name in shown)


def test_a_film_shows_the_run_from_start_to_end(window, page_file, tmp_path):
    file = movie(page_file, tmp_path / "run.gif", duration=0.2, size=(240, 160))
    with Image.open(file) as film:
        assert (film.n_frames, film.size) == (3, (240, 160))
        frames = [
            np.asarray(film.convert("RGB"), dtype=float)
            for _ in ImageSequence.Iterator(film)
        ]
    assert all(changes(a, b) > 200 for a, b in pairwise(frames))
    page = window.open(page_file)
    page.emulate_media(color_scheme="light")
    for t, frame in ((0.0, frames[0]), (8.0, frames[-1])):
        page.evaluate("(t) => page.show(t)", t)
        _, _, raw = page.evaluate("page.scene.picture(240, 160)").partition(",")
        shown = imread(io.BytesIO(base64.b64decode(raw)), format="png")
        # The frame of the film has fewer colours.
        assert changes(shown[..., :3] * 255.0, frame) < 600
