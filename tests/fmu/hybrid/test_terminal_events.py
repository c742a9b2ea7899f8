"""A terminal event ends the run at its time, in simulations, groups, sessions, FMUs and plain C."""

import ctypes
import subprocess

import pytest
from fmpy import simulate_fmu
from numpy.testing import assert_allclose
from systems import assert_near, series

from trussflow.blocks import (
    Constant,
    Diagram,
    Gain,
    Integrator,
    Session,
    Step,
    StopWhen,
    cosimulate,
    enabled,
    gradient,
    simulate,
)
from trussflow.blocks.errors import RunEndedError
from trussflow.fmu import Fmu, export

END_TIME = 0.137
"""Time at which the integral of one passes its limit [s]; no step ends there."""


def ramp(end=END_TIME):
    """Return a diagram with y = t, whose run ends at the time `end` [s]."""
    d = Diagram("ramp")
    one, clock, stop = d.add(one=Constant(1.0), clock=Integrator(), stop=StopWhen("ok"))
    one >> clock
    clock.y - end >> stop
    d.expose(y=clock.y)
    return d


@pytest.mark.parametrize("backend", ["compiled", "interpreted", "numpy"])
@pytest.mark.parametrize(
    "settings", [{"step": 0.01}, {"solver": "RK45"}, {"solver": "Rodas5P"}]
)
def test_runs_end(backend, settings):
    result = simulate(ramp(), 1.0, backend=backend, log_step=0.01, **settings)
    assert result.attrs["status"] == "ended"
    words = result.attrs["ended"].split()
    assert words[:-3] == ["'stop'", "ended", "the", "run", "at", "t", "="]
    assert words[-2:] == ["s", "ok"]
    assert float(words[-3]) == pytest.approx(END_TIME, abs=1e-12)
    assert_near(result["time"][-1], 0.13, 1e-12)
    assert_near(result["clock.y"], result["time"], 1e-12)


def test_a_terminal_event_counts_in_a_group_that_runs():
    """The condition becomes true while the group is off, so that the run ends at the enabling."""
    group = series("group", stop=StopWhen())
    group.expose(u=group.stop.u)
    d = Diagram("grouped")
    signal, off, on, group = d.add(
        signal=Step(0.3, initial_value=-1.0),
        off=Step(0.2),
        on=Step(0.6),
        group=enabled(group),
    )
    signal >> group.u
    (1.0 - off.y + on.y) >> group.enable
    on >> d.add(clock=Integrator())
    ended = simulate(d, 1.0, step=0.1).attrs["ended"]
    assert ended == "'group.stop' ended the run at t = 0.6 s"


def test_a_session_ends_at_the_same_time_again():
    with Session(ramp(), step=0.01) as session:
        saved = session.save()
        for _ in range(2):
            session.restore(saved)
            session.advance(0.135)
            with pytest.raises(RunEndedError, match=rf"t = {END_TIME} s ok"):
                session.advance(1.0)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["cs", "me"])
@pytest.mark.parametrize("runs", [simulate, cosimulate])
def test_native_fmus_ask_to_end_the_run(version, kind, runs, exported):
    path = exported(ramp(), version, step=0.01)
    importer = Diagram("importer")
    settings = {"step": 0.05} if kind == "cs" else {}
    importer.add(fmu=Fmu(path, kind=kind, **settings))
    with pytest.raises(
        RunEndedError, match=rf"asks to end the run at t = {END_TIME}"
    ) as it:
        runs(importer, 1.0, step=0.05)
    result = it.value.result
    assert result.attrs["status"] == "ended"
    assert_near(result["time"][-1], 0.1, 1e-12)
    assert_near(result["fmu.y"], result["time"], 1e-12)


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_a_foreign_importer_ends_the_run(version, kind, exported):
    path = exported(ramp(), version, step=0.01)
    rows = simulate_fmu(
        str(path), stop_time=1.0, fmi_type=kind, output_interval=0.05, validate=False
    )
    assert rows["time"][-1] == pytest.approx(END_TIME, abs=0.013 + 1e-9)


def test_a_python_fmu_fails_in_the_step_with_the_event(tmp_path):
    path = export(ramp(), tmp_path / "ramp.fmu", kind="python", step=0.01)
    importer = series(fmu=Fmu(path, step=0.05))
    with pytest.raises(Exception, match=r"0\.1") as it:
        simulate(importer, 1.0, step=0.05)
    assert_near(it.value.result["time"][-1], 0.1, 1e-12)


def test_plain_c_returns_two(tmp_path):
    path = export(ramp(), tmp_path / "ramp.c", kind="c", step=0.05)
    library = tmp_path / "ramp.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-o", library, path, "-lm"], check=True)
    functions, memory = ctypes.CDLL(str(library)), ctypes.create_string_buffer(4096)
    functions.ramp_time.restype = ctypes.c_double
    functions.ramp_init(memory)
    assert [functions.ramp_step(memory) for _ in range(4)] == [0, 0, 2, 2]
    assert functions.ramp_time(memory) == 0.1


def test_gradients_of_runs_that_end_later():
    """The clock is q t: its derivative by q is t; a run that ends within the duration has no gradient."""
    d = series(one=Constant(1.0), gain=Gain(2.0), clock=Integrator())
    d.clock.y - 3.0 >> d.add(stop=StopWhen())

    def last(run):
        return run["clock.y"][-1]

    value, slopes = gradient(d, 1.0, last, {"gain.gain": 2.0}, step=0.1)
    assert_allclose([value, slopes["gain.gain"]], [2.0, 1.0], rtol=1e-12)
    with pytest.raises(RunEndedError, match=r"ended the run at t = 0\.75 s"):
        gradient(d, 1.0, last, {"gain.gain": 4.0}, step=0.1)
