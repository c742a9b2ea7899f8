"""Trim: points of rest, and what is said where there are none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near, ports

from trussflow.blocks import (
    Diagram,
    DiscreteStateSpace,
    Free,
    Function,
    Integrator,
    OperatingPoint,
    PythonFunction,
    StateSpace,
    UnitDelay,
    linearize,
    trim,
)
from trussflow.blocks.errors import (
    LinearAnalysisError,
    NameLookupError,
    ParameterError,
    TrimError,
)

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
SMALL = 1e-9


FREE = {"thrust": Free(), "lift": Free()}


def drag(speed, lift):
    return 0.05 * speed**2 + 1e-6 * lift**2


def test_a_steady_climb_has_rates_and_outputs_that_are_not_zero(aircraft):
    at = trim(
        aircraft,
        states={"body.speed": 100.0},
        inputs=FREE,
        outputs={"climb": 5.0},
        rates={"body.height": None},
    )
    angle = np.arcsin(0.05)
    assert at.residual <= SMALL
    assert at.states["body.speed"] == 100.0
    assert at.states["body.angle"] == pytest.approx(angle)
    lift = 9810.0 * np.cos(angle)
    assert at.inputs["lift"] == pytest.approx(lift)
    assert at.inputs["thrust"] == pytest.approx(
        drag(100.0, lift) + 9810.0 * np.sin(angle)
    )
    assert at.outputs == {"climb": pytest.approx(5.0)}
    same = trim(
        aircraft, states={"body.speed": 100.0}, rates={"height": 5.0}, inputs=FREE
    )
    assert same.states["body.angle"] == pytest.approx(angle)


def test_bounds_are_kept_and_starts_choose_between_solutions():
    block = Function(lambda u: u**2 - 4.0)
    for start, expected in ((1.0, 2.0), (-1.0, -2.0)):
        at = trim(block, inputs={"u": Free(start=start)}, outputs={"y": 0.0})
        assert at.inputs["u"] == pytest.approx(expected)
    inside = trim(
        block, inputs={"u": Free(start=3.0, lower=-5.0, upper=-0.5)}, outputs={"y": 0.0}
    )
    assert inside.inputs["u"] == pytest.approx(-2.0)
    assert trim(block).residual == 0.0  # no conditions


def test_parts_of_states_and_inputs_are_fixed_or_free():
    diagram = Diagram()
    plant = diagram.add(plant=StateSpace(-np.eye(3), np.eye(3), np.ones((1, 3))))
    diagram.expose(u=plant.u, y=plant.y)
    at = trim(
        diagram,
        states={"plant.x[0:1]": 2.0},
        inputs={"u[0:2]": Free(), "u[2]": 7.0},
        outputs={"y": [12.0]},
    )
    assert_near(at.states["plant.x"], [2, 3, 7], 1e-8)
    assert_near(at.inputs["u"], [2, 3, 7], 1e-8)
    elsewhere = trim(
        diagram,
        inputs={"u": Free()},
        outputs={"plant.y": 3.0},
        at=OperatingPoint(inputs={"u": [4.0, 5.0, 6.0]}),
    )
    assert_near(elsewhere.states["plant.x"].sum(), 3.0, 1e-8)


def test_parameters_of_the_start_count_and_stay_in_the_point(aircraft):
    at = trim(
        aircraft,
        states={"body.speed": 90.0},
        inputs=FREE,
        at=OperatingPoint(parameters={"body.mass": 500.0}),
    )
    assert at.inputs["lift"] == pytest.approx(4905.0)
    assert linearize(aircraft, at=at).operating_point.parameters == {"body.mass": 500.0}


def sampled_loop(law):
    """Return a lag held at a level by a sampled law, through a sampled filter."""
    diagram = Diagram("sampled loop")
    plant, filter_, delay, law = diagram.add(
        plant=StateSpace([[-2.0]], [[1.0]], [[1.0]]),
        filter_=DiscreteStateSpace([[0.5]], [[0.5]], [[1.0]], [[0.0]], sample_time=0.1),
        delay=UnitDelay(0.25, shape=1),
        law=law,
    )
    plant >> filter_ >> delay >> law.y
    law.u >> plant.u
    diagram.expose(r=law.r, y=plant.y)
    return diagram


def cubic(y, r):
    """Return what drives the plant."""
    return 3.0 * (r - y) + (r - y) ** 3


@pytest.mark.parametrize("python", [False, True])
def test_sampled_and_python_blocks_rest_too(python):
    shapes = ports(y=1, r=1, u=1)
    law = PythonFunction(cubic, 0.05, **shapes) if python else Function(cubic, **shapes)
    diagram = sampled_loop(law)
    at = trim(diagram, inputs={"r": Free()}, outputs={"y": 1.5})
    error = at.inputs["r"][0] - 1.5
    assert 3 * error + error**3 == pytest.approx(3.0)
    assert_allclose(at.states["filter_.x"], 1.5, rtol=ROUND_OFF)
    assert_allclose(at.states["delay.previous"], 1.5, rtol=ROUND_OFF)
    assert_allclose(at.held["delay.y"], 1.5, rtol=ROUND_OFF)
    model = linearize(diagram, at=at)
    assert model.dt == 0.5


# -- what cannot be met ----------------------------------------------------------------------------


def test_an_infeasible_trim_names_equations_and_what_is_fixed(aircraft):
    with pytest.raises(TrimError) as caught:
        trim(aircraft, states={"body.speed": 100.0}, inputs={"lift": Free()})
    text = str(caught.value)
    assert "found no operating point that meets all conditions" in text
    assert "d(body/speed)/dt is off by" in text
    assert "thrust = 0 (fixed)" in text
    assert "body/speed = 100 (fixed)" in text
    assert "body/height =" not in text  # it acts on nothing
    assert "lift =" not in text  # free
    best = caught.value.best
    assert best.residual > 0.01
    assert best.states["body.speed"] == 100.0


def test_bounds_that_stand_in_the_way_are_named(aircraft):
    message = r"(?s)d\(body/speed\)/dt is off by -.*thrust = 300 \(free, at its upper bound\).*free one of these"
    little = Free(start=200.0, lower=0.0, upper=300.0)
    with pytest.raises(TrimError, match=message):
        trim(
            aircraft,
            states={"body.speed": 100.0},
            inputs={"thrust": little, "lift": Free()},
        )


def test_conditions_that_nothing_could_meet_say_so():
    block = Function(lambda u: u**2 + 1.0)
    message = (
        r"(?s)y is off by 1\n.*no variable that acts on them is fixed.*another start"
    )
    with pytest.raises(TrimError, match=message):
        trim(block, inputs={"u": Free(start=0.5)}, outputs={"y": 0.0})


def test_many_violations_are_counted_not_listed():
    block = Integrator(np.zeros(20))
    with pytest.raises(
        TrimError,
        match=r"(?s)dt is off by 1\n.*and 12 more\n.*= 1 \(fixed\).*and 12 more",
    ):
        trim(block, inputs={"u": 1.0})


def test_sampled_values_that_cannot_rest_are_named():
    counter = DiscreteStateSpace([[1.0]], [1.0], [1.0], sample_time=0.1)
    with pytest.raises(
        TrimError,
        match=r"change of DiscreteStateSpace/x\[0\] at an instant is off by 0.5\n",
    ):
        trim(counter, inputs={"u": 0.5})


@pytest.mark.parametrize(
    "arguments, error, message",
    [
        (
            {"states": {"body.mach": 1.0}},
            NameLookupError,
            r"nothing is called 'body.mach'; there are: body.speed, body.angle, body.height",
        ),
        (
            {"states": {"body.speed[0]": 1.0}},
            NameLookupError,
            r"'body.speed\[0\]' does not fit the shape \(\)",
        ),
        (
            {"rates": {"body.angle": np.nan}},
            ParameterError,
            r"rate of 'body.angle' is not finite",
        ),
        (
            {"outputs": {"climb": [1.0, 2.0]}},
            ParameterError,
            r"output 'climb' has shape \(2,\)",
        ),
        (
            {"states": {"body.speed": [1.0, 2.0]}},
            ParameterError,
            r"state 'body.speed' has shape \(2,\); it must have shape \(\)",
        ),
        (
            {"inputs": {"lift": Free(lower=2.0, upper=1.0)}},
            LinearAnalysisError,
            r"input 'lift': the lower bound must be below the upper one",
        ),
        (
            {"inputs": {"lift": "much"}},
            ParameterError,
            r"input 'lift' must be numeric, not 'much'",
        ),
        (
            {"tolerance": 0.0},
            LinearAnalysisError,
            r"tolerance = 0.0 must be a positive and finite",
        ),
    ],
)
def test_conditions_that_make_no_sense_are_refused(aircraft, arguments, error, message):
    with pytest.raises(error, match=message):
        trim(aircraft, **arguments)


def test_equations_that_are_not_finite_are_named():
    root = Function(lambda u: np.sqrt(u) - 2.0)
    with pytest.raises(
        LinearAnalysisError, match=r"cannot trim: y has no finite value on the way"
    ):
        trim(root, inputs={"u": Free(start=-1.0)}, outputs={"y": 0.0})
    with pytest.raises(
        LinearAnalysisError, match=r"cannot trim: y has no finite derivative on"
    ):
        trim(root, inputs={"u": Free(start=0.0)}, outputs={"y": 0.0})
    at = trim(root, inputs={"u": Free(start=1.0, lower=0.0)}, outputs={"y": 0.0})
    assert at.inputs["u"] == pytest.approx(4.0)
