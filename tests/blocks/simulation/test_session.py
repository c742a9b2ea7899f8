"""Sessions: what is run piece by piece is the same, to the last bit, as what is run whole."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_array_equal, assert_equal
from systems import Controller, Follower, HiddenSum, Pendulum, assert_near

from trussflow.blocks import Diagram, Session, Simulator, TimeFunction
from trussflow.blocks.errors import ParameterError
from trussflow.blocks.simulation.solver import FIXED_STEP

# clocks that do and do not meet the points
STEP, POINT, SAMPLE = (0.01, Fraction(1, 20), 0.04)
ADAPTIVE_TOLERANCE = 1e-7  # of the exact solution, with the default tolerances
ROUND_OFF = 1e-12


def staircase(t):
    """Return the goal, which the caller of a session sets, or a block makes."""
    return np.stack([np.sin(3.0 * t), np.cos(5.0 * t)])


def loop(*, inside=False, python=None):
    """Return a controlled pendulum, its goal from outside or from a block that makes the same."""
    diagram = Diagram("loop")
    law, plant = diagram.add(law=Controller().sampled(SAMPLE), plant=Pendulum())
    plant.angle >> law.angle
    law.torque >> plant.torque
    diagram.expose(angle=plant.angle, load=plant.load, torque=law.torque)
    if inside:
        goal = diagram.add(goal=TimeFunction(staircase).sampled(float(POINT)))
        goal.y >> law.goal
    else:
        diagram.expose(goal=law.goal)
    if python is not None:
        diagram.add(python=python.sampled(0.1))
        plant.angle >> python.port("u")
        diagram.expose(count=python.port("y"))
    return diagram


def pieces(session, first, last):
    """Advance a session over communication points, the goal set at each; return the outputs."""
    found = []
    for k in range(first, last):
        session.set(goal=staircase(float(k * POINT)))
        found.append(session.outputs)
        session.advance(float((k + 1) * POINT))
    return found


@pytest.mark.parametrize("solver", FIXED_STEP)
def test_session_equals_a_whole_run_whose_inputs_blocks_make(backend, solver):
    """Bit for bit, at each point, what is due at that point included, of Python blocks too."""
    names = ["angle", "load", "torque", "count"]
    whole = Simulator(
        loop(inside=True, python=HiddenSum(2)),
        step=STEP,
        solver=solver,
        backend=backend,
        log=names,
        log_step=float(POINT),
    ).run(1.0)
    with Session(
        loop(python=HiddenSum(2)), step=STEP, solver=solver, backend=backend
    ) as session:
        found = pieces(session, 0, 20)
    assert list(found[0]) == names
    for name in names:
        expected = whole[name].values[:-1]
        assert np.abs(expected).max() > 0.1
        assert_array_equal([outputs[name] for outputs in found], expected, name)


@pytest.mark.parametrize("solver", ["rk4", "RK45", "Rodas5P"])
def test_the_length_of_the_pieces_does_not_matter(solver):
    """To the last bit for fixed steps, to the tolerance for solvers that start afresh."""
    ends = []
    for times in ([1.2], [0.01, 0.3, 0.3, 0.31, 0.9, 1.2], np.arange(1, 121) / 100):
        with Session(
            loop(), step=STEP, solver=solver, backend="interpreted"
        ) as session:
            session.set(goal=[0.5, -0.5])
            for time in times:
                session.advance(time)
            assert session.time == 1.2
            ends.append(session.outputs["angle"])
    assert_near(ends[1:], ends[:1] * 2, ADAPTIVE_TOLERANCE if solver != "rk4" else 0)


@pytest.mark.parametrize("solver", ["rk4", "auto"])
def test_restored_session_goes_on_bit_by_bit(backend, solver):
    """In the same session and in another one, hidden memory of a Python block included."""
    session = Session(
        loop(python=HiddenSum(2)), step=STEP, solver=solver, backend=backend
    )
    other = session.twin()
    with session, other:
        pieces(session, 0, 7)
        snapshot = session.save()
        first = pieces(session, 7, 14)
        assert any(np.abs(outputs["count"]).max() > 0.1 for outputs in first)
        pieces(other, 0, 3)
        for again in (session, other):
            again.restore(snapshot)
            assert again.time == 0.35
            assert_equal(pieces(again, 7, 14), first)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_points_off_the_grid_cost_no_accuracy_and_move_no_instant(backend):
    """Shorter steps only; the law still samples every 0.04 s, from the inputs of that time."""
    ends, torques = [], []
    for offset in (0.0, 0.0037):
        with Session(loop(), step=STEP, backend=backend) as session:
            for k in range(1, 21):
                session.set(goal=[1.0, float(k < 9)])
                session.advance(k * 0.04 - offset)
                if offset:
                    assert session.time == pytest.approx(
                        k * 0.04 - offset, rel=ROUND_OFF
                    )
            session.advance(1.0)
            ends.append(session.outputs["angle"])
            torques.append(session.outputs["torque"])
    assert_near(ends[1], ends[0], 1e-6)
    assert_near(torques[1], torques[0], 1e-6)


def test_outputs_follow_inputs_at_once():
    with Session(loop(python=HiddenSum(2)), step=STEP, backend="numpy") as session:
        before = session.outputs
        session.set(goal=[1.0, 0.0])
        after = session.outputs
        assert_near(after["torque"] - before["torque"], [2.0, 0.0], ROUND_OFF)
        assert_near(after["load"] - before["load"], [2.0, 0.0], ROUND_OFF)
        session.advance(STEP)  # between two samples of the law: it holds
        session.set(goal=[5.0, 5.0])
        assert_array_equal(session.outputs["torque"], after["torque"])
        session.advance(0.1)
        count = session.outputs["count"]
        assert np.abs(count).min() > 0.1
        session.advance(0.1 + STEP)  # to look at it in advance has changed nothing
        assert_array_equal(session.outputs["count"], count)


def test_initial_states_follow_inputs_at_the_start_or_are_given():
    session = Session(Follower(), step=STEP, backend="numpy")
    session.start(inputs={"u": 2.0})
    session.advance(STEP)
    assert session.outputs == {"y": 3.0}
    session.start(initial={"Follower.x": 0.5}, inputs={"u": 2.0})
    assert session.time == 0.0
    assert session.outputs == {"y": 0.5}
    session.stop()
    session.stop()
    assert not session.started


def test_tuned_parameter_counts_from_now_on():
    """Tuning equals a run with that value, started from the state of that time."""
    session, other = (Session(Pendulum(), step=STEP, backend="compiled") for _ in "ab")
    with session, other:
        session.advance(0.5)
        session.tune({"Pendulum.stiffness": 4.0})
        half = session.save()
        session.advance(1.0)
        other.start(parameters={"Pendulum.stiffness": 4.0})
        other.restore(half)
        other.advance(1.0)
        assert_array_equal(session.outputs["angle"], other.outputs["angle"])
        other.start()
        other.advance(1.0)
        assert np.abs(session.outputs["angle"] - other.outputs["angle"]).max() > 0.01
        with pytest.raises(
            ParameterError, match=r"'stiffness' of block 'Pendulum' is -1\.0; it m"
        ):
            session.tune({"Pendulum.stiffness": -1.0})
