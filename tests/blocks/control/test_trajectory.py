"""Trajectories keep their promises, and their three outputs are derivatives of each other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    Diagram,
    Integrator,
    Quintic,
    Trapezoid,
    Waypoints,
    simulate,
)

ROUND_OFF = 1e-12
TIMES = [0.5, 1.0, 3.0, 4.0]
POINTS = [[0.0, 1.0], [2.0, 3.0], [3.0, -4.0], [1.0, 0.0]]


def examples():
    """Return one trajectory of each kind."""
    return [
        Quintic([6.0, -2.0], 3.0, start=[1.0, 0.0], start_time=0.5),
        Trapezoid(
            [6.0, -2.0], [3.0, 2.0], [4.0, 4.0], start=[1.0, 0.0], start_time=0.5
        ),
        Trapezoid([0.1, -0.2], 3.0, 4.0, start_time=0.5),
        Waypoints(TIMES, POINTS),
        Waypoints(TIMES, POINTS, stop=False),
    ]


def motion(block, times, evaluate):
    """Return position, velocity and acceleration at given times."""
    rows = [evaluate(block, t) for t in times]
    return [
        np.array([row[name] for row in rows])
        for name in ("position", "velocity", "acceleration")
    ]


def test_outputs_are_derivatives_of_each_other():
    """Integrals of velocity and acceleration give position and velocity, with all breakpoints."""
    diagram = Diagram()
    for i, block in enumerate(examples()):
        initial = (
            POINTS[0] if isinstance(block, Waypoints) else block.parameters["start"]
        )
        rate, position = Integrator(shape=2), Integrator(initial)
        diagram.add(
            **{f"block_{i}": block, f"rate_{i}": rate, f"position_{i}": position}
        )
        block.acceleration >> rate.u
        block.velocity >> position.u
    result = simulate(
        diagram, 5.0, solver="DOP853", rtol=1e-10, atol=1e-12, log_step=0.05
    )
    for i in range(len(examples())):
        for integral, port in (("rate", "velocity"), ("position", "position")):
            expected = result[f"block_{i}.{port}"]
            assert_near(result[f"{integral}_{i}.y"], expected, 1e-8)


@pytest.mark.parametrize("block", examples(), ids=lambda block: type(block).__name__)
def test_motion_is_held_outside(block, evaluate):
    first, last = block.breakpoints()[0], block.breakpoints()[-1]
    for t, edge in ((first - 1.0, first), (last + 50.0, last)):
        outside = evaluate(block, t)
        assert_array_equal(outside["velocity"], 0.0)
        assert_array_equal(outside["acceleration"], 0.0)
        assert_near(outside["position"], evaluate(block, edge)["position"], ROUND_OFF)


@given(
    displacement=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=3),
    limits=st.tuples(st.floats(0.1, 5.0), st.floats(0.1, 5.0)),
)
def test_trapezoid_is_as_fast_as_its_limits_allow(displacement, limits, evaluate):
    delta = np.array(displacement)
    block = Trapezoid(delta, *limits)
    position, velocity, acceleration = motion(
        block, np.linspace(0.0, 1.0 + block.duration, 201), evaluate
    )
    assert_near(position[-1], delta, ROUND_OFF)
    assert np.abs(velocity).max() <= limits[0] * (1 + ROUND_OFF)
    assert np.abs(acceleration).max() <= limits[1] * (1 + ROUND_OFF)
    # The longest way is the slowest; alone it takes the least time two limits allow.
    way, (top, rate) = np.abs(delta).max(), limits
    least = way / top + top / rate if way > top**2 / rate else 2 * np.sqrt(way / rate)
    assert block.duration == pytest.approx(least)
    assert_near(np.outer(position[:, 0], delta), position * delta[0], 1e-10)


@pytest.mark.parametrize("stop", [True, False])
def test_waypoints_are_passed_at_their_times(stop, evaluate):
    position, velocity, _ = motion(Waypoints(TIMES, POINTS, stop=stop), TIMES, evaluate)
    assert_near(position, POINTS, 1e-10)
    at_rest = np.abs(velocity).max(axis=1) < 1e-10
    assert at_rest.tolist() == ([True] * 4 if stop else [True, False, False, True])


def test_flowing_motion_is_smooth_with_the_least_jerk(evaluate):
    """Up to its fourth derivative the spline goes on through the waypoints."""
    flowing, stopping = Waypoints(TIMES, POINTS, stop=False), Waypoints(TIMES, POINTS)

    def squared_jerk(block):
        times = np.linspace(TIMES[0], TIMES[-1], 701)
        acceleration = motion(block, times, evaluate)[2]
        return (np.diff(acceleration, axis=0) ** 2).sum()

    assert squared_jerk(flowing) < 0.2 * squared_jerk(stopping)
    for t in TIMES[1:-1]:
        sides = []
        for side in (-1.0, 1.0):
            offsets = side * np.linspace(0.02, 0.4, 4)
            acceleration = motion(flowing, t + offsets, evaluate)[2]
            # a cubic on either side
            sides.append(np.polyfit(offsets, acceleration, 3)[1:])
        assert_near(sides[0], sides[1], 1e-8)


def test_two_waypoints_are_one_quintic(evaluate):
    times = np.linspace(-1.0, 4.0, 51)
    quintic = motion(Quintic(2.0, 3.0, start=1.0), times, evaluate)
    for stop in (True, False):
        found = motion(Waypoints([0.0, 3.0], [1.0, 3.0], stop=stop), times, evaluate)
        assert_near(found, quintic, 1e-10)
