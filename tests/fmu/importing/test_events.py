"""Events of FMUs against exact solutions: for every solver, and inside co-simulation."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, ports, series

from trussflow.blocks import (
    Diagram,
    Integrator,
    PythonFunction,
    Ramp,
    Session,
    Step,
    ZeroOrderHold,
    cosimulate,
    linearize,
    simulate,
    trim,
)
from trussflow.blocks.errors import RunEndedError
from trussflow.fmu import Fmu, FmuError

SOLVERS = ("rk4", "RK45", "DOP853", "Rodas5P", "auto")

# Parabolas are exact for methods of order two and above but for round-off; the multistep
# methods start with order one and keep to their tolerance.
ACCURACY = {"Rodas5P": 1e-5, "auto": 1e-5}


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


def made(path, kind, **settings):
    """Return a block that takes steps of 0.1 s if it is for co-simulation."""
    return Fmu(path, kind=kind, step=0.1 if kind == "cs" else None, **settings)


def in_diagram(block):
    return series(fmu=block)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_ball_bounces_at_the_right_times(make_fmu, version, solver):
    ball = made(make_fmu("ball", version), "me")
    result = simulate(
        in_diagram(ball),
        2.0,
        step=0.01,
        solver=solver,
        rtol=1e-10,
        atol=1e-12,
        log_step=0.1,
    )
    expected = height(result["time"].values)
    assert_near(result["fmu.h"], expected, ACCURACY.get(solver, 1e-9))
    assert result["fmu.bounces"][-1] == 4  # at 0.45, 1.08, 1.53 and 1.84 s


@pytest.mark.parametrize("solver", ["rk4", "euler", "RK45", "Rodas5P", "auto"])
def test_a_stair_steps_at_the_right_times(make_fmu, version, solver):
    """The integral of the stair is exact for any solver that stops at its time events."""
    diagram = in_diagram(made(make_fmu("stair", version), "me"))
    diagram.add(integral=Integrator())
    diagram.fmu.y >> diagram.integral.u
    result = simulate(diagram, 1.0, step=0.1, solver=solver)
    assert result["fmu.y"][-1] == 2
    assert result["integral.y"][-1].item() == pytest.approx(0.65 + 0.3, abs=1e-9)


@pytest.mark.parametrize("solver", ["rk4", "DOP853"])
def test_inputs_that_jump_at_an_instant_are_events(make_fmu, version, solver):
    """A relay that reads u at events only, fed by a sampled Python block, and a sampled discrete input.

    x' = -x + r + d with r = 1 where u > 0.5, from 0.3 to 0.6 s, and d = 2 from 0.5 s on.
    """
    diagram = in_diagram(made(make_fmu("relay", version), "me"))
    held = PythonFunction(
        lambda u: np.asarray((u > 0.25) & (u < 0.55)) * 1.0, 0.1, **ports(u=(), y=())
    )
    diagram.add(
        clock=Ramp(),
        held=held,
        jump=Step(0.5, final_value=2.0),
        hold=ZeroOrderHold(0.1),
    )
    diagram.clock >> diagram.held >> diagram.fmu.u
    diagram.jump >> diagram.hold >> diagram.fmu.d
    result = simulate(diagram, 1.0, step=0.01, solver=solver, rtol=1e-11, atol=1e-13)

    def lag(begin):
        return 1 - np.exp(-np.maximum(result["time"] - begin, 0.0))

    expected = lag(0.3) - lag(0.6) + 2 * lag(0.5)
    assert_near(result["fmu.x"], expected, 1e-9)


@pytest.mark.parametrize(
    "version, flags",
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
    diagram = Diagram("both")
    for model in ("ball", "stair"):
        diagram.add(model, made(make_fmu(model, version, flags=flags), "cs"))
    result = simulate(diagram, 2.0, step=0.1)
    assert_near(result["ball.h"], height(result["time"].values), 1e-12)
    assert result["ball.bounces"][-1] == 4
    assert_array_equal(result["stair.y"][[3, 4, 7, 8, 20]], [0, 1, 2, 2, 5])


def test_linear_analysis_settles_discrete_states(make_fmu, version):
    """In x' = -x + r + d the relay r follows u at events only: each point of an analysis has one."""
    relay = made(make_fmu("relay", version), "me")
    diagram = in_diagram(relay)
    diagram.expose(u=relay.u, d=relay.d, x=relay.x)
    for u in (0.0, 1.0):
        point = trim(diagram, inputs={"u": u, "d": 2.0})
        assert point.states["fmu.x_state"] == pytest.approx(u + 2.0, abs=1e-9)
        assert_near(linearize(diagram, at=point).B, [[0.0, 1.0]], 1e-9)


def test_a_session_goes_back_before_a_bounce(make_fmu, version, kind):
    """A restored snapshot gives the same to the last bit, hidden counters included."""
    with Session(made(make_fmu("ball", version), kind), step=0.1) as session:
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


def test_a_session_goes_back_before_a_time_event_and_a_discrete_input(
    make_fmu, version
):
    """In x' = -x + d, d jumps to 2 after the snapshot, is undone with it, and jumps again."""
    relay = made(make_fmu("relay", version), "me", start={"u": 0.0})
    diagram = in_diagram(relay)
    stair = diagram.add(stair=made(make_fmu("stair", version), "me"))
    diagram.expose(d=relay.d, x=relay.x, y=stair.y)
    with Session(diagram, step=0.01) as session:
        session.advance(0.1)
        snapshot = session.save()
        for _ in range(2):
            session.set(d=2.0)
            session.advance(0.6)
            assert session.outputs["x"] == pytest.approx(
                2 * (1 - np.exp(-0.5)), abs=1e-9
            )
            assert session.outputs["y"] == 1
            session.restore(snapshot)
            assert session.outputs["y"] == 0
        session.advance(0.2)
        assert session.outputs["x"] == 0


def test_states_that_are_no_bytes_serve_their_own_run(make_fmu, version, kind):
    """Such states are handles; one from before the first instant needs none."""
    word = "state" if version == 2 else "State"
    path = make_fmu("ball", version, replace={f'canSerializeFMU{word}="true"': ""})
    with Session(made(path, kind), step=0.1) as session:
        first = session.save()
        session.advance(0.4)
        snapshot = session.save()
        heights = set()
        for state in (snapshot, snapshot, first):
            session.restore(state)
            session.advance(1.6)
            heights.add(float(session.outputs["h"]))
        assert len(heights) == 1
        session.start()
        with pytest.raises(
            FmuError, match="only the run that saved the state can restore it"
        ):
            session.restore(snapshot)


def test_a_run_may_begin_at_another_time(make_fmu, version, kind):
    """The stair counts its periods from the start: first at 2.35 s."""
    values = []
    with Session(made(make_fmu("stair", version), kind), step=0.1) as session:
        session.start(time=2.0)
        for time in (2.3, 2.5, 2.9):
            session.advance(time)
            values.append(session.outputs["y"])
    assert values == [0, 1, 2]


@pytest.mark.parametrize("runs", [simulate, cosimulate])
def test_an_fmu_may_end_the_run(make_fmu, version, kind, runs):
    """It may discard the step to 0.6 s, or end after it: that row is logged like any other."""
    path = make_fmu("ball", version)
    free, discarding, ending = (
        in_diagram(made(path, kind, parameters={"fault": fault}))
        for fault in (0, 7, 13)
    )
    whole = runs(free, 0.6, step=0.1)
    # For co-simulation it discards the step; for model exchange it asks once it is there.
    rows = 6 if kind == "cs" else 7
    for diagram, number, time in (
        (discarding, rows, r"0\.[56]"),
        (ending, 7, r"0\.6 s"),
    ):
        with pytest.raises(
            RunEndedError, match=rf"asks to end the run at t = {time}"
        ) as caught:
            runs(diagram, 1.0, step=0.1)
        result = caught.value.result
        assert result.attrs["status"] == "ended"
        assert_array_equal(result["time"], whole["time"][:number])
        assert_array_equal(result["fmu.h"], whole["fmu.h"][:number])
    assert_array_equal(runs(ending, 0.6, step=0.1)["fmu.h"], whole["fmu.h"])


def test_a_run_may_stop_where_an_event_ends_it(make_fmu, version):
    """The second step of the stair, at 0.7 s, asks to end: there the run stops, or goes no further."""
    diagram = in_diagram(
        made(make_fmu("stair", version), "me", parameters={"fault": 11})
    )
    assert simulate(diagram, 0.7, step=0.1)["fmu.y"][-1] == 2
    with pytest.raises(RunEndedError, match=r"asks to end the run at t = 0\.7 s"):
        simulate(diagram, 0.8, step=0.1)


@pytest.mark.parametrize(
    "model, version, kind, flags, fault, message",
    [
        # It asks to end in the event mode in which its inputs and start values settle.
        ("ball", 2, "me", "", 11, r"asks to end the run at (its start, )?t = 0 s"),
        ("ball", 3, "me", "", 11, r"asks to end the run at (its start, )?t = 0 s"),
        (
            "ball",
            3,
            "cs",
            'hasEventMode="true"',
            11,
            r"asks to end the run at (its start, )?t = 0 s",
        ),
        ("ball", 2, "me", "", 8, "did not converge within 100 updates"),
        ("ball", 3, "me", "", 8, "did not converge within 100 updates"),
        (
            "ball",
            3,
            "cs",
            'hasEventMode="true"',
            8,
            "did not converge within 100 updates",
        ),
        (
            "stair",
            3,
            "cs",
            'mightReturnEarlyFromDoStep="true"',
            10,
            "returned early 100000 times in the step from t = 0 s",
        ),
    ],
)
def test_event_faults(make_fmu, model, version, kind, flags, fault, message):
    block = made(
        make_fmu(model, version, flags=flags), kind, parameters={"fault": fault}
    )
    with pytest.raises(FmuError, match=message):
        simulate(in_diagram(block), 1.0, step=0.1)
