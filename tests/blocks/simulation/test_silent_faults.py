"""What used to go wrong in silence: it is told of, refused, or rebuilt."""

import copy
import pickle
import warnings

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks import (
    BlockError,
    Constant,
    Diagram,
    DivergenceError,
    Function,
    Gain,
    Integrator,
    ParameterError,
    Ramp,
    Saturation,
    Session,
    SimulationError,
    SimulationInterrupted,
    Simulator,
    Step,
    linearize,
    simulate,
)
from trussflow.blocks.framework.errors import SimulationWarning
from trussflow.blocks.simulation.run import Run


def falling():
    """Return a root of what falls below zero after t = 0.5 s."""
    diagram = Diagram("falling")
    ramp, root = diagram.add(ramp=Ramp(-1.0, initial_value=0.5), root=Function(np.sqrt))
    ramp >> root
    return diagram


def lag(source):
    diagram = Diagram("lag")
    source, i = diagram.add(source=source, i=Integrator())
    source >> i
    return diagram


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_output_that_stops_being_finite_is_told_of_at_the_users_line(backend):
    with pytest.warns(SimulationWarning, match=r"'root\.y' stopped being finite at t = 0\.6 s") as caught:
        result = simulate(falling(), 1.0, step=0.1, backend=backend)
    assert caught[0].filename == __file__
    assert result.sizes["time"] == 11
    assert result.attrs["status"] == "complete"
    assert result.attrs["not_finite"] == "'root.y' stopped being finite at t = 0.6 s"


@pytest.mark.parametrize("to_disk", [False, True])
def test_run_stops_where_an_output_stops_being_finite(to_disk, tmp_path):
    path = tmp_path / "run.nc" if to_disk else None
    with pytest.raises(DivergenceError, match=r"'root\.y' stopped.* t = 0\.6 s; the log") as caught:
        simulate(falling(), 1.0, step=0.1, backend="interpreted", not_finite="stop", stream_to=path)
    result = caught.value.result
    assert isinstance(result, xr.Dataset)
    np.testing.assert_allclose(result["time"].values, np.arange(6) / 10, rtol=0, atol=1e-15)


@pytest.mark.parametrize("to_disk", [False, True])
def test_run_stops_there_also_if_a_state_stops_being_finite_soon_after(to_disk, tmp_path):
    """The error of the log came while that of the state was handled, and had no result."""
    diagram = falling()
    diagram.blocks["root"] >> diagram.add(i=Integrator())
    path = tmp_path / "run.nc" if to_disk else None
    with pytest.raises(DivergenceError, match=r"^'root\.y' stopped.* t = 0\.6 s; the log") as caught:
        simulate(
            diagram,
            1.0,
            step=0.1,
            solver="euler",
            backend="interpreted",
            progress=False,
            not_finite="stop",
            stream_to=path,
        )
    assert isinstance(caught.value.result, xr.Dataset)
    assert caught.value.result.sizes["time"] == 6
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"] * to_disk


@pytest.mark.parametrize("to_disk", [False, True])
def test_ctrl_c_after_an_output_stopped_being_finite_is_ctrl_c(to_disk, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    path = tmp_path / "run.nc" if to_disk else None
    monkeypatch.setattr(Run, "finish", stopped)
    with pytest.raises(SimulationInterrupted, match="stopped at t = 1 s") as caught:
        simulate(falling(), 1.0, step=0.1, backend="interpreted", not_finite="stop", stream_to=path)
    assert isinstance(caught.value.result, xr.Dataset)
    assert caught.value.result.sizes["time"] == 6
    assert [p.name for p in tmp_path.iterdir()] == ["run.nc"] * to_disk


def test_ignoring_says_nothing_and_other_words_are_refused():
    simulate(falling(), 1.0, step=0.1, backend="interpreted", not_finite="ignore")
    with pytest.raises(SimulationError, match="unknown way to treat what is not finite 'raise'"):
        simulate(falling(), 1.0, step=0.1, backend="interpreted", not_finite="raise")


def test_jump_between_two_steps_is_told_of_once():
    with pytest.warns(SimulationWarning, match=r"'source\.y' jumps at t = 0\.105 s") as caught:
        simulate(lag(Step(0.105)), 1.0, step=0.01, backend="interpreted")
    assert len(caught) == 1


def test_what_does_not_jump_or_drives_nothing_is_not_told_of():
    """Break points, but no jump; and a jump that nobody sees."""
    diagram = lag(Ramp(1.0, start_time=0.105))
    diagram.add(unseen=Step(0.105))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(diagram, 1.0, step=0.01, backend="interpreted")


@pytest.mark.parametrize("time", [0.1, 2.5])
def test_jump_at_a_step_or_after_the_end_is_fine(time):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(lag(Step(time)), 1.0, step=0.01, backend="interpreted")


def test_checks_between_parameters_hold_in_runs_and_sessions():
    diagram = Diagram("d")
    one, s = diagram.add(one=Constant(5.0), s=Saturation(-1.0, 1.0))
    one >> s
    diagram.expose(y=s.y)
    simulator = Simulator(diagram, step=0.1, backend="interpreted")
    with pytest.raises(ParameterError, match=r"'lower' of block 's' is 3\.0, but 'upper' is 1\.0"):
        simulator.run(1.0, parameters={"s.lower": 3.0})
    assert simulator.run(1.0, parameters={"s.lower": 3.0, "s.upper": 4.0})["s.y"][-1] == 4.0
    with Session(diagram, step=0.1, backend="interpreted") as session:
        session.tune({"s.upper": 4.0})
        session.tune({"s.lower": 3.0})  # beside what was tuned before, not beside the block's own
        with pytest.raises(ParameterError, match="must not exceed"):
            session.tune({"s.upper": 2.0})
        assert session.outputs["y"] == 4.0


@pytest.mark.parametrize(
    ("unit", "hint"), [("newtn", "did you mean 'newton'"), ("Nm", r"'N\*m'"), (3, "is text")]
)
def test_unknown_units_are_refused_where_they_are_declared(unit, hint):
    with pytest.raises(BlockError, match=rf"Constant\.y.*{hint}"):
        Constant(1.0, unit=unit)


def test_simulators_and_sessions_are_rebuilt_by_pickle_and_copy():
    simulator = Simulator(lag(Constant(2.0)), step=0.1, backend="interpreted", log=["i.y"])
    for other in (pickle.loads(pickle.dumps(simulator)), copy.deepcopy(simulator)):
        assert other.run(1.0)["i.y"].identical(simulator.run(1.0)["i.y"])
    session = Session(Integrator(), step=0.1, backend="interpreted")
    with pickle.loads(pickle.dumps(session)) as other:
        other.set(u=2.0)
        other.advance(0.5)
        assert other.outputs["y"] == pytest.approx(1.0, rel=0, abs=1e-12)
        with pytest.raises(SimulationError, match=r"it is started; pickle what save\(\) returns"):
            pickle.dumps(other)


def test_linear_models_are_rebuilt_by_pickle():
    diagram = Diagram("d")
    g, i = diagram.add(g=Gain(2.0), i=Integrator())
    g >> i
    diagram.expose(u=g.u, y=i.y)
    model = linearize(diagram)
    other = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(other.B, model.B)
    assert (other.input_labels, other.name) == (model.input_labels, model.name)
