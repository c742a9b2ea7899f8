"""Events of FMUs against exact solutions: under every solver, and inside co-simulation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Constant,
    Diagram,
    Input,
    Integrator,
    Output,
    PythonFunction,
    RunEndedError,
    Session,
    Step,
    cosimulate,
    simulate,
)
from trussflow.fmu import Fmu, FmuError

MakeFmu = Callable[..., Path]
SOLVERS = ("rk4", "RK45", "DOP853", "LSODA", "BDF", "Radau")
versions = pytest.mark.parametrize("version", [2, 3])

# Parabolas are exact for methods of order two and above but for round-off; the multistep
# methods start with order one and keep to their tolerance.
ACCURACY = {"BDF": 1e-5, "LSODA": 1e-5}


def height(t, g=9.81, e=0.7):
    """Return the height of a ball that falls from 1 m and bounces, exactly."""
    heights = []
    for time in np.atleast_1d(t):
        speed, s = np.sqrt(2 * g), time - np.sqrt(2 / g)
        if s < 0:
            heights.append(1 - g * time**2 / 2)
            continue
        speed *= e
        while s > 2 * speed / g:
            s -= 2 * speed / g
            speed *= e
        heights.append(speed * s - g * s**2 / 2)
    return np.array(heights)


def in_diagram(block):
    diagram = Diagram("test")
    diagram.add(fmu=block)
    return diagram


@versions
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_ball_bounces_at_the_right_times(make_fmu, version, solver):
    ball = Fmu(make_fmu("ball", version), kind="me")
    result = simulate(in_diagram(ball), 2.0, step=0.01, solver=solver, rtol=1e-10, atol=1e-12, log_step=0.1)
    accuracy = ACCURACY.get(solver, 1e-9)
    expected = height(result["time"].values)
    np.testing.assert_allclose(result["fmu.h"].values, expected, rtol=0, atol=accuracy)
    assert result["fmu.bounces"][-1] == 4  # at 0.45, 1.08, 1.53 and 1.84 s


@versions
def test_under_euler_the_ball_converges_with_order_one(make_fmu, version):
    path, errors, steps = make_fmu("ball", version), [], [8e-3, 4e-3, 2e-3, 1e-3]
    for step in steps:
        result = simulate(in_diagram(Fmu(path, kind="me")), 0.8, step=step, solver="euler")
        errors.append(abs(result["fmu.h"][-1].item() - height(0.8)[0]))
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.1)


@versions
@pytest.mark.parametrize("solver", ["rk4", "euler", "RK45", "LSODA", "Radau"])
def test_a_stair_steps_at_the_right_times(make_fmu, version, solver):
    """The integral of the stair is exact for any solver that stops at its time events."""
    diagram = in_diagram(Fmu(make_fmu("stair", version), kind="me"))
    diagram.add(integral=Integrator())
    diagram.fmu.y >> diagram.integral.u
    result = simulate(diagram, 1.0, step=0.1, solver=solver)
    assert result["fmu.y"][-1] == 2
    assert result["integral.y"][-1].item() == pytest.approx(0.65 + 0.3, abs=1e-9)


@versions
@pytest.mark.parametrize("solver", ["rk4", "DOP853"])
def test_inputs_that_jump_at_an_instant_are_events(make_fmu, version, solver):
    """A relay that looks at its input at events only, fed by a sampled block.

    x' = -x + r with r = 1 where u > 0.5: from 0.3 to 0.6 s it rises, then it falls.
    """
    diagram = in_diagram(Fmu(make_fmu("relay", version), kind="me", start={"d": 0.0}))
    diagram.add(
        held=PythonFunction(
            lambda u: np.asarray(u > 0.25) * 1.0 - np.asarray(u > 0.55),
            0.1,
            inputs={"u": Input()},
            outputs={"y": Output()},
        ),
        clock=Integrator(),
        one=Constant(1.0),
    )
    diagram.one >> diagram.clock
    diagram.clock >> diagram.held
    diagram.held >> diagram.fmu.u
    result = simulate(diagram, 1.0, step=0.01, solver=solver, rtol=1e-11, atol=1e-13)
    t = result["time"].values
    top = 1 - np.exp(-0.3)
    expected = np.where(t < 0.3, 0, np.where(t < 0.6, 1 - np.exp(0.3 - t), top * np.exp(0.6 - t)))
    np.testing.assert_allclose(result["fmu.x"].values, expected, rtol=0, atol=1e-9)


@versions
def test_discrete_inputs_are_set_at_events(make_fmu, version):
    """X' = -x + d, d jumps from 0 to 2 at 0.5 s."""
    diagram = in_diagram(Fmu(make_fmu("relay", version), kind="me", start={"u": 0.0}))
    diagram.add(jump=Step(0.5, final_value=2.0))
    held = PythonFunction(lambda u: u, 0.1, inputs={"u": Input()}, outputs={"y": Output()})
    diagram.add(held=held)
    diagram.jump >> diagram.held
    diagram.held >> diagram.fmu.d
    result = simulate(diagram, 1.0, step=0.01)
    assert result["fmu.x"][-1].item() == pytest.approx(2 * (1 - np.exp(-0.5)), abs=1e-9)


@pytest.mark.parametrize(
    ("version", "flags"),
    [
        (2, ""),
        (3, ""),
        (3, 'hasEventMode="true"'),
        (3, 'mightReturnEarlyFromDoStep="true"'),
        (3, 'hasEventMode="true" mightReturnEarlyFromDoStep="true"'),
    ],
)
def test_events_inside_co_simulation(make_fmu, version, flags):
    """The FMU solves its parabolas exactly; early returns and event mode must not change them."""
    ball = Fmu(make_fmu("ball", version, flags=flags), kind="cs", step=0.1)
    result = simulate(in_diagram(ball), 2.0, step=0.1)
    expected = height(result["time"].values)
    np.testing.assert_allclose(result["fmu.h"].values, expected, rtol=0, atol=1e-12)
    assert result["fmu.bounces"][-1] == 4
    stair = Fmu(make_fmu("stair", version, flags=flags), kind="cs", step=0.1)
    result = simulate(in_diagram(stair), 2.0, step=0.1)
    np.testing.assert_array_equal(result["fmu.y"][[3, 4, 7, 8, 20]].values, [0, 1, 2, 2, 5])


@versions
@pytest.mark.parametrize("kind", ["cs", "me"])
def test_a_session_goes_back_before_a_bounce(make_fmu, version, kind):
    """What follows a restored snapshot is the same to the last bit, hidden counters included."""
    step = 0.1 if kind == "cs" else None
    with Session(Fmu(make_fmu("ball", version), kind=kind, step=step), step=0.1) as session:
        session.advance(0.4)
        snapshot = session.save()
        session.advance(1.6)
        first = session.outputs
        session.restore(snapshot)
        session.advance(0.5)
        session.restore(snapshot)
        session.advance(1.6)
        assert session.outputs == first
        session.advance(1.7)
        assert session.outputs["bounces"] == 3


@versions
def test_a_session_goes_back_before_a_time_event(make_fmu, version):
    with Session(Fmu(make_fmu("stair", version), kind="me"), step=0.1) as session:
        session.advance(0.3)
        snapshot = session.save()
        session.advance(0.5)
        assert session.outputs["y"] == 1
        session.restore(snapshot)
        assert session.outputs["y"] == 0
        session.advance(0.5)
        assert session.outputs["y"] == 1


@versions
def test_a_session_goes_back_before_a_discrete_input(make_fmu, version):
    """In x' = -x + d, d jumps to 2 after the snapshot, is undone with it, and jumps again."""
    block = Fmu(make_fmu("relay", version), kind="me", start={"u": 0.0})
    diagram = in_diagram(block)
    diagram.expose(d=block.d, x=block.x)
    with Session(diagram, step=0.01) as session:
        session.advance(0.1)
        snapshot = session.save()
        for _ in range(2):
            session.set(d=2.0)
            session.advance(0.6)
            expected = 2 * (1 - np.exp(-0.5))
            assert session.outputs["x"] == pytest.approx(expected, abs=1e-9)
            session.restore(snapshot)
        session.advance(0.2)
        assert session.outputs["x"] == 0


@versions
@pytest.mark.parametrize("kind", ["cs", "me"])
def test_states_that_are_no_bytes_serve_their_own_run(make_fmu, version, kind):
    """Such states are handles; one from before the first instant needs none."""
    word = "state" if version == 2 else "State"
    path = make_fmu("ball", version, replace={f'canSerializeFMU{word}="true"': ""})
    step = 0.1 if kind == "cs" else None
    with Session(Fmu(path, kind=kind, step=step), step=0.1) as session:
        first = session.save()
        session.advance(0.4)
        snapshot = session.save()
        heights = []
        for state, end in ((snapshot, 1.6), (snapshot, 1.6), (first, 1.6)):
            session.restore(state)
            session.advance(end)
            heights.append(session.outputs["h"])
        assert heights[0] == heights[1] == heights[2]
        session.start()
        with pytest.raises(FmuError, match="only the run that saved it can go back to it"):
            session.restore(snapshot)


@versions
@pytest.mark.parametrize("kind", ["cs", "me"])
def test_a_run_may_begin_at_another_time(make_fmu, version, kind):
    """The stair counts its periods from the start: first at 2.35 s."""
    step = 0.1 if kind == "cs" else None
    session = Session(Fmu(make_fmu("stair", version), kind=kind, step=step), step=0.1)
    session.start(time=2.0)
    values = []
    for time in (2.3, 2.5, 2.9):
        session.advance(time)
        values.append(float(session.outputs["y"]))
    session.stop()
    assert values == [0, 1, 2]


@versions
@pytest.mark.parametrize("kind", ["cs", "me"])
@pytest.mark.parametrize("runs", [simulate, cosimulate])
def test_an_fmu_may_end_the_run(make_fmu, version, kind, runs):
    step = 0.1 if kind == "cs" else None
    ball = Fmu(make_fmu("ball", version), kind=kind, parameters={"fault": 7}, step=step)
    with pytest.raises(RunEndedError, match=r"asks to end the run at t = 0\.[56]") as caught:
        runs(in_diagram(ball), 1.0, step=0.1)
    result: Any = caught.value.result
    assert result.attrs["status"] == "ended"
    # For co-simulation it discards the step to 0.6 s; for model exchange it says so once it is there.
    rows = 6 if kind == "cs" else 7
    np.testing.assert_allclose(result["time"], 0.1 * np.arange(rows), rtol=0, atol=1e-12)


@versions
@pytest.mark.parametrize("kind", ["cs", "me"])
@pytest.mark.parametrize("runs", [simulate, cosimulate])
def test_the_row_at_which_an_fmu_ends_the_run_is_logged(make_fmu, version, kind, runs):
    """It may end after the step to 0.6 s: that is a result like any other, and no fault at the end."""
    path, step = make_fmu("ball", version), 0.1 if kind == "cs" else None
    free, ended = (Fmu(path, kind=kind, parameters={"fault": n}, step=step) for n in (0, 13))
    diagram = in_diagram(ended)
    wanted, complete = runs(in_diagram(free), 0.6, step=0.1), runs(diagram, 0.6, step=0.1)
    with pytest.raises(RunEndedError, match=r"asks to end the run at t = 0\.6 s") as caught:
        runs(diagram, 1.0, step=0.1)
    last: Any = caught.value.result
    for result in (complete, last):
        np.testing.assert_array_equal(result["time"], wanted["time"])
        np.testing.assert_array_equal(result["fmu.h"], wanted["fmu.h"])


@pytest.mark.parametrize(("version", "kind"), [(2, "me"), (3, "me"), (3, "cs")])
def test_an_fmu_may_end_the_run_at_once(make_fmu, version, kind):
    """It asks for that in the event mode in which its inputs and start values settle."""
    flags, step = ('hasEventMode="true"', 0.1) if kind == "cs" else ("", None)
    ball = Fmu(make_fmu("ball", version, flags=flags), kind=kind, parameters={"fault": 11}, step=step)
    with pytest.raises(FmuError, match=r"asks to end the run at (its start, )?t = 0 s"):
        simulate(in_diagram(ball), 1.0, step=0.1)


@versions
def test_discrete_states_that_never_settle_are_refused(make_fmu, version):
    ball = Fmu(make_fmu("ball", version), kind="me", parameters={"fault": 8})
    with pytest.raises(FmuError, match="did not settle after 100 updates"):
        simulate(in_diagram(ball), 1.0, step=0.1)
    if version == 3:
        path = make_fmu("ball", 3, flags='hasEventMode="true"')
        ball = Fmu(path, kind="cs", step=0.1, parameters={"fault": 8})
        with pytest.raises(FmuError, match="did not settle after 100 updates"):
            simulate(in_diagram(ball), 1.0, step=0.1)


def test_early_returns_that_lead_nowhere_are_refused(make_fmu):
    path = make_fmu("stair", 3, flags='mightReturnEarlyFromDoStep="true"')
    stair = Fmu(path, kind="cs", step=0.1, parameters={"fault": 10})
    with pytest.raises(FmuError, match="returned early 100000 times in the step from t = 0 s"):
        simulate(in_diagram(stair), 1.0, step=0.1)
