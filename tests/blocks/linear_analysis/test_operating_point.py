"""Operating points: given in part, taken from a simulation, and refused where they do not fit."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import ports

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Function,
    Gain,
    Input,
    OperatingPoint,
    Output,
    PythonFunction,
    Session,
    StateSpace,
    ZeroOrderHold,
    linearize,
    operating_point_after,
    simulate,
)
from trussflow.blocks.errors import ParameterError, SimulationError
from trussflow.blocks.framework.declarations import State

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each


def oscillator():
    """Return a spring that stiffens, with a sampled force that wanes with time."""
    diagram = Diagram("oscillator")
    plant, law, hold = diagram.add(
        plant=StateSpace(
            [[0.0, 1.0], [-1.0, -0.1]], [[0], [1]], np.eye(2), initial_value=[1.0, 0.0]
        ),
        law=Function(lambda y, f: f - y[0:1] ** 3, **ports(y=2, f=1, u=1)),
        hold=ZeroOrderHold(0.25, shape=1),
    )
    plant >> law.y
    hold >> law.f
    law >> plant
    diagram.expose(f=hold.u, y=plant.y)
    return diagram


def test_a_diagram_is_linearized_where_a_simulation_has_come_to():
    start = OperatingPoint(inputs={"f": [0.4]})
    at = operating_point_after(oscillator(), 1.1, at=start, step=0.01)
    assert at.time == 1.1
    assert at.inputs["f"] == [0.4]
    assert at.held["hold.y"] == [0.4]
    closed = Diagram()
    closed.add(inner=oscillator(), source=Constant([0.4]))
    closed.source >> closed.inner.f
    run = simulate(closed, 1.1, step=0.01)
    assert_allclose(at.states["plant.x"], run["inner.plant.y"].values[-1], rtol=1e-12)
    whole = linearize(oscillator(), at=at)
    assert_array_equal(whole.operating_point.states["plant.x"], at.states["plant.x"])
    flow = np.array([[0.0, 1.0], [-1 - 3 * at.states["plant.x"][0] ** 2, -0.1]])
    poles = np.exp(0.25 * np.linalg.eigvals(flow))
    assert_allclose(np.sort(np.abs(whole.poles()))[-2:], np.abs(poles), rtol=1e-12)


def test_a_session_says_where_it_is_with_the_parameters_that_were_changed():
    diagram = oscillator()
    with Session(diagram, step=0.05) as session:
        session.start(
            parameters={"plant.initial_value": [2.0, 0.0]}, inputs={"f": [1.0]}
        )
        first = OperatingPoint.of(session)
        session.advance(0.5)
        later = OperatingPoint.of(session)
    assert first.time == 0.0
    assert_array_equal(first.states["plant.x"], [2.0, 0.0])
    assert first.held["hold.y"] == [0.0]  # nothing was sampled yet
    assert later.held["hold.y"] == [1.0]
    assert list(later.parameters) == ["plant.initial_value"]
    with pytest.raises(SimulationError, match=r"is not started"):
        OperatingPoint.of(session)


def test_a_run_goes_on_from_a_point():
    there = operating_point_after(oscillator(), 1.0, step=0.01)
    half = operating_point_after(oscillator(), 0.5, step=0.01)
    rest = operating_point_after(oscillator(), 0.5, at=half, step=0.01)
    assert rest.time == there.time == 1.0
    assert_allclose(rest.states["plant.x"], there.states["plant.x"], rtol=1e-13)
    with pytest.raises(SimulationError, match=r"duration = -1.0 must be a positive"):
        operating_point_after(oscillator(), -1.0, step=0.05)


class Starting(Block):
    """Starts at the logarithm of its input, which must not be zero then."""

    u = Input()
    y = Output()
    s = State()

    def output(self, t, x, u, p):
        return {"y": x.s}

    def derivative(self, t, x, u, p):
        return {"s": np.exp(-x.s) * u.u - 1.0}

    def initial_state(self, u, p):
        with np.errstate(divide="ignore"):
            return {"s": np.log(u.u)}


def test_initial_states_from_inputs_see_the_inputs_of_the_point():
    at = OperatingPoint(inputs={"u": 2.0})
    model = linearize(Starting(), at=at)
    assert model.operating_point.states["Starting.s"] == pytest.approx(np.log(2.0))
    assert_allclose(model.A, [[-1.0]], rtol=ROUND_OFF)
    assert_allclose(model.B, [[0.5]], rtol=ROUND_OFF)
    with pytest.raises(
        ParameterError, match=r"initial value of 'Starting.s' is not finite"
    ):
        linearize(Starting())
    # a cut wire reads zero before its value is known: what the point says must be enough
    diagram = Diagram()
    two, block = diagram.add(two=Constant(2.0), block=Starting())
    two >> block
    cut = linearize(diagram, "block.u", "block.y", cut="block.u")
    assert_allclose([cut.A, cut.B], [[[-1.0]], [[0.5]]], rtol=ROUND_OFF)


def test_held_outputs_follow_from_the_states_unless_the_point_has_them():
    diagram = Diagram()
    plant, first, second = diagram.add(
        plant=StateSpace([[-1.0]], [[1.0]], [[1.0]], initial_value=[3.0]),
        first=PythonFunction(lambda u: u**2, 0.1, **ports(u=1, y=1)),
        second=Function(lambda u: u + 1).sampled(0.2),
    )
    plant >> first >> second >> plant

    def held(**values):
        at = OperatingPoint(held=values)
        return linearize(diagram, "plant.u", "plant.y", at=at).operating_point.held

    assert held() == {"first.y": 9.0, "second.y": 10.0}
    assert held(**{"first.y": [4.0]}) == {"first.y": 4.0, "second.y": 10.0}
    with pytest.raises(ParameterError, match=r"held output 'first.y' has shape \(2,\)"):
        held(**{"first.y": [1.0, 2.0]})
    with pytest.raises(ParameterError, match=r"held output 'first.y' is not finite"):
        held(**{"first.y": [np.nan]})


def test_a_circle_of_held_outputs_that_settles_is_an_operating_point():
    """First = second / 2 + 1, second = first: both 2; at no instant does one depend on itself."""
    diagram = Diagram()
    plant, first, second = diagram.add(
        plant=StateSpace([[-1.0]], [[1.0]], [[1.0]]),
        first=Function(lambda u: u / 2 + 1).sampled(0.1),
        second=Gain(1.0).sampled(0.1, offset=0.05),
    )
    second >> first >> second
    first >> plant
    held = linearize(diagram, "plant.u", "plant.y").operating_point.held
    assert held == {"first.y": 2.0, "second.y": 2.0}
