"""A path that becomes slower under way: the same motion, within what is left, to rest at the goal."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    Constant,
    Diagram,
    Quintic,
    RetimedQuintic,
    Signals,
    Step,
    TimeTable,
    simulate,
)
from trussflow.blocks.control.trajectory import PEAK_ACCELERATION

WAY, TIME, SAMPLE = np.array([6.0, -2.0]), 60.0, 0.5
LIMIT = PEAK_ACCELERATION * WAY / TIME**2  # of the motion as given
ROUND_OFF = 1e-9  # relative; of some thousand samples
MOTION = ("position", "velocity", "acceleration")


def flown(share, duration, *, time=TIME, sample=SAMPLE):
    """Return the motion with a given share, beside the motion as given."""
    diagram = Diagram("retimed")
    path, given, source = diagram.add(
        retimed=RetimedQuintic(WAY, time, sample, start=[1.0, 0.0]),
        given=Quintic(WAY, time, start=[1.0, 0.0]),
        source=share,
    )
    source.y >> path.share
    ports = [*path.outputs(), *given.outputs()]
    return simulate(diagram, duration, step=sample, log=ports)


def test_all_of_it_is_the_quintic_bit_for_bit():
    result = flown(Constant(1.0), 1.1 * TIME)
    for name in MOTION:
        assert_array_equal(result[f"retimed.{name}"], result[f"given.{name}"])
    assert np.all(result["retimed.arrival"] == TIME)
    assert not result["retimed.overshoot"].any()


def test_a_quarter_of_the_acceleration_takes_twice_the_time():
    """The first sample apart, before which the share is not known."""
    slow, given = (
        flown(Constant(0.25), 2.2 * TIME),
        flown(Constant(1.0), 2.2 * TIME, time=2.0 * TIME),
    )
    for name in MOTION:
        scale = np.abs(given[f"given.{name}"]).max()
        assert_near(slow[f"retimed.{name}"], given[f"given.{name}"], ROUND_OFF * scale)


def test_outputs_are_derivatives_of_each_other(evaluate):
    """Within any plan, by central differences."""
    path = RetimedQuintic(WAY, TIME, SAMPLE)
    plan = {
        "began": 5.0,
        "lasts": 40.0,
        "passed": 0.3,
        "speed": 0.02,
        "way": -0.7,
        "allowed": 0.5,
    }
    step = 1e-3
    for t in np.linspace(6.0, 44.0, 20):
        before, now, after = (
            evaluate(path, each, plan, share=1.0) for each in (t - step, t, t + step)
        )
        for name, rate in pairwise(MOTION):
            slope = (after[name] - before[name]) / (2 * step)
            assert_near(slope, now[rate], 1e-7)


@given(
    st.integers(0, 140), st.floats(0.05, 1.0), st.integers(2, 600), st.floats(0.05, 1.0)
)
@example(60, 0.1, 600, 0.05)  # the second while it comes back
def test_less_is_left_at_any_time(first, share, later, second):
    """Without jumps of position and speed, within what is left, to rest at the goal; and said at once.

    The share falls before the samples `first` and `later` after that.
    """
    falls = SAMPLE * (np.array([first, first + later]) - 0.5)
    times = np.concatenate(
        [[-1.0], *(fall + np.array([0.0, 0.01 * SAMPLE]) for fall in falls)]
    )
    table = TimeTable(times, [1.0, 1.0, share, share, second])
    result = flown(table, float(np.ceil(200.0 + falls[1] + 200.0 / min(share, second))))
    time = result["time"].values
    s, ds, dds, arrival, beyond = (
        result[f"retimed.{name}"].values for name in (*MOTION, "arrival", "overshoot")
    )
    known = falls + 1.25 * SAMPLE
    left = np.where(
        time < known[0], 1.0, np.where(time < known[1], share, min(share, second))
    )
    assert np.all(np.abs(dds) <= left[:, None] * np.abs(LIMIT) * (1.0 + ROUND_OFF))
    assert np.all(
        np.abs(np.diff(ds, axis=0)) <= SAMPLE * np.abs(LIMIT) * (1.0 + ROUND_OFF)
    )
    trapezoids = SAMPLE * (ds[1:] + ds[:-1]) / 2.0
    assert np.all(
        np.abs(np.diff(s, axis=0) - trapezoids)
        <= SAMPLE**2 / 4 * np.abs(LIMIT) + ROUND_OFF
    )
    at_rest = time > arrival[-1] + ROUND_OFF
    assert at_rest.any()
    assert_allclose(s[at_rest], [[7.0, -2.0]] * at_rest.sum(), rtol=ROUND_OFF)
    assert not ds[at_rest].any()
    # that it comes back is noticed one sample later
    told = np.searchsorted(time, known[1] + SAMPLE)
    assert -ROUND_OFF <= arrival[-1] - arrival[told] <= 1.01 * SAMPLE
    assert (
        s[told:, 0].max() <= 7.0 + WAY[0] * max(beyond[told], 0.0) + ROUND_OFF
        or ds[told, 0] <= 0.0
    )


def test_stops_as_soon_as_it_can_if_the_goal_is_too_near():
    """From speed v with the greatest deceleration a, along the smooth stop: 15 v²/16 a, in 15 v/8 a."""
    result = flown(Step(30.0, initial_value=1.0, final_value=0.1), 900.0)
    position, speed = (
        result["retimed.position"].values[:, 0],
        result["retimed.velocity"].values[:, 0],
    )
    v, a = 15 / 8 * WAY[0] / TIME, 0.1 * LIMIT[0]
    farthest = 1.0 + WAY[0] / 2 + 15 / 16 * v**2 / a
    assert_allclose(position.max(), farthest, rtol=ROUND_OFF)
    stopped = result["time"][np.flatnonzero(speed <= 0.0)[1]]
    assert_near(stopped, 30.0 + 15 / 8 * v / a, 1.01 * SAMPLE)
    assert position[-1] == pytest.approx(7.0, rel=ROUND_OFF)


@pytest.mark.parametrize("share", [np.nan, 1.0, 3.0])
def test_no_number_and_more_change_nothing(share):
    path = RetimedQuintic(WAY, TIME, SAMPLE)
    plan = {
        "began": 0.0,
        "lasts": TIME,
        "passed": 0.0,
        "speed": 0.0,
        "way": 1.0,
        "allowed": 1.0,
    }
    x, u, p = (
        Signals("", v) for v in (plan, {"share": np.array(share)}, path.parameters)
    )
    assert path.update(np.float64(20.0), x, u, p) == plan


def test_nothing_left_coasts():
    result = flown(Step(30.0, initial_value=1.0, final_value=-1.0), 90.0)
    speed = result["retimed.velocity"].values[-1]
    assert_allclose(speed, 15 / 8 * WAY / TIME, rtol=1e-3)
