"""What a session refuses, and what can be done after a failure."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import Level, ports, series

from trussflow.blocks import Function, Session, State
from trussflow.blocks.errors import (
    DivergenceError,
    NameLookupError,
    OpenInputError,
    ParameterError,
    SimulationError,
)

STEP = 0.01


def pair():
    return Function(lambda goal: 2.0 * goal, **ports(goal=2, y=2))


class Bad(Level):
    """Its state escapes to infinity within a second if the input is positive."""

    x = State(initial=1.0)

    def derivative(self, t, x, u, p):
        return {"x": u.u * np.exp(x.x) ** 2}


def test_wrong_inputs_are_refused_and_change_nothing():
    with Session(pair(), step=STEP, backend="numpy") as session:
        for values, error, message in (
            (
                {"aim": 1.0},
                NameLookupError,
                "no input 'aim'; the external inputs are: goal",
            ),
            ({"goal": [1.0, np.nan]}, ParameterError, "input 'goal' is not finite"),
            (
                {"goal": [1.0, 2.0, 3.0]},
                ParameterError,
                r"input 'goal' has shape \(3,\); it must",
            ),
            (
                {"goal": "far"},
                ParameterError,
                "input 'goal' must be numeric, not 'far'",
            ),
            ({"goal": 7.0, "aim": 1.0}, NameLookupError, "no input 'aim'"),
        ):
            before = session.outputs["y"]
            with pytest.raises(error, match=message):
                session.set(values)
            assert_array_equal(session.outputs["y"], before)


def test_wrong_times_and_orders_are_refused():
    session = Session(pair(), step=STEP, backend="numpy")
    with pytest.raises(
        SimulationError, match="the session of 'Function' is not started; call start"
    ):
        session.advance(1.0)
    with session:
        session.advance(0.3 + 1e-12)  # meant: thirty steps
        assert session.time == 0.3
        with pytest.raises(
            SimulationError, match=r"cannot advance 'Function' to t = 0\.2 s: it is"
        ):
            session.advance(0.2)
        with pytest.raises(
            SimulationError, match=r"the start time of 0\.305 s is not a whole num"
        ):
            Session(pair(), step=STEP, backend="numpy").start(time=0.305)
        with pytest.raises(
            SimulationError, match="cannot advance to nan: a time must be a finite"
        ):
            session.advance(float("nan"))
        session.advance(0.31)  # none of these did any harm
        alien = Session(Bad(), step=STEP, backend="numpy")
        with (
            alien,
            pytest.raises(SimulationError, match="snapshot is of a diagram with other"),
        ):
            alien.restore(session.save())
    diagram = series(plant=Bad())
    with pytest.raises(OpenInputError, match=r"'plant\.u'"):
        Session(diagram, step=STEP)


@pytest.mark.parametrize("solver", ["rk4", "auto"])
def test_after_a_failed_advance_only_restore_or_start_help(solver):
    with Session(Bad(), step=STEP, solver=solver, backend="compiled") as session:
        session.advance(0.1)
        snapshot = session.save()
        session.set(u=1e3)
        with pytest.raises(DivergenceError, match=r"t = 0\.1"):
            session.advance(5.0)
        with pytest.raises(
            SimulationError, match=r"because it failed there: .*Restore a snapshot"
        ):
            session.advance(6.0)
        with pytest.raises(
            SimulationError, match="cannot save a session that failed: "
        ):
            session.save()
        session.restore(snapshot)
        session.advance(1.0)
        assert session.outputs["y"] == 1.0
        session.set(u=1e3)
        with pytest.raises(DivergenceError):
            session.advance(5.0)
        session.start()
        session.advance(1.0)
