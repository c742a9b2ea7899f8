"""What used to go wrong in silence: it is told of, refused, or rebuilt."""

import copy
import pickle
import warnings

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, series

from trussflow.blocks import (
    Block,
    Constant,
    Event,
    Function,
    Gain,
    Input,
    Integrator,
    Mode,
    Ramp,
    Saturation,
    Session,
    Simulator,
    Step,
    linearize,
    simulate,
)
from trussflow.blocks.errors import (
    BlockError,
    DivergenceError,
    ParameterError,
    SimulationError,
    SimulationInterrupted,
    SimulationWarning,
)
from trussflow.blocks.simulation.run import Run

SETTINGS = {"step": 0.1, "backend": "interpreted"}


def falling():
    """Return a root of what falls below zero after t = 0.5 s."""
    return series(ramp=Ramp(-1.0, initial_value=0.5), root=Function(np.sqrt))


@pytest.fixture(params=["memory", "disk"])
def path(request, tmp_path):
    """Return where a run writes, None in memory."""
    return tmp_path / "run.nc" if request.param == "disk" else None


def lag(source):
    return series(source=source, i=Integrator())


class Alarm(Block):
    """A clock that rings once: the time of the next ring becomes infinite."""

    ring = Event("time")
    following = Mode(0.25)

    def indicators(self, t, x, u, p):
        return {"ring": x.following}

    def on_event(self, t, x, u, p, fired):
        return {"following": np.inf}


def test_modes_that_become_infinite_are_logged():
    diagram = series(alarm=Alarm())
    result = simulate(
        diagram, 1.0, **SETTINGS, log=["alarm.following"], not_finite="stop"
    )
    assert_array_equal(result["alarm.following"], [0.25] * 3 + [np.inf] * 8)


class Timer(Block):
    """Counts rings at times that its input determines."""

    u, count = Input(), Mode()
    ring = Event("time")

    def indicators(self, t, x, u, p):
        return {"ring": u.u + x.count}

    def on_event(self, t, x, u, p, fired):
        return {"count": x.count + 1.0}


def test_an_event_whose_time_changes_between_events_is_refused():
    """It came late, or not at all: solvers look at the time of an event only after events."""
    diagram = series(source=Step(0.3), timer=Timer())
    with pytest.raises(BlockError, match=r"time of event 'ring' .* depends on input u"):
        simulate(diagram, 1.0, **SETTINGS)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
def test_output_that_stops_being_finite_warns_at_the_line_of_the_user(backend):
    with pytest.warns(
        SimulationWarning, match=r"'root\.y' stopped being finite at t = 0\.6 s"
    ) as caught:
        result = simulate(falling(), 1.0, step=0.1, backend=backend)
    assert caught[0].filename == __file__
    assert result.sizes["time"] == 11
    assert result.attrs["status"] == "complete"
    assert result.attrs["not_finite"] == "'root.y' stopped being finite at t = 0.6 s"


def test_run_stops_where_an_output_stops_being_finite(path):
    with pytest.raises(
        DivergenceError, match=r"'root\.y' stopped.* t = 0\.6 s; the log"
    ) as caught:
        simulate(falling(), 1.0, not_finite="stop", stream_to=path, **SETTINGS)
    assert_near(caught.value.result["time"], np.arange(6) / 10, 1e-15)


def test_run_stops_there_also_if_a_state_stops_being_finite_soon_after(path):
    """The error of the log came while that of the state was handled, and had no result."""
    diagram = falling()
    diagram.blocks["root"] >> diagram.add(i=Integrator())
    with pytest.raises(
        DivergenceError, match=r"^'root\.y' stopped.* t = 0\.6 s; the log"
    ) as caught:
        simulate(
            diagram, 1.0, solver="euler", not_finite="stop", stream_to=path, **SETTINGS
        )
    assert caught.value.result.sizes["time"] == 6
    assert path is None or [*path.parent.iterdir()] == [path]


def test_ctrl_c_after_an_output_stopped_being_finite_is_ctrl_c(path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Run, "_log_now", stopped)
    with pytest.raises(SimulationInterrupted, match="stopped at t = 1 s") as caught:
        simulate(falling(), 1.0, not_finite="stop", stream_to=path, **SETTINGS)
    assert caught.value.result.sizes["time"] == 6
    assert path is None or [*path.parent.iterdir()] == [path]


def test_ignoring_says_nothing_and_other_words_are_refused():
    simulate(falling(), 1.0, **SETTINGS, not_finite="ignore")
    with pytest.raises(
        SimulationError, match="unknown policy for values that are not finite 'raise'"
    ):
        simulate(falling(), 1.0, **SETTINGS, not_finite="raise")


def test_jump_between_two_steps_warns_once():
    with pytest.warns(
        SimulationWarning, match=r"'source\.y' jumps at t = 0\.105 s"
    ) as caught:
        simulate(lag(Step(0.105)), 1.0, step=0.01, backend="interpreted")
    assert len(caught) == 1


@pytest.mark.parametrize(
    "source",
    [Step(0.1), Step(2.5), Ramp(1.0, start_time=0.105)],
    ids=["jump at a step", "jump after the end", "no jump"],
)
def test_sources_without_a_missed_jump_do_not_warn(source):
    diagram = lag(source)
    diagram.add(unseen=Step(0.105))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulate(diagram, 1.0, step=0.01, backend="interpreted")


def test_checks_between_parameters_hold_in_runs_and_sessions():
    diagram = series(one=Constant(5.0), s=Saturation(-1.0, 1.0))
    diagram.expose(y=diagram.s.y)
    simulator = Simulator(diagram, **SETTINGS)
    with pytest.raises(
        ParameterError, match=r"'lower' of block 's' is 3\.0, but 'upper' is 1\.0"
    ):
        simulator.run(1.0, parameters={"s.lower": 3.0})
    assert (
        simulator.run(1.0, parameters={"s.lower": 3.0, "s.upper": 4.0})["s.y"][-1]
        == 4.0
    )
    with Session(diagram, **SETTINGS) as session:
        session.tune({"s.upper": 4.0})
        # beside what was tuned before, not beside the block's own
        session.tune({"s.lower": 3.0})
        with pytest.raises(ParameterError, match="must not exceed"):
            session.tune({"s.upper": 2.0})
        assert session.outputs["y"] == 4.0


@pytest.mark.parametrize(
    "unit, hint",
    [("newtn", "did you mean 'newton'"), ("Nm", r"'N\*m'"), (3, "is text")],
)
def test_unknown_units_are_refused_where_they_are_declared(unit, hint):
    with pytest.raises(BlockError, match=rf"Constant\.y.*{hint}"):
        Constant(1.0, unit=unit)


def test_simulators_and_sessions_are_rebuilt_by_pickle_and_copy():
    simulator = Simulator(lag(Constant(2.0)), **SETTINGS, log=["i.y"])
    for other in (pickle.loads(pickle.dumps(simulator)), copy.deepcopy(simulator)):
        assert other.run(1.0)["i.y"].identical(simulator.run(1.0)["i.y"])
    session = Session(Integrator(), **SETTINGS)
    with pickle.loads(pickle.dumps(session)) as other:
        other.set(u=2.0)
        other.advance(0.5)
        assert other.outputs["y"] == pytest.approx(1.0, abs=1e-12)
        with pytest.raises(
            SimulationError, match=r"it is started; pickle what save\(\) returns"
        ):
            pickle.dumps(other)


def test_linear_models_are_rebuilt_by_pickle():
    diagram = series(g=Gain(2.0), i=Integrator())
    diagram.expose(u=diagram.g.u, y=diagram.i.y)
    model = linearize(diagram)
    other = pickle.loads(pickle.dumps(model))
    assert_array_equal(other.B, model.B)
    assert (other.input_labels, other.name) == (model.input_labels, model.name)
