"""Results: what is logged and when, units and axes, provenance, files."""

import json
import os
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Output,
    Parameter,
    PythonFunction,
    Saturation,
    Session,
    Simulator,
    State,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.errors import (
    NameLookupError,
    ParameterError,
    SimulationError,
    TrussflowError,
    WiringError,
)
from trussflow.blocks.framework.port import Inferable
from trussflow.blocks.results.conversions import plot, to_control, to_pandas
from trussflow.blocks.results.dataset import load, save

ROUND_OFF = 1e-12  # of times, sums of some hundred steps


AXES = ("x", "y", "z")


class Truss(Block):
    f = Input((2,), unit="N", frame="body", meaning="force")
    q = Output(
        (2, 3),
        unit="m",
        frame="world",
        meaning="deflection",
        labels={"node": (1, 2), "axis": AXES},
    )
    pose = Output((2,), unit=("m", "rad"), labels={"axis": ("place", "turn")})
    mixed = Output(
        5,
        unit=("m",) * 3 + ("rad",) * 2,
        labels={"axis": AXES, "angle": ("phi", "psi")},
    )
    energy = Output(meaning="no unit")
    lag = Output(unit="seconds")
    mass = Parameter(2.0, unit="kg")
    x = State((2,), unit="m", initial=1.0, labels=("a", "b"))

    def output(self, t, x, u, p):
        rows = np.stack([x.x, x.x, t * x.x])
        mixed = np.concatenate([x.x, x.x, x.x[:1]])
        return {
            "q": np.transpose(rows),
            "pose": x.x,
            "mixed": mixed,
            "energy": x.x[0] ** 2,
            "lag": t,
        }

    def derivative(self, t, x, u, p):
        return {"x": u.f / p.mass - x.x}


class Push(Block):
    f = Output((2,), unit="N", frame="body")

    def output(self, t, x, u, p):
        return {"f": np.stack([t, 2.0 * t])}


def diagram():
    found = Diagram("mission")
    truss, push = found.add(truss=Truss(), push=Push())
    push >> truss
    return found


def run(duration=1.0, *, item=None, backend="interpreted", **settings):
    return simulate(item or diagram(), duration, step=0.1, backend=backend, **settings)


@pytest.fixture(scope="module")
def result():
    return run()


def test_all_outputs_are_logged_with_units_frames_and_axes(result):
    assert set(result) == {
        "truss.q",
        "truss.pose",
        "truss.mixed",
        "truss.energy",
        "truss.lag",
        "push.f",
    }
    assert result["truss.q"].dims == ("time", "node", "axis")
    assert result["truss.q"].attrs == {
        "long_name": "deflection",
        "source": "truss.q",
        "units": "m",
        "frame": "world",
    }
    assert "units" not in result["truss.energy"].attrs
    assert result["truss.pose"].attrs["units"] == "m, rad"
    assert result.time.attrs["units"] == "s"
    assert_allclose(
        result["truss.q"][:, 1, 2],
        result["truss.pose"][:, 1] * result.time,
        rtol=ROUND_OFF,
    )


def test_signals_of_one_shape_share_their_axis_and_others_have_their_own(result):
    """Their difference is taken element by element, not every element with every other."""
    assert result["truss.pose"].dims == ("time", "axis_2")
    same = run(log={"force": "push.f", "twice": "truss.f"})
    assert (same["force"] - same["twice"]).shape == (11, 2)


def test_labels_follow_wires_and_slices_and_are_kept_in_files(tmp_path):
    found = diagram()
    limit, part = found.add(limit=Saturation(-9.0, 9.0), part=Saturation(-9.0, 9.0))
    found.truss.pose >> limit
    found.truss.mixed[2:] >> part
    log = [limit.y, part.y, "truss.x", "truss.mixed", found.truss.mixed[3:]]
    result = run(0.3, item=found, log=log)
    dims = ["axis", "coordinate", "coordinate_2", "coordinate_3", "angle"]
    assert [signal.dims[1] for signal in result.values()] == dims
    assert [*result["truss.mixed"]["coordinate_3"].values] == [
        "x",
        "y",
        "z",
        "phi",
        "psi",
    ]
    assert_array_equal(
        result["limit.y"].sel(axis="turn"), result["truss.x"].sel(coordinate_2="b")
    )
    streamed = run(0.3, item=found, log=log, stream_to=tmp_path / "run.nc")
    xr.testing.assert_equal(streamed.load(), result)


def test_labels_that_do_not_fit_the_shape():
    port = replace(Truss().mixed, inferable_labels=Inferable(("x",), fixed=True))
    with pytest.raises(
        WiringError, match=r"'Truss\.mixed' has labels for \(1,\) .* shape is \(5,\)"
    ):
        port.axes()


def test_diagram_hash_depends_on_the_equations_alone(result):
    """Other values, other logs and another backend leave it; another equation does not."""
    reference = result.attrs["diagram_hash"]
    assert (
        run(log=["push.f"], parameters={"truss.mass": 3.0}).attrs["diagram_hash"]
        == reference
    )
    assert run(backend="numpy").attrs["diagram_hash"] == reference
    larger, slower = diagram(), diagram()
    larger.ground(larger.add(second=Truss()).f)
    slower.push.sampled(0.2)
    for other in (larger, slower):
        assert run(item=other).attrs["diagram_hash"] != reference


def test_logged_ports_by_name_port_slice_and_input():
    found = diagram()
    log = {
        "force": "truss.f",
        "second": found.truss.f[1],
        "corner": found.truss.q[0, :2],
        "axis": "truss.pose",
    }
    result = run(0.2, item=found, log=log)
    assert list(result) == ["force", "second", "corner", "axis"]
    assert result["force"].attrs == {
        "long_name": "force",
        "source": "truss.f",
        "units": "N",
        "frame": "body",
    }
    assert_allclose(result["second"], [0.0, 0.2, 0.4], rtol=ROUND_OFF)
    assert_array_equal(result["second"], result["force"][:, 1])
    assert_array_equal(result["corner"], result["axis"][:, [0, 0]])
    result = run(
        0.2, item=found, log=[found.push.f, found.truss.q[0, :2], "truss.energy"]
    )
    assert list(result) == ["push.f", "truss.q[0, :2]", "truss.energy"]


@pytest.mark.parametrize(
    "log, cause, message",
    [
        (
            ["truss.q", "truss.q"],
            SimulationError,
            "ports are to be logged twice: truss.q",
        ),
        (
            ["truss.qq"],
            NameLookupError,
            "'truss' .* has no port 'qq'; inputs: f; outputs: q, pose",
        ),
        (
            ["tras.q"],
            NameLookupError,
            "no block 'tras' for 'tras.q'; the blocks are: truss, push",
        ),
        ([Truss().q], NameLookupError, "port 'Truss.q' is not in this diagram"),
        (
            {"time": "truss.q"},
            SimulationError,
            "cannot log .* as 'time': names are not empty",
        ),
        ({"a/b": "truss.q"}, SimulationError, "cannot log .* as 'a/b'"),
        ({"": "truss.q"}, SimulationError, "cannot log .* as ''"),
        ({1: "truss.q"}, SimulationError, "cannot log .* as 1"),
    ],
)
def test_what_cannot_be_logged(log, cause, message):
    with pytest.raises(cause, match=message):
        Simulator(diagram(), step=0.1, log=log)


def test_nothing_but_time_may_be_logged(backend):
    result = run(log=[], backend=backend)
    assert not list(result)
    assert_near(result.time, np.arange(11) / 10, ROUND_OFF)


@pytest.mark.parametrize(
    "solver, log_step, times",
    [
        ("rk4", None, np.arange(11) / 10),
        ("rk4", 0.3, [0.0, 0.3, 0.6, 0.9, 1.0]),
        ("rk4", 2.0, [0.0, 1.0]),
        ("RK45", None, np.arange(1001) / 1000),
        ("RK45", 0.3, [0.0, 0.3, 0.6, 0.9, 1.0]),
        ("RK45", 0.5, [0.0, 0.5, 1.0]),
        ("RK45", 0.35, [0.0, 0.35, 0.7, 1.0]),
        ("auto", 2.0, [0.0, 1.0]),
    ],
)
def test_log_step_and_the_last_instant(solver, log_step, times):
    result = run(solver=solver, log_step=log_step, backend="compiled")
    assert_near(result.time, times, ROUND_OFF)
    exact = 1.5 * np.exp(-result.time) + result.time / 2 - 0.5
    # RK4: h^4 / 120
    assert_near(result["truss.pose"][:, 0], exact, 1e-6)


def test_provenance():
    attrs = run(parameters={"truss.mass": 3.0}, initial={"truss.x": [4.0, 5.0]}).attrs
    assert json.loads(attrs["parameters"]) == {"truss.mass": [3.0]}
    assert json.loads(attrs["initial_states"]) == {"truss.x": [4.0, 5.0]}
    expected = {
        "diagram": "mission",
        "solver": "rk4",
        "backend": "interpreted",
        "duration": 1.0,
        "step": 0.1,
        "status": "complete",
        "numpy_version": np.__version__,
    }
    assert expected.items() <= attrs.items()
    assert {
        "trussflow_version",
        "python_version",
        "casadi_version",
        "created",
    } <= attrs.keys()


def test_save_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "run.nc"
    path.write_text("old")

    def full(_result, target, **_):
        Path(target).write_text("half")
        raise OSError("no space left on device")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", full)
    with pytest.raises(
        SimulationError, match=r"cannot write the result to .*run\.nc.*no space left"
    ):
        save(xr.Dataset(), path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("place", ["missing/run.nc", "file/run.nc", "folder"])
def test_path_that_cannot_be_written_is_an_error_before_the_run(place, tmp_path):
    def bomb(_):
        raise AssertionError("the run has begun")

    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    found = diagram()
    found.add(
        bomb=PythonFunction(
            bomb, 0.1, inputs={"u": Input(default=0.0)}, outputs={"y": Output()}
        )
    )
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SimulationError, match="cannot write the result to"):
        run(item=found, stream_to=tmp_path / place)
    with pytest.raises(SimulationError, match="cannot write the result to"):
        save(xr.Dataset(), tmp_path / place)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "name, message",
    [
        ("run.npz", r"results are netCDF files.*to_csv"),
        ("run.XLSX", r"results are netCDF files.*to_csv"),
        pytest.param(
            "run\\1.nc",  # of what stands before it the netCDF library would make a folder
            r"run\\1\.nc': netCDF takes a backslash as the separator",
            marks=pytest.mark.skipif(
                os.sep == "\\", reason="a backslash parts folders there"
            ),
        ),
    ],
)
def test_names_of_other_files_are_refused(name, message, result, tmp_path):
    with pytest.raises(SimulationError, match=message):
        save(result, tmp_path / name)
    with pytest.raises(SimulationError, match=message.removesuffix(".*to_csv")):
        run(0.1, stream_to=tmp_path / name)
    with pytest.raises(SimulationError, match="results are netCDF files"):
        run(0.1, stream_to=tmp_path / "run.csv")
    assert not list(tmp_path.iterdir())


def test_states_are_logged_by_path():
    """Continuous ones, those of sampled blocks, and in whatever order; exactly what outputs show."""
    found = diagram()
    delay = found.add("delay", UnitDelay(0.2))
    found.push.f[0] >> delay
    result = simulate(
        found, 1.0, step=0.1, log=["truss.x", "truss.pose", "delay.previous"]
    )
    assert_array_equal(result["truss.x"], result["truss.pose"])
    assert result["truss.x"].attrs == {
        "long_name": "truss.x",
        "source": "truss.x",
        "units": "m",
    }
    assert_near(result["delay.previous"][-2:], [0.8, 1.0], ROUND_OFF)
    named = simulate(found, 1.0, solver="RK45", log={"x": "truss.x"}, log_step=0.5)
    assert named["x"].shape == (3, 2)
    with Session(found, outputs=["truss.x"], step=0.1) as session:
        assert session.outputs["truss.x"].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("settings", [{"step": 0.05}, {"solver": "DOP853"}])
def test_runs_may_begin_at_any_time(settings):
    """Time goes on as it would have; the log and what is sampled count from the start."""
    found = diagram()
    found.push.f[0] >> found.add("hold", ZeroOrderHold(0.5))
    whole = simulate(found, 2.0, log_step=0.1, log=["truss.x", "push.f"], **settings)
    middle = {"truss.x": whole["truss.x"].sel(time=1.2, method="nearest").values}
    log = ["truss.x", "push.f", "hold.y"]
    rest = simulate(
        found, 0.8, start=1.2, initial=middle, log_step=0.1, log=log, **settings
    )
    assert_near(rest["time"], np.arange(12, 21) / 10, ROUND_OFF)
    # rtol of DOP853
    assert_near(rest["truss.x"], whole["truss.x"][12:], 1e-8)
    assert_near(rest["hold.y"], [1.2] * 5 + [1.7] * 4, ROUND_OFF)
    logged = simulate(found, 0.5, start=1.25, log_step=0.2, **settings)
    assert_near(logged["time"], [1.25, 1.45, 1.65, 1.75], ROUND_OFF)
    with pytest.raises(ParameterError, match="start must be numeric, not 'x'"):
        simulate(found, 1.0, start="x", **settings)


def test_results_in_other_forms(result, tmp_path):
    table = to_pandas(result)
    assert [*table][:3] == ["truss.q[1, x]", "truss.q[1, y]", "truss.q[1, z]"]
    assert_array_equal(table["truss.q[2, z]"], result["truss.q"][:, 1, 2])
    xr.testing.assert_identical(load(save(result, tmp_path / "run.nc")), result)
    response = to_control(result, ["truss.pose", "truss.energy"], ["push.f"])
    assert response.output_labels == [
        "truss.pose[place]",
        "truss.pose[turn]",
        "truss.energy",
    ]
    assert_array_equal(response.outputs[2], result["truss.energy"])
    assert_array_equal(response.inputs.T, result["push.f"])
    assert to_control(result, ["truss.energy"]).inputs is None
    figure = result.trussflow.plot("truss.q", "truss.energy", "truss.mixed")
    assert [axes.get_ylabel() for axes in figure.axes] == ["[m]", "", "[m, rad]"]
    assert [len(axes.lines) for axes in figure.axes] == [6, 1, 5]
    plt.close(figure)


@pytest.mark.parametrize(
    "call, message",
    [
        (
            lambda r: plot(r, "truss"),
            "cannot plot 'truss': the signals of the result are: truss.q, ",
        ),
        (lambda r: to_control(r, ["nothing"]), "cannot convert 'nothing': the signals"),
        (lambda r: to_control(r, []), "cannot convert no signals: name the outputs"),
        (lambda _: to_pandas(3), "cannot tabulate 3: it is no result of a run"),
        (lambda _: save(3, "run.nc"), r"cannot write to 'run\.nc' 3: it is no result"),
        (
            lambda _: load("run.csv"),
            r"cannot read a result from 'run\.csv': results are netCDF files",
        ),
        (
            lambda _: load("there/is/none.nc"),
            r"cannot read a result from 'there/is/none\.nc': ",
        ),
    ],
)
def test_other_objects_are_no_results(call, message, result):
    with pytest.raises(TrussflowError, match=message):
        call(result)
