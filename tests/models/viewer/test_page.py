"""The file of a page, without a browser: what is in it, how large it is, and what is refused."""

import base64
import json
import re
import zlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks.simulation.results import save
from trussflow.models import ModelError, SpaceTruss
from trussflow.models.robots.urdf_reading import Pose
from trussflow.models.robots.visuals import Visual
from trussflow.models.viewer import Section, page, replay, still
from trussflow.models.viewer.__main__ import main
from trussflow.models.viewer.motion import FRAME
from trussflow.models.viewer.packing import Packer
from trussflow.models.viewer.solids import TRIANGLES

LARGEST = 8e6  # bytes of a page
PLOTLY = 2.2e6  # bytes of the library in it, about
MakeRun = Callable[..., xr.Dataset]


class Content:
    """What a page carries, read as the page does."""

    def __init__(self, file):
        text = file.read_text(encoding="utf-8")
        parts = dict(re.findall(r'<script type="[a-z/]+" id="(\w+)">(.*?)</script>', text, re.DOTALL))
        self.head: dict[str, Any] = json.loads(parts["head"])
        self._blob = zlib.decompress(base64.b64decode(parts["blob"]))

    def array(self, at):
        count, width = int(np.prod(at["shape"])), at["width"]
        raw = np.frombuffer(self._blob, np.uint8, count * width, at["offset"]).reshape(width, count)
        return np.ascontiguousarray(raw.T).view(f"<f{width}").reshape(at["shape"])


def test_page_carries_what_was_logged(page_file, run):
    content = Content(page_file)
    (shown,) = content.head["runs"]
    q = run["truss.coordinates"].values.T
    np.testing.assert_array_equal(content.array(shown["time"])[0], run["time"])
    np.testing.assert_array_equal(content.array(shown["root"]), q[:6])
    np.testing.assert_array_equal(content.array(shown["modes"]), q[-6:].astype(np.float32))
    (force,) = (signal for signal in shown["signals"] if signal["name"] == "truss.base_force")
    expected = run["truss.base_force"].values.reshape(len(run["time"]), -1).T
    np.testing.assert_allclose(content.array(force["values"]), expected, rtol=1e-4, atol=0)
    assert (force["units"], force["inner"], force["components"][4]) == ("N", 3, "robot 2 y")
    assert content.head["shown"] == ["law.error", "truss.base_force", "truss.base_torque", "truss.energy"]
    assert content.head["target"] == run.attrs["target"].tolist()
    text = page_file.read_text(encoding="utf-8")
    assert "run: 401 instants were logged, 401 are in the picture, 401 in the charts" in text


def test_no_signal_is_taken_for_the_target(truss, run, tmp_path):
    """Users may call a signal as they like: where to, missions say, or `target` does."""
    said = run.drop_attrs()
    assert Content(replay(said, truss, tmp_path / "page.html")).head["target"] is None
    goal = np.linspace(0.0, 1.0, truss.rigid)
    assert Content(replay(run, truss, tmp_path / "page.html", target=goal)).head["target"] == goal.tolist()
    with pytest.raises(ModelError, match="target has shape"):
        replay(said.assign_attrs(target=[1.0, 2.0]), truss, tmp_path / "page.html")
    with pytest.raises(ModelError, match="target"):
        replay(said.assign_attrs(target="north"), truss, tmp_path / "page.html")


def test_a_quaternion_is_carried_as_it_is(make_run, tmp_path):
    """Seven numbers of the root, here and where it is to be."""
    truss = SpaceTruss.consistent(modes=0).with_quaternion()
    goal = truss.turned(np.array([0.5, 0.5, 0.5, 0.5])).parameters["initial_coordinates"]
    run = make_run(truss).assign_attrs(target=goal.tolist())
    q = run["truss.coordinates"].values
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1)[:, None]
    content = Content(replay(run, truss, tmp_path / "turned.html"))
    (shown,) = content.head["runs"]
    np.testing.assert_array_equal(content.array(shown["root"]), q.T[:7])
    assert content.head["target"] == goal.tolist()


def test_kept_bits_round_to_the_nearest(rng):
    values = rng.standard_normal((3, 1000)) * 10.0 ** rng.uniform(-30, 30, (3, 1000))
    content = Content.__new__(Content)
    for width, bits, error in ((4, 52, 2.0**-24), (4, 13, 2.0**-14), (8, 52, 0.0)):
        packer = Packer()
        packer.pack([[1.0]])  # what lies before
        at = packer.pack(values, width=width, bits=bits)
        content._blob = zlib.decompress(base64.b64decode(packer.blob()))
        np.testing.assert_allclose(content.array(at), values, rtol=error * 1.001, atol=0)


def test_joints_that_wind_up_stay_where_they_were(truss, run, tmp_path):
    """Of arms of some metres a joint error of 2e-7 rad is within 1e-6 m, however often a joint has turned."""
    values = run["truss.coordinates"].values.copy()
    values[:, 6 : truss.rigid] *= 1e4
    content = Content(
        replay(run.assign({"truss.coordinates": (("time", "c"), values)}), truss, tmp_path / "p.html")
    )
    joints = content.array(content.head["runs"][0]["joints"])
    np.testing.assert_allclose(joints, values.T[6 : truss.rigid], rtol=0, atol=2e-7)


@pytest.mark.parametrize("seed", range(3))
def test_whatever_was_flown_the_page_fits(seed, truss, make_run, tmp_path, monkeypatch):
    """Noise hardly compresses; what is not of the run, or does not change in time, takes room as well."""
    rng = np.random.default_rng(seed)
    largest = int(PLOTLY + 10.0 ** rng.uniform(5.3, 6.0))
    monkeypatch.setattr(page, "LARGEST", largest)
    run = make_run(truss, duration=float(rng.uniform(1.0, 60.0)), step=float(rng.choice([0.001, 0.02])))
    noise = rng.standard_normal((len(run["time"]), int(rng.integers(1, 60))))
    run = run.assign(noise=(("time", "k"), noise))
    rods = np.argwhere(rng.random((len(truss.dynamics.modes.masses),) * 2) < 0.5)
    file = replay(run, truss, tmp_path / "page.html", rods=rods, sections=[Section("Text", "x" * 20_000)])
    assert file.stat().st_size <= largest
    (shown,) = Content(file).head["runs"]
    assert shown["time"]["shape"][1] >= 2
    time = Content(file).array(shown["time"])[0]
    assert (time[0], time[-1]) == (run["time"][0], run["time"][-1])
    assert file.stat().st_size > 0.6 * largest or len(time) > run["time"][-1] / FRAME


def test_what_cannot_fit_is_refused(truss, run, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "LARGEST", 100_000)
    with pytest.raises(ModelError, match=r"page of 0.1 MB: truss, sections .* take \d\.\d MB; give"):
        replay(run, truss, tmp_path / "page.html")


def test_fine_meshes_become_coarser_until_they_fit(truss, make_run, tmp_path):
    """Half a million triangles on four robots: a ball of one metre stays one; what is left out is said."""
    turns, rows = 2.0 * np.pi * np.arange(500) / 500, np.linspace(0.0, np.pi, 251)
    ball = np.stack(
        [
            np.outer(np.sin(rows), np.cos(turns)),
            np.outer(np.sin(rows), np.sin(turns)),
            np.outer(np.cos(rows), np.ones(500)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in ball]
    at = np.arange(1, 250 * 500 + 1)
    beside = at - (at - 1) % 500 + at % 500
    lines += [f"f {a} {b} {c} {d}" for a, b, c, d in zip(at, beside, beside + 500, at + 500, strict=True)]
    (tmp_path / "ball.obj").write_text("\n".join(lines), encoding="utf-8")
    pose = Pose(np.eye(3), np.zeros(3))
    looks = [Visual(3, pose, "mesh", np.ones(3), tmp_path / name) for name in ("ball.obj", "hood.dae")]
    arms = tuple(replace(arm, name="carrier", visuals=tuple(looks)) for arm in truss.dynamics.arms)
    plant = SpaceTruss(replace(truss.dynamics, arms=arms))
    file = replay(make_run(plant, duration=1.0), plant, tmp_path / "fine.html")
    assert file.stat().st_size < 0.4 * LARGEST
    content = Content(file)
    solids = [arm["solid"] for arm in content.head["runs"][0]["truss"]["arms"]]
    for solid in solids:
        points, faces = content.array(solid["points"]), content.array(solid["faces"]).T.astype(int)
        assert 1000 < len(faces) <= TRIANGLES // 4
        np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, rtol=0, atol=1e-5)
        a, b, c = np.moveaxis(points[faces], 1, 0)
        enclosed = abs(np.sum(a * np.cross(b, c)) / 6.0)
        assert enclosed == pytest.approx(4.0 / 3.0 * np.pi, rel=0.02)
        assert set(solid["bodies"]) == {3}
    assert "Drawn are carrier without hood.dae, which is none of .stl, .obj." in file.read_text(
        encoding="utf-8"
    )


def test_short_runs_are_shown_as_they_were_logged(truss, make_run, tmp_path):
    run = make_run(truss, duration=0.04, step=0.001)
    content = Content(replay(run, truss, tmp_path / "short.html"))
    np.testing.assert_array_equal(content.array(content.head["runs"][0]["time"])[0], run["time"])


@pytest.mark.parametrize("others", [0, 1])
def test_long_runs_with_all_signals_fit(truss, make_run, tmp_path, others):
    """80 s at 50 instants a second, 350 signals; of two such runs charts show fewer instants."""
    rng = np.random.default_rng(8)
    run = make_run(truss, duration=80.0)
    for k in range(8):
        values = np.cumsum(rng.standard_normal((len(run["time"]), 34)), axis=0)
        run[f"more_{k}"] = (("time", "task"), values)
    file = replay(run, truss, tmp_path / "long.html", other=run if others else None)
    content = Content(file)
    assert file.stat().st_size < LARGEST
    for shown in content.head["runs"]:
        time = content.array(shown["time"])[0]
        assert (time[0], time[-1]) == (0.0, 80.0)
        assert np.diff(time).max() < 1.01 * FRAME
        assert np.diff(content.array(shown["signalTime"])[0]).max() < (2.5 if others else 1.1) * FRAME


def test_dense_logs_are_thinned_to_instants_that_were_logged(truss, make_run, tmp_path):
    run = make_run(truss, duration=1.0, step=0.001)
    time = Content(replay(run, truss, tmp_path / "dense.html"))
    shown = time.array(time.head["runs"][0]["time"])[0]
    assert len(shown) == 51
    assert np.isin(shown, run["time"]).all()


def without(run, *names):
    return run.drop_vars(names)


def half_written(run, folder):
    file = save(run, folder / "run.nc")
    file.write_bytes(file.read_bytes()[:20_000])
    return file


def of_another_tool(_, folder):
    (folder / "run.nc").write_text("time;x\n0;1\n", encoding="utf-8")
    return folder / "run.nc"


def not_finite(run):
    values = run["truss.coordinates"].copy()
    values[100:] = np.nan
    return run.assign({"truss.coordinates": values})


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda run, _: without(run, "truss.coordinates"),
            r"log truss.coordinates, or truss.task_position and",
        ),
        (lambda run, _: run.isel(coordinate=slice(0, 38)), r"has 38 numbers an instant, this"),
        (
            lambda run, _: run.isel(robot=slice(0, 3)),
            r"'truss.base_force' has 9 numbers an instant, this truss 12",
        ),
        (lambda run, _: run.isel(time=slice(0, 1)), r"ascends, here there are 1"),
        (lambda run, _: run.isel(time=slice(None, None, -1)), r"a coordinate 'time' in seconds that ascends"),
        (lambda run, _: run.rename(time="t"), r"a coordinate 'time' in seconds"),
        (lambda run, _: not_finite(run), r"'truss.coordinates' is not finite at t = 2 s; cut it off"),
        (half_written, r"no whole netCDF file of a run"),
        (of_another_tool, r"no whole netCDF file of a run"),
        (lambda _, folder: folder / "none.nc", r"there is no such file"),
        (lambda run, _: run["truss.energy"], r"cannot show DataArray"),
        (
            lambda run, _: run.assign({"truss.coordinates": ("time", ["a"] * len(run["time"]))}),
            r"it has truss.base_force, truss.base_torque, law.error",
        ),
    ],
)
def test_what_is_no_run_of_the_truss_is_one_clear_error(spoil, message, truss, run, tmp_path):
    with pytest.raises(ModelError, match=message):
        replay(spoil(run, tmp_path), truss, tmp_path / "page.html")
    with pytest.raises(ModelError, match=message):
        replay(run, truss, tmp_path / "page.html", other=spoil(run, tmp_path))
    assert not (tmp_path / "page.html").exists()


def test_which_truss_is_said_once(run, tmp_path):
    with pytest.raises(ModelError, match="cannot tell which truss flew"):
        replay(run, None, tmp_path / "page.html")
    with pytest.raises(ModelError, match="no truss 'other'; choose from: published"):
        replay(run, "other", tmp_path / "page.html")
    with pytest.raises(ModelError, match="target has shape"):
        replay(run, "published", tmp_path / "page.html", target=[1.0])
    with pytest.raises(ModelError, match="names must be those of the two runs"):
        replay(run, "published", tmp_path / "page.html", names=["one"])
    with pytest.raises(ModelError, match="names must be those of the two runs, got None"):
        replay(run, "published", tmp_path / "page.html", names=None)  # type: ignore[arg-type]
    with pytest.raises(ModelError, match="cannot write the page"):
        replay(run, "published", tmp_path / "no" / "page.html")
    assert replay(run.assign_attrs(plant="published"), None, tmp_path / "page.html").is_file()
    with pytest.raises(
        ModelError, match=r"result says 'frame', known are published, .* open the index.html that"
    ):
        replay(run.assign_attrs(plant="frame"), None, tmp_path / "page.html")


def test_charts_of_sections_are_of_signals_logged(truss, run, tmp_path):
    chart, odd = '<div data-signal="{}"></div>', run.rename({"law.error": "a&b"})
    assert replay(odd, truss, tmp_path / "p.html", sections=[Section("A", chart.format("a&amp;b"))]).is_file()
    with pytest.raises(ModelError, match=r"section 'B': no signal 'c' is there, but truss\.coord"):
        replay(run, truss, tmp_path / "p.html", sections=[Section("B", chart.format("c"))])


def test_a_truss_of_other_points_needs_its_rods(random_system, make_run, tmp_path):
    truss = SpaceTruss(random_system((2, 3), 4, elastic_integrals=True))
    run = make_run(truss)
    with pytest.raises(ModelError, match="do not say which points its rods join; give them as rods"):
        replay(run, truss, tmp_path / "page.html")
    for rods in ([[0, 15]], [0, 1], [[0.5, 1]], [[0, 1], [2]], "all"):
        with pytest.raises(ModelError, match="pairs of its 15 points, counted from 0"):
            replay(run, truss, tmp_path / "page.html", rods=rods)
    assert replay(run, truss, tmp_path / "page.html", rods=[[0, 14]]).is_file()


def test_text_of_the_user_cannot_end_the_script(run, truss, tmp_path):
    odd = run.rename({"truss.energy": "</script><b>"})
    file = replay(
        odd, truss, tmp_path / "page.html", title="<i>$x & co", sections=[Section("<u>", "<p>$5</p>")]
    )
    text = file.read_text(encoding="utf-8")
    assert "<title>&lt;i&gt;$x &amp; co</title>" in text
    assert "<h2>&lt;u&gt;</h2><p>$5</p>" in text
    assert "</script><b>" in [signal["name"] for signal in Content(file).head["runs"][0]["signals"]]


def test_command_line(run, tmp_path, capsys):
    file, page = save(run, tmp_path / "run.nc"), tmp_path / "page.html"
    assert main([str(file), "--truss", "consistent", "--output", str(page)]) == 0
    assert f"open {page}" in capsys.readouterr().out
    assert main([str(tmp_path / "none.nc"), "--output", str(page)]) == 2
    assert capsys.readouterr().err.startswith("error: cannot show")
    words = ["--truss", "consistent", "--names", "a", "b", "--output", str(page)]
    assert main([str(file), str(file), *words]) == 0
    assert [each["name"] for each in Content(page).head["runs"]] == ["a", "b"]
    capsys.readouterr()
    assert main([str(file), "--truss", "consistent", "--output", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"page": str(page), "picture": None}
    assert main([str(page)]) == 2
    assert "is a page: open it in a browser, or name a picture" in capsys.readouterr().err


def test_pictures_say_what_is_missing(page_file, tmp_path, monkeypatch):
    with pytest.raises(ModelError, match="there is no such file; replay writes it"):
        still(tmp_path / "none.html", tmp_path / "none.png", time=1.0)
    with pytest.raises(ModelError, match="no camera 'below'; choose from: oblique"):
        still(page_file, tmp_path / "none.png", time=1.0, camera="below")
    monkeypatch.setenv("BROWSER_PATH", "")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ModelError, match="no Chromium or Chrome is found; install one"):
        still(page_file, tmp_path / "none.png", time=1.0)
    monkeypatch.setenv("BROWSER_PATH", str(tmp_path / "none"))
    with pytest.raises(ModelError, match=r"cannot take a picture with '.*none'"):
        still(page_file, tmp_path / "none.png", time=1.0)
