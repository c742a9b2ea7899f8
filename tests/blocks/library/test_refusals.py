"""Values that blocks refuse when they are made, and the messages of these errors."""

import control
import numpy as np
import pytest
from refused import check_refused, over_calls

from trussflow.blocks import (
    ConventionalSlidingMode,
    Input,
    IntegralSlidingMode,
    Output,
    ShapedTrajectory,
    Sine,
    StateMachine,
    StateSpace,
    Step,
    Switch,
    Table,
    TimeFunction,
    TimeTable,
    TransferFunction,
    TransportDelay,
    Trapezoid,
    UnitDelay,
    VariableDelay,
    Waypoints,
    WeightedAllocation,
    as_block,
    from_control,
    lqr,
    sampled_delay,
)

A, B, C = np.eye(3), np.ones((3, 2)), np.ones((2, 3))
PLANT = control.ss(np.eye(2), np.eye(2), np.eye(2), 0.0)
TWO_BY_TWO = control.tf([[[1.0], [1.0]]] * 2, [[[1.0, 1.0]] * 2] * 2)
GAINS = {
    "gamma": 1.0,
    "mu": 0.25,
    "beta": 0.9,
    "eta": 0.001,
    "sigma": 0.3,
    "boundary_layer": 1e-3,
}
u, y = {"u": Input()}, {"y": Output()}


def integral(**gains):
    return IntegralSlidingMode(**{**GAINS, **gains})


def conventional(slope=1.0, eta=1.0, **gains):
    return ConventionalSlidingMode(slope=slope, eta=eta, **gains)


def shaped(trajectory=1.0, frequency=0.4, **settings):
    return ShapedTrajectory(trajectory, frequency, **settings)


@pytest.mark.parametrize(
    "build, message",
    [
        (lambda: Gain(np.eye(2)), r"gain of shape \(2, 2\); .* use MatrixGain\(K\)"),
        (lambda: MatrixGain(2.0), r"MatrixGain needs a matrix; got shape \(\)"),
        (
            lambda: Function(np.abs, {"u": 3}),
            r"input 'u' must be an Input\(...\), not 3",
        ),
        (lambda: Function(3), "Function needs a function that it can call, not 3"),
        (
            lambda: Function(np.abs, u, {"u": Output()}),
            "'u' is declared as an input and as an output",
        ),
        (lambda: Function(np.abs, outputs={}), "Function needs at least one output"),
        (
            lambda: PythonFunction(abs, 0.0, inputs=u, outputs=y),
            "cannot sample 'PythonFunction' every 0.0 s",
        ),
        (
            lambda: PythonFunction(abs, 0.1, inputs={}, outputs=u),
            r"PythonFunction: output 'u' must be an Output\(...\)",
        ),
        (
            lambda: PythonFunction(abs, 0.1, inputs={"name": Input()}, outputs=y),
            "declares 'name'",
        ),
        (lambda: as_block(3), "as_block makes blocks of functions, not of 3"),
        (lambda: BoundedAllocation(0, [1]), "cannot meet 0 demands"),
        (lambda: BoundedAllocation(1.5, [1]), "cannot meet 1.5 demands"),
        (lambda: BoundedAllocation(1, 1.0), r"got weights of shape \(\)"),
        (lambda: BoundedAllocation(1, []), r"got weights of shape \(0,\)"),
        (lambda: WeightedAllocation(3, [1, 1]), "meet 3 demands with 2 actuators"),
        (
            lambda: StateSpace(np.ones((2, 3)), B, C),
            r"A has shape \(2, 3\); it must be",
        ),
        (lambda: StateSpace(A, B[:2], C), r"B has shape \(2, 2\); with 3 states it"),
        (lambda: StateSpace(A, B, C.T), r"C has shape \(3, 2\); with 3 states it"),
        (
            lambda: StateSpace(A, B, C, [1.0]),
            r"D has shape \(1,\); .* require \(2, 2\)",
        ),
        (lambda: StateSpace(A * np.nan, B, C), "A of StateSpace is not finite"),
        (lambda: TransferFunction([1.0], [2.0]), "has no pole; use a Gain"),
        (lambda: TransferFunction([1], [0.0]), "has no pole"),
        (lambda: TransferFunction([1, 0, 0], [1, 1]), "numerator has order 2, the den"),
        (lambda: TransferFunction([[1]], [1, 1]), "numerator must be a list of coef"),
        (lambda: from_control(3.0), "cannot make a block of 3.0: it must be a control"),
        (
            lambda: from_control(TWO_BY_TWO),
            r"with one input and one output; control.ss\(system\) converts others",
        ),
        (
            lambda: from_control(control.ss(0.5, 1.0, 1.0, 0.0, True)),
            "sample time is not given",
        ),
        (
            lambda: lqr(3, 1.0, 1.0),
            "lqr needs a control.StateSpace, with its sample time .*, not 3",
        ),
        (lambda: lqr(PLANT, np.eye(3), np.eye(2)), "lqr cannot regulate this system: "),
        (lambda: UnitDelay(0.0), "cannot sample 'UnitDelay' every 0.0 s"),
        (lambda: UnitDelay(0.1, offset=0.1), "cannot sample 'UnitDelay' every"),
        (lambda: RateLimiter(1.0, np.inf), "cannot sample 'RateLimiter' every inf s"),
        (
            lambda: RetimedQuintic(1.0, 60.0, 0.0),
            "the sample time must be positive and finite",
        ),
        (lambda: DiscreteStateSpace(1, 1, 1, sample_time=0.1), r"A has shape \(\)"),
        (
            lambda: sampled_delay(0.02, 0.01234567),
            "samples of 0.02 s by 0.0123457 s: take 0 to 100",
        ),
        (
            lambda: sampled_delay(0.02, -0.02),
            "cannot delay samples of 0.02 s by -0.02 s",
        ),
        (
            lambda: sampled_delay(0, 0.02),
            "'sample_time' of sampled_delay is 0.0; it must be above 0",
        ),
        (
            lambda: TransportDelay(0.0),
            "'delay' of TransportDelay is 0.0; it must be above 0",
        ),
        (lambda: TransportDelay(1.0, pade=0), "from 1 to 10"),
        (lambda: TransportDelay(1.0, points=5), "'points'.* must be at least 20"),
        (
            lambda: VariableDelay(0.5, 0.4),
            "'longest' of VariableDelay is 0.4; it must be at least 0.5",
        ),
        (
            lambda: Drift(1.0, 0.1, seed=1, correlation_time=0),
            "'correlation_time' of Drift is 0.0; it",
        ),
        (lambda: Relay(start_on=2), "start_on=True or"),
        (
            lambda: Switch([1.0, 1.0]),
            r"Switch needs increasing thresholds; got \[1.0, 1.0\]",
        ),
        (lambda: Pulse(0.0), "'period' of Pulse is 0.0; it must be above 0"),
        (
            lambda: Pulse(width=1.0),
            "'width' of Pulse is 1.0; it must be above 0 and below 1",
        ),
        (lambda: TimeFunction(3), "TimeFunction needs a function of time, not 3"),
        (lambda: TimeFunction(lambda: 1.0), "needs a function of time: .*argument"),
        (lambda: Step(np.nan), "'time' of Step is not finite: nan"),
        (
            lambda: Ramp(start_time="now"),
            "'start_time' of Ramp must be numeric, not 'now'",
        ),
        (
            lambda: Table([0.0], [1.0]),
            r"Table needs at least two increasing points; got \[0.0\]",
        ),
        (
            lambda: Table([0.0, 1.0], [[0, 1], [1, 2]]),
            "one number per element .* one Table",
        ),
        (
            lambda: TimeTable([0.0, 1.0, 1.0], [0, 1, 2]),
            "TimeTable needs .* increasing points",
        ),
        (
            lambda: TimeTable([0.0, 1.0], [0, 1, 2]),
            r"2 points, but values of shape \(3,\)",
        ),
        (
            lambda: GridTable([[1.0, 0.0]], [1.0, 2.0]),
            "GridTable needs at least two increasing points",
        ),
        (
            lambda: GridTable([[0, 1]] * 2, [1, 2]),
            r"axes of \(2, 2\) points, but values of shape \(2,\)",
        ),
        (lambda: GridTable([], 1.0), r"axes of \(\) points"),
        (
            lambda: GridTable([[0, 1]] * 2, np.eye(2), units=("N",)),
            "GridTable has 2 inputs; give a list of as many units",
        ),
        (
            lambda: Trapezoid(1, 1, 1, start_time=np.nan),
            "'start_time' of Trapezoid is not finite",
        ),
        (lambda: Waypoints([1.0, 0.0], [0, 1]), r"increasing times; got \[1.0, 0.0\]"),
        (lambda: Waypoints([0, 1], [1, 2, 3]), r"2 times, but positions of shape \(3,"),
        (
            lambda: Waypoints([0, 1], [1, np.nan]),
            "positions of Waypoints is not finite",
        ),
        (
            lambda: shaped(Quintic(1.0, 1.0), 0.0),
            "'frequency' of ShapedTrajectory is 0.0; it must be",
        ),
        (
            lambda: shaped(Quintic(1.0, 1.0), damping=1.0),
            "is 1.0; it must be at least 0 and below 1",
        ),
        (lambda: shaped(Quintic(1.0, 1.0), [1.0, 2.0]), "frequency"),
        (
            lambda: shaped(Quintic(1.0, 1.0), kind="EI"),
            "kind .* 'EI'; choose from: ZV, ZVD",
        ),
        (shaped, "a trajectory that depends on time alone"),
        (
            lambda: shaped(RetimedQuintic(1.0, 2.0, 0.1)),
            "a trajectory that depends on time alone",
        ),
        (
            lambda: StateMachine({"a": {"go": "b"}}, 0.1),
            "StateMachine has no mode 'b'; its modes are: a",
        ),
        (lambda: StateMachine({}, 0.1), "StateMachine has no modes"),
        (
            lambda: StateMachine({"a": {"mode": "a"}}, 0.1),
            "StateMachine cannot have a condition 'mode'",
        ),
    ],
)
def test_arguments_of_blocks(build, message):
    with pytest.raises(BlockError, match=message):
        build()


@pytest.mark.parametrize("name", GAINS)
def test_gains_of_sliding_modes_are_positive(name):
    with pytest.raises(errors.ParameterError, match=f"'{name}' of .* is -1"):
        integral(**{name: -1.0})
