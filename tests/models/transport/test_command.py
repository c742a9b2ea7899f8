"""``python -m trussflow.models.transport``: files, names, and misuse."""

import json

import numpy as np
import pytest
import xarray as xr

from trussflow.models.transport import __main__ as command
from trussflow.models.transport.__main__ import main

VARIABLES = {
    "position_error": ("m", ("time", "axis")),
    "attitude_error_rate": ("rad/s", ("time", "angle")),
    "joint_torque": ("N*m", ("time", "joint")),
    "base_force": ("N", ("time", "robot", "axis")),
    "modal_coordinate": ("kg**0.5*m", ("time", "mode")),
    "energy": ("J", ("time",)),
}
OTHERS = {
    "attitude_error",
    "joint_error",
    "position_error_rate",
    "joint_error_rate",
    "base_torque",
    "grasp_displacement",
    "generalized_force",
    "disturbance",
    "disturbance_estimate",
    "sliding_variable",
}


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the figures, which take most of the time."""
    monkeypatch.setattr(command, "draw", lambda *_: None)


def test_files_and_variables(tmp_path, capsys):
    assert main(["--case", "1", "--duration", "0.2", "--output", str(tmp_path)]) == 0
    with xr.open_dataset(tmp_path / "result.nc") as result:
        for name, (unit, dims) in VARIABLES.items():
            assert result[name].dims == dims, name
            assert result[name].attrs["units"] == unit, name
        assert set(result.data_vars) >= OTHERS
        assert result["time"].values[-1] == pytest.approx(0.2)
        assert np.isfinite(result["energy"].values).all()
        assert result.attrs["status"] == "complete"
        assert result.attrs["allocation"] == "published"
        assert {"trussflow_version", "casadi_version", "parameters"} <= set(
            result.attrs
        )
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert {f["name"] for f in summary["figures"]} >= {
        "peak position error",
        "peak base torque",
    }
    assert (
        sorted(p.suffix for p in tmp_path.iterdir())
        == [".html", ".json", ".nc"] + [".png"] * 5
    )
    page, said = tmp_path / "index.html", capsys.readouterr().out
    *_, opened, figures = said.splitlines()  # the page is there before the figures
    assert f"open {page} in a browser" in opened
    assert f"written to {tmp_path}" in figures
    text = page.read_text(encoding="utf-8")
    for part in (
        "Summary",
        "peak base torque",
        "Parameters",
        "paper, section 4.2 (L)",
        "Provenance",
    ):
        assert part in text
    assert "casadi_version</td>" in text
    assert f"--case 1 --duration 0.2 --output {tmp_path}" in text
    assert "case_2" not in text
    assert "<h2>Diagram</h2><svg" in text


@pytest.mark.parametrize(
    "words", [["mission.toml", "--case", "1"], ["--case", "2", "mission.toml"]]
)
def test_mission_file_and_case_together_are_one_error(words, capsys):
    with pytest.raises(SystemExit) as caught:
        main(words)
    assert caught.value.code == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert all(word in said for word in ("--case", "not allowed with", "mission"))


@pytest.mark.usefixtures("undrawn")
def test_plant_and_observer_are_options(tmp_path):
    """The consistent plant gets the allocation that suits it; without observer the estimate is zero."""
    words = [
        "--plant",
        "consistent",
        "--observer",
        "off",
        "--duration",
        "0.05",
        "--output",
        str(tmp_path),
    ]
    assert main(words) == 0
    with xr.open_dataset(tmp_path / "result.nc") as result:
        assert result.attrs["allocation"] == "mode-neutral"
        assert not result["disturbance_estimate"].values.any()


@pytest.mark.parametrize(
    "words, message",
    [
        (["--duration", "0"], "simulation: duration is 0; it must be above 0"),
        (["--duration", "-1"], "simulation: duration is -1; it must be above 0"),
        (["--duration", "nan"], "simulation: 'duration' is not finite: nan"),
        (["--step", "0"], "simulation: step is 0; it must be above 0"),
        (["--step", "inf"], "simulation: 'step' is not finite: inf"),
        (
            ["--live", "--controller", "pd"],
            "--live needs the solver rk4, not Rodas5P: set --solver rk4",
        ),
        (
            ["--step", "0.003", "--duration", "1"],
            r"the duration of 1 s is not a whole number",
        ),
    ],
)
def test_nonsense_is_one_clear_line(words, message, tmp_path, capsys):
    assert main([*words, "--output", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert list(tmp_path.iterdir()) == []


def test_a_path_too_fast_for_the_actuators_is_run_if_asked_for(tmp_path, capsys):
    """Feasible in 53.75 s by `survey`."""
    fast = tmp_path / "fast.toml"
    fast.write_text(
        'title = "Fast"\nextends = "case_2.toml"\n[path]\nduration = "50 s"\n'
    )
    words = [str(fast), "--hardware", "flight", "--explain"]
    assert main(words) == 2
    assert "need at least 53.75 s for this path" in capsys.readouterr().err
    assert main([*words, "--infeasible"]) == 0
    assert (
        "need at least 53.75 s for the path, which takes 50 s"
        in capsys.readouterr().out
    )


def test_unwritable_output_is_found_before_anything_runs(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["--output", str(tmp_path / "file" / "results")]) == 2
    assert "cannot write to the output folder" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn", "ziglang")
def test_a_live_page_has_the_loop_and_the_scene(tmp_path):
    words = ["--duration", "0.2", "--output", str(tmp_path)]
    assert main(["--live", *words]) == 0
    live = (tmp_path / "live.html").read_text(encoding="utf-8")
    assert "controller.gamma" in live
    assert "Scene3d.panel" in live
    link, index = 'href="live.html"', tmp_path / "index.html"
    assert link in index.read_text(encoding="utf-8")
    assert main(words) == 0
    assert link not in index.read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_divergence_keeps_what_was_logged(tmp_path, capsys):
    """A step far beyond the stability limit: one message, and the log up to the end."""
    words = [
        "--controller",
        "pd",
        "--solver",
        "rk4",
        "--duration",
        "1",
        "--output",
        str(tmp_path),
    ]
    assert main(words) == 1
    assert "stopped being finite at t =" in capsys.readouterr().err
    with xr.open_dataset(tmp_path / "result.nc") as result:
        assert result.attrs["status"] == "diverged"
        assert np.isfinite(result["position_error"].values).all()
