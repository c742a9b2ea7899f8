"""Quaternions against SciPy's rotations, and their rates by complex steps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from systems import assert_near

from trussflow.models import EULER, QUATERNION, ModelError, SpaceTruss
from trussflow.models.geometry.rotation import cross_matrix

RNG = np.random.default_rng(16)
STEP = 1e-40
ROUND_OFF = 1e-14  # some ten operations on numbers of order 1


def attitude():
    found = RNG.standard_normal(4)
    return found / np.linalg.norm(found)


def scipy_of(a):
    return Rotation.from_quat(a[[1, 2, 3, 0]])


def test_rotation_does_not_depend_on_the_length():
    a = attitude()
    for length in (1.0, -1.0, 0.7):
        assert_near(QUATERNION.rotation(length * a), scipy_of(a).as_matrix(), ROUND_OFF)


def test_rates_turn_at_the_angular_velocity_and_restore_the_length():
    a, turning = attitude(), RNG.standard_normal(3)
    for length in (1.0, 0.9):
        rates = QUATERNION.rates(length * a, turning)
        change = np.imag(QUATERNION.rotation(length * a + 1j * STEP * rates)) / STEP
        assert_near(QUATERNION.rotation(a).T @ change, cross_matrix(turning), ROUND_OFF)
        assert a @ rates == pytest.approx((1.0 - length**2) * length, abs=ROUND_OFF)


def test_turns_of_any_size():
    a = attitude()
    for angle in (0.0, 1e-9, 0.3, np.pi, 5.0):
        turn = angle * np.array([2.0, -1.0, 2.0]) / 3.0
        expected = scipy_of(a) * Rotation.from_rotvec(turn)
        turned = QUATERNION.integrate(a, turn)
        assert_near(QUATERNION.rotation(turned), expected.as_matrix(), ROUND_OFF)
        way = (scipy_of(a).inv() * expected).as_rotvec()
        size = np.linalg.norm(way)
        if angle < 3.0 or angle > 4.0:  # half a turn has two ways
            # the sine of half the angle, twice, along the axis
            error = way * np.sinc(size / 2.0 / np.pi)
            for sign in (1.0, -1.0):
                # both quaternions of the goal: never the longer way
                assert_near(QUATERNION.difference(a, sign * turned), error, ROUND_OFF)


def test_motion_of_a_goal_relative_to_an_attitude():
    """The relative rate is C w_d; the relative acceleration is its derivative, by complex steps."""
    a, goal = attitude(), attitude()
    turning, rate, acceleration = RNG.standard_normal((3, 3))
    seen, steeply = QUATERNION.reference_rates(a, turning, goal, rate, acceleration)
    assert_near(
        QUATERNION.rotation(a) @ seen, QUATERNION.rotation(goal) @ rate, ROUND_OFF
    )
    step = 1j * STEP
    later, _ = QUATERNION.reference_rates(
        a + step * QUATERNION.rates(a, turning),
        turning,
        goal + step * QUATERNION.rates(goal, rate),
        rate + step * acceleration,
        acceleration,
    )
    assert_near(np.imag(later) / STEP, steeply, ROUND_OFF)


@pytest.mark.parametrize("angles", [(0.1, 0.2, 0.3), (3.0, -0.4, 2.0)])
def test_a_truss_in_the_same_attitude(angles):
    euler = SpaceTruss.published(modes=0).turned(np.array(angles))
    truss = euler.with_quaternion()
    q = truss.parameters["initial_coordinates"]
    assert_near(
        QUATERNION.rotation(q[3:7]), EULER.rotation(np.array(angles)), ROUND_OFF
    )
    again = truss.with_quaternion().parameters["initial_coordinates"]
    assert_near(again, q, ROUND_OFF)


@pytest.mark.parametrize(
    "bad, message",
    [
        ([1.0, 1.0, 0.0, 0.0], "length of 1.41421; it must be 1, with components"),
        ([0.0, 0.0, 0.0, 0.0], "length of 0"),
        ([0.1, 0.2, 0.3], r"must be \(4,\)"),
        ([np.nan, 0.0, 0.0, 0.0], "not finite"),
    ],
)
def test_errors(bad, message):
    truss = SpaceTruss.published(modes=0).with_quaternion()
    with pytest.raises(ModelError, match=message):
        truss.turned(np.array(bad))
    if len(bad) == 4 and np.all(np.isfinite(bad)):
        start = np.concatenate([np.zeros(3), bad, truss.dynamics.rest[7:]])
        with pytest.raises(ModelError, match=message):
            SpaceTruss(truss.dynamics, start=start)
