"""The file of a page, without a browser: what is in it, how large it is, and what is refused."""

import base64
import json
import re
import sys
import zlib
from dataclasses import replace

import campaign
import numpy as np
import pytest
from browsing import unpacked
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import ConvexHull
from systems import assert_near

from trussflow.blocks.results.dataset import save
from trussflow.blocks.support.packing import packed
from trussflow.models import ModelError, SpaceTruss
from trussflow.models.robots.urdf_reading import Pose
from trussflow.models.robots.visuals import Visual
from trussflow.models.viewer import movie, page, replay, still
from trussflow.models.viewer.__main__ import main
from trussflow.models.viewer.solids import MAX_TRIANGLES

LARGEST = 4e6  # bytes of a page
SCRIPT_BYTES = 1e5  # bytes of the scripts in it, about
SEEDS = range(1, 3 * campaign.SIZE)


class Content:
    """What a page carries, read as the page does."""

    def __init__(self, file):
        self.size = file.stat().st_size
        self.text = file.read_text(encoding="utf-8")
        parts = dict(
            re.findall(
                r'<script type="[a-z/]+" id="(\w+)">(.*?)</script>',
                self.text,
                re.DOTALL,
            )
        )
        head = zlib.decompress(base64.b64decode(parts["head"]))
        self.head = json.loads(head, object_hook=unpacked)


@pytest.fixture
def content(tmp_path):
    """Return a function that writes a page and reads what it carries."""
    return lambda run, truss, **more: Content(
        replay(run, truss, tmp_path / "page.html", **more)
    )


def test_page_carries_what_was_logged(page_file, run):
    content = Content(page_file)
    shown = content.head
    q = run["truss.coordinates"].values.T
    assert_array_equal(shown["time"], run["time"])
    assert_allclose(shown["coordinates"], q, rtol=2.0**-33)
    (force,) = (
        signal for signal in shown["signals"] if signal["name"] == "truss.base_force"
    )
    expected = run["truss.base_force"].values.reshape(len(run["time"]), -1).T
    assert_allclose(force["values"], expected, rtol=1e-4)
    assert (force["units"], force["inner"], force["components"][4]) == ("N", 3, "2 y")
    assert shown["charted"] == [str(name) for name in run][:4]
    assert content.head["target"] == run.attrs["target"].tolist()
    assert "401 logged instants, 401 of them shown" in content.text


def test_no_signal_is_taken_for_the_target(truss, run, content):
    """Users may call a signal as they like: where to, missions say, or `target` does."""
    assert content(run.drop_attrs(), truss).head["target"] is None
    goal = np.linspace(0.0, 1.0, truss.rigid)
    assert content(run, truss, target=goal).head["target"] == goal.tolist()


def test_a_quaternion_is_carried_as_it_is(make_run, content):
    """Seven numbers of the root, here and where it is to be."""
    truss = SpaceTruss.consistent(modes=0).with_quaternion()
    goal = truss.turned(np.array([0.5, 0.5, 0.5, 0.5])).parameters[
        "initial_coordinates"
    ]
    run = make_run(truss).assign_attrs(target=goal.tolist())
    q = run["truss.coordinates"].values
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    found = content(run, truss)
    assert_allclose(found.head["coordinates"], q.T, rtol=2.0**-33)
    assert found.head["ends"] == [7, truss.rigid_q]
    assert found.head["target"] == goal.tolist()


def test_kept_bits_round_to_the_nearest(rng):
    values = rng.standard_normal((3, 1000)) * 10.0 ** rng.uniform(-30, 30, (3, 1000))
    values[0, :4] = np.nan, np.inf, -0.0, 1e-300
    for bits, error in ((24, 2.0**-24), (14, 2.0**-14), (53, 0.0)):
        at = json.loads(json.dumps(packed(values, bits)), object_hook=unpacked)
        assert_allclose(at, values, rtol=error * 1.001)
    assert_array_equal(np.signbit(at), np.signbit(values))


def test_joints_that_wind_up_stay_where_they_were(truss, run, content):
    """Of arms of some metres a joint error of 2e-7 rad is within 1e-6 m, however often a joint has turned."""
    values = run["truss.coordinates"].values.copy()
    values[:, 6 : truss.rigid] *= 1e4
    found = content(run.assign({"truss.coordinates": (("time", "c"), values)}), truss)
    joints = found.head["coordinates"][6 : truss.rigid]
    assert_near(joints, values.T[6 : truss.rigid], 2e-7)


@pytest.mark.parametrize("seed", [0, *map(campaign.only, SEEDS)])
def test_whatever_was_simulated_the_page_fits(
    seed, truss, make_run, content, monkeypatch
):
    """Noise hardly compresses; what is not of the run, or does not change in time, takes room as well."""
    rng = np.random.default_rng(seed)
    largest = int(SCRIPT_BYTES + 10.0 ** rng.uniform(5.3, 6.0))
    monkeypatch.setattr(page, "MAX_PAGE_BYTES", largest)
    run = make_run(
        truss, duration=rng.uniform(1.0, 60.0), step=rng.choice([0.001, 0.02])
    )
    noise = rng.standard_normal((len(run["time"]), rng.integers(1, 60)))
    run = run.assign(noise=(("time", "k"), noise))
    rods = np.argwhere(rng.random((len(truss.dynamics.modes.masses),) * 2) < 0.5)
    found = content(run, truss, rods=rods, sections={"Text": "x" * 20_000})
    assert found.size <= largest
    time = found.head["time"]
    assert len(time) >= 2
    assert (time[0], time[-1]) == (run["time"][0], run["time"][-1])
    assert found.size > 0.6 * largest or len(time) == len(run["time"])


def test_what_cannot_fit_is_refused(truss, run, content, monkeypatch):
    monkeypatch.setattr(page, "MAX_PAGE_BYTES", 50_000)
    with pytest.raises(
        ModelError, match=r"page of 0.05 MB: truss, sections .* take \d\.\d MB; use"
    ):
        content(run, truss)


def test_fine_meshes_become_coarser_until_they_fit(truss, make_run, content, tmp_path):
    """Many triangles on four robots: a ball of one metre stays one; what is left out is said."""
    ball = np.random.default_rng(0).standard_normal((10_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in ball]
    faces = ConvexHull(ball).simplices
    inward = np.linalg.det(ball[faces]) < 0.0
    faces[inward] = faces[inward, ::-1]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (tmp_path / "ball.obj").write_text("\n".join(lines), encoding="utf-8")
    pose = Pose(np.eye(3), np.zeros(3))
    looks = [
        Visual(3, pose, "mesh", np.ones(3), tmp_path / name)
        for name in ("ball.obj", "hood.dae")
    ]
    arms = tuple(
        replace(arm, name="carrier", visuals=tuple(looks))
        for arm in truss.dynamics.arms
    )
    plant = SpaceTruss(replace(truss.dynamics, arms=arms))
    found = content(make_run(plant, duration=1.0), plant)
    assert found.size < 0.4 * LARGEST
    for arm in found.head["truss"]["arms"]:
        solid = arm["solid"]
        points, faces = solid["points"], np.transpose(solid["faces"])
        assert 1000 < len(faces) <= MAX_TRIANGLES // 4
        assert_near(np.linalg.norm(points, axis=1), 1.0, 1e-5)
        a, b, c = np.moveaxis(points[faces], 1, 0)
        enclosed = abs(np.sum(a * np.cross(b, c)) / 6.0)
        assert enclosed == pytest.approx(4.0 / 3.0 * np.pi, rel=0.02)
        assert set(solid["bodies"]) == {3}
    assert (
        "Incomplete shapes: carrier without hood.dae, which is none of .stl, .obj."
        in found.text
    )


@pytest.mark.parametrize("duration", [0.04, 2.0, 40.0])
def test_charts_have_the_logged_instants_as_far_as_there_is_room(
    truss, make_run, content, duration
):
    """Fewer instants would show a fast vibration as a slow one."""
    run = make_run(truss, duration=duration, step=0.001)
    found = content(run, truss)
    time = found.head["time"]
    assert len(time) == len(run["time"]) or found.size > 0.6 * LARGEST
    assert np.isin(time, run["time"]).all()


def test_long_runs_with_all_signals_fit(truss, make_run, content, rng):
    """80 s at 50 instants a second, 350 signals."""
    run = make_run(truss, duration=80.0)
    for k in range(8):
        run[f"more_{k}"] = (
            ("time", "task"),
            np.cumsum(rng.standard_normal((len(run["time"]), 34)), axis=0),
        )
    found = content(run, truss)
    assert found.size < LARGEST
    time = found.head["time"]
    assert (time[0], time[-1]) == (0.0, 80.0)
    assert np.diff(time).max() < 0.042


def half_written(run, folder):
    file = save(run, folder / "run.nc")
    file.write_bytes(file.read_bytes()[:20_000])
    return file


def of_another_tool(_, folder):
    (folder / "run.nc").write_text("time;x\n0;1\n", encoding="utf-8")
    return folder / "run.nc"


def not_finite(run, _):
    return run.where(run["time"] < 2.0)


@pytest.mark.parametrize(
    "spoil, message",
    [
        (
            lambda run, _: run.drop_vars("truss.coordinates"),
            r"log its outputs coordinates, or task_position and",
        ),
        (
            lambda run, _: run.isel(coordinate=slice(0, 38)),
            r"has 38 elements instead of",
        ),
        (
            lambda run, _: run.isel(robot=slice(0, 3)),
            r"'truss.base_force' has 9 elements instead of 12",
        ),
        (
            lambda run, _: run.isel(time=slice(0, 1)),
            r"ascending instants in seconds; it has 1",
        ),
        (
            lambda run, _: run.isel(time=slice(None, None, -1)),
            r"coordinate 'time' must have two or more ascending",
        ),
        (lambda run, _: run.rename(time="t"), r"coordinate 'time' must have"),
        (not_finite, r"'truss.coordinates' is not finite at t = 2 s; remove the rest"),
        (half_written, r"not a complete netCDF file of a run"),
        (of_another_tool, r"not a complete netCDF file of a run"),
        (lambda _, folder: folder / "none.nc", r"No such file"),
        (lambda run, _: run["truss.energy"], r"cannot show DataArray"),
        (
            lambda run, _: run.assign(
                {"truss.coordinates": ("time", ["a"] * len(run["time"]))}
            ),
            r"it has truss.base_force, truss.base_torque, law.error",
        ),
    ],
)
def test_what_is_no_run_of_the_truss_is_one_clear_error(
    spoil, message, truss, run, tmp_path
):
    with pytest.raises(ModelError, match=message):
        replay(spoil(run, tmp_path), truss, tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize(
    "named, options, message",
    [
        (None, {}, "cannot show the run: the plant is None, not one of published"),
        ("other", {}, "the plant is 'other', not one of published"),
        ("published", {"target": [1.0]}, "target has shape"),
        ("published", {"target": "north"}, "target"),
        ("published", {"charts": ["c"]}, r"chart of 'c': the run has truss\."),
    ],
)
def test_options_that_make_no_sense(run, content, named, options, message):
    with pytest.raises(ModelError, match=message):
        content(run, named, **options)


def test_a_result_names_its_truss(run, content, tmp_path):
    with pytest.raises(ModelError, match="cannot write the page"):
        replay(run, "published", tmp_path / "no" / "page.html")
    assert content(run.assign_attrs(plant="published"), None).head
    with pytest.raises(
        ModelError,
        match=r"the plant is 'frame', not one of published, .* open the index.html that",
    ):
        content(run.assign_attrs(plant="frame"), None)


def test_a_truss_of_other_points_needs_its_rods(random_system, make_run, content):
    truss = SpaceTruss(random_system((2, 3), 4, elastic_integrals=True))
    run = make_run(truss)
    with pytest.raises(
        ModelError, match="do not say which points its rods join; give them as rods"
    ):
        content(run, truss)
    for rods in ([[0, 15]], [0, 1], [[0.5, 1]], [[0, 1], [2]], "all"):
        with pytest.raises(ModelError, match="pairs of its 15 points, counted from 0"):
            content(run, truss, rods=rods)
    assert content(run, truss, rods=[[0, 14]]).head


def test_text_of_the_user_cannot_end_the_script(run, truss, content):
    odd = run.rename({"truss.energy": "</script><b>"})
    found = content(odd, truss, title="<i>$x & co", sections={"<u>": "<p>$5</p>"})
    assert "<title>&lt;i&gt;$x &amp; co</title>" in found.text
    assert "<h2>&lt;u&gt;</h2><p>$5</p>" in found.text
    assert "</script><b>" in [signal["name"] for signal in found.head["signals"]]


def test_command_line(run, tmp_path, capsys):
    file, page = save(run, tmp_path / "run.nc"), tmp_path / "page.html"
    assert main([str(file), "--truss", "consistent", "--output", str(page)]) == 0
    assert f"open {page}" in capsys.readouterr().out
    assert main([str(tmp_path / "none.nc"), "--output", str(page)]) == 2
    assert capsys.readouterr().err.startswith("error: cannot show")
    assert (
        main([str(file), "--truss", "consistent", "--output", str(page), "--json"]) == 0
    )
    assert json.loads(capsys.readouterr().out) == {
        "page": str(page),
        "picture": None,
        "film": None,
    }
    assert main([str(page)]) == 2
    assert (
        "is a page: open it in a browser, or set --png or --movie"
        in capsys.readouterr().err
    )


def test_pictures_say_what_is_missing(page_file, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    missing, no_browser = tmp_path / "none.html", r"cannot take a picture with '.*none'"
    for file, camera, program, message in (
        (missing, "front", "", "there is no such file; replay writes it"),
        (page_file, "below", "", "no camera 'below'; choose from: oblique"),
        (page_file, "front", "", "no Chromium or Chrome is found; install one"),
        (page_file, "front", str(tmp_path / "none"), no_browser),
        (page_file, "front", sys.executable, "or the browser failed"),
    ):
        monkeypatch.setenv("BROWSER_PATH", program)
        with pytest.raises(ModelError, match=message):
            still(file, tmp_path / "none.png", time=1.0, camera=camera)
    with pytest.raises(ModelError, match=r"must end in \.gif"):
        movie(page_file, tmp_path / "run.avi")
