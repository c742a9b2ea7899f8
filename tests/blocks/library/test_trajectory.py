"""Trajectories keep their promises, and their three outputs are derivatives of each other."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trussflow.blocks import (
    BlockError,
    Diagram,
    Integrator,
    ParameterError,
    Quintic,
    Trapezoid,
    Waypoints,
    simulate,
)

Evaluate = Callable[..., dict[str, Any]]
ROUND_OFF = 1e-12
TIMES = [0.5, 1.0, 3.0, 4.0]
POINTS = [[0.0, 1.0], [2.0, 3.0], [3.0, -4.0], [1.0, 0.0]]


def examples():
    """Return one trajectory of each kind."""
    return [
        Quintic([6.0, -2.0], 3.0, start=[1.0, 0.0], start_time=0.5),
        Trapezoid([6.0, -2.0], [3.0, 2.0], [4.0, 4.0], start=[1.0, 0.0], start_time=0.5),
        Trapezoid([0.1, -0.2], 3.0, 4.0, start_time=0.5),
        Waypoints(TIMES, POINTS),
        Waypoints(TIMES, POINTS, stop=False),
    ]


def motion(block, times, evaluate):
    """Return position, velocity and acceleration at given times."""
    rows = [evaluate(block, t) for t in times]
    position, velocity, acceleration = (
        np.array([row[name] for row in rows]) for name in ("position", "velocity", "acceleration")
    )
    return position, velocity, acceleration


def test_outputs_are_derivatives_of_each_other():
    """Integrals of velocity and acceleration give position and velocity, with all breakpoints."""
    diagram = Diagram()
    for i, example in enumerate(examples()):
        diagram.add(**{f"block_{i}": example})
        initial = POINTS[0] if isinstance(example, Waypoints) else example.parameters["start"]
        rate, position = diagram.add(
            **{f"rate_{i}": Integrator(shape=2), f"position_{i}": Integrator(initial)}
        )
        example.acceleration >> rate.u
        example.velocity >> position.u
    result = simulate(
        diagram,
        5.0,
        solver="DOP853",
        rtol=1e-10,
        atol=1e-12,
        log_step=0.05,
        progress=False,
        backend="interpreted",
    )
    for i, example in enumerate(examples()):
        for integral, port in ((f"rate_{i}", "velocity"), (f"position_{i}", "position")):
            np.testing.assert_allclose(
                result[f"{integral}.y"],
                result[f"block_{i}.{port}"],
                rtol=0,
                atol=1e-8,
                err_msg=f"{port} of {type(example).__name__}",
            )


@pytest.mark.parametrize("block", examples(), ids=lambda block: type(block).__name__)
def test_motion_is_held_outside(block, evaluate):
    first, last = block.breakpoints()[0], block.breakpoints()[-1]
    for t, edge in ((first - 1.0, first), (last + 50.0, last)):
        outside = evaluate(block, t)
        np.testing.assert_array_equal(outside["velocity"], 0.0)
        np.testing.assert_array_equal(outside["acceleration"], 0.0)
        np.testing.assert_allclose(
            outside["position"], evaluate(block, edge)["position"], rtol=0, atol=ROUND_OFF
        )


def test_quintic_meets_its_boundary_conditions(evaluate):
    block = Quintic(6.0, 60.0, unit="m")
    for t, wanted in ((0.0, 0.0), (60.0, 6.0), (80.0, 6.0)):
        found = evaluate(block, t)
        assert found["position"] == pytest.approx(wanted, abs=ROUND_OFF)
        assert found["velocity"] == found["acceleration"] == 0.0
    middle = evaluate(block, 30.0)
    assert middle["position"] == pytest.approx(3.0)
    assert middle["velocity"] == pytest.approx(15 / 8 * 6.0 / 60.0)  # the largest
    assert middle["acceleration"] == pytest.approx(0.0, abs=ROUND_OFF)
    assert block.acceleration.unit == "m/s**2"
    assert block.breakpoints() == (0.0, 60.0)


@given(
    displacement=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=3),
    limits=st.tuples(st.floats(0.1, 5.0), st.floats(0.1, 5.0)),
)
def test_trapezoid_is_as_fast_as_its_limits_allow(displacement, limits, evaluate):
    delta = np.array(displacement)
    block = Trapezoid(delta, *limits)
    position, velocity, acceleration = motion(block, np.linspace(0.0, 1.0 + block.duration, 201), evaluate)
    np.testing.assert_allclose(position[-1], delta, rtol=0, atol=ROUND_OFF)
    assert np.abs(velocity).max() <= limits[0] * (1 + ROUND_OFF)
    assert np.abs(acceleration).max() <= limits[1] * (1 + ROUND_OFF)
    # The longest way is the slowest; alone it takes the least time two limits allow.
    way, (top, rate) = np.abs(delta).max(), limits
    least = way / top + top / rate if way > top**2 / rate else 2 * np.sqrt(way / rate)
    assert block.duration == pytest.approx(least)
    np.testing.assert_allclose(np.outer(position[:, 0], delta), position * delta[0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("stop", [True, False])
def test_waypoints_are_passed_at_their_times(stop, evaluate):
    position, velocity, _ = motion(Waypoints(TIMES, POINTS, stop=stop), TIMES, evaluate)
    np.testing.assert_allclose(position, POINTS, rtol=0, atol=1e-10)
    at_rest = np.abs(velocity).max(axis=1) < 1e-10
    assert at_rest.tolist() == ([True] * 4 if stop else [True, False, False, True])


def test_flowing_motion_is_smooth_with_the_least_jerk(evaluate):
    """Up to its fourth derivative the spline goes on through the waypoints."""
    flowing, stopping = Waypoints(TIMES, POINTS, stop=False), Waypoints(TIMES, POINTS)

    def squared_jerk(block):
        times = np.linspace(TIMES[0], TIMES[-1], 3501)
        acceleration = motion(block, times, evaluate)[2]
        return float((np.diff(acceleration, axis=0) ** 2).sum())

    assert squared_jerk(flowing) < 0.2 * squared_jerk(stopping)
    for t in TIMES[1:-1]:
        sides = []
        for side in (-1.0, 1.0):
            offsets = side * np.linspace(0.02, 0.4, 4)
            acceleration = motion(flowing, t + offsets, evaluate)[2]
            sides.append(np.polyfit(offsets, acceleration, 3)[1:])  # a cubic on either side
        np.testing.assert_allclose(sides[0], sides[1], rtol=0, atol=1e-8)


def test_two_waypoints_are_one_quintic(evaluate):
    times = np.linspace(-1.0, 4.0, 51)
    quintic = motion(Quintic(2.0, 3.0, start=1.0), times, evaluate)
    for stop in (True, False):
        found = motion(Waypoints([0.0, 3.0], [1.0, 3.0], stop=stop), times, evaluate)
        np.testing.assert_allclose(found, quintic, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: Quintic(1.0, 0.0), ParameterError, r"'duration' of Quintic is 0.0; .* above 0 \[s\]"),
        (lambda: Quintic([1, 2], 1.0, start=[1, 2, 3]), ParameterError, "'start' of Quintic has"),
        (lambda: Trapezoid(1.0, -1.0, 1.0), ParameterError, "'max_velocity' of Trapezoid is -1"),
        (lambda: Trapezoid([1, 2], 1, [1, 2, 3]), ParameterError, r"'max_acceleration' .* \(2,\)"),
        (lambda: Trapezoid(np.inf, 1, 1), ParameterError, "'displacement' of Trapezoid is not finite"),
        (
            lambda: Trapezoid(1, 1, 1, start_time=np.nan),
            BlockError,
            "'start_time' of Trapezoid is not finite",
        ),
        (lambda: Waypoints([0.0], [1.0]), BlockError, "Waypoints needs at least two increasing"),
        (lambda: Waypoints([1.0, 0.0], [0, 1]), BlockError, r"increasing times; got \[1.0, 0.0\]"),
        (lambda: Waypoints([0, 1], [1, 2, 3]), BlockError, r"2 times, but positions of shape \(3,"),
        (lambda: Waypoints([0, 1], [1, np.nan]), BlockError, "positions of Waypoints is not finite"),
    ],
)
def test_nonsense_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()
