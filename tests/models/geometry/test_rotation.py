"""Rotations against their definitions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trussflow.models import ModelError
from trussflow.models.geometry.rotation import (
    cayley_bias_acceleration,
    cayley_rate_matrix,
    cayley_rotation,
    cross_matrix,
    euler_rate_matrix,
    euler_rate_matrix_derivative,
    euler_rate_matrix_inverse,
    euler_rotation,
    fixed_rotation,
)

ROUND_OFF = 1e-14
COMPLEX_STEP = 1e-40


def error(computed, expected):
    return np.max(np.abs(computed - np.asarray(expected)))


def spin(rotation, rate):
    """Return the angular velocity in the parent frame, from dR/dt R^T = w×."""
    matrix = rate @ rotation.T
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def test_cross_matrix_is_the_cross_product(rng):
    a, b = rng.standard_normal((2, 3))
    assert error(cross_matrix(a) @ b, np.cross(a, b)) < ROUND_OFF


def test_attitude_is_the_matrix_of_the_paper(rng):
    """The nine elements of b_t^T below Eq. 44, written out."""
    angles = rng.uniform(-1.5, 1.5, 3)
    (sf, st, sp), (cf, ct, cp) = np.sin(angles), np.cos(angles)
    printed = [
        [ct * cp - sf * st * sp, -cf * sp, st * cp + sf * ct * sp],
        [ct * sp + sf * st * cp, cf * cp, st * sp - sf * ct * cp],
        [-cf * st, sf, cf * ct],
    ]
    assert error(euler_rotation(angles), printed) < ROUND_OFF


def test_rate_matrix_gives_the_angular_velocity_in_body_axes(rng):
    """R^T dR/dt = w×."""
    angles, rates = rng.uniform(-1.2, 1.2, (2, 3))
    rotation = euler_rotation(angles)
    rate = np.imag(euler_rotation(angles + 1j * COMPLEX_STEP * rates)) / COMPLEX_STEP
    omega = rotation.T @ spin(rotation, rate)
    assert error(euler_rate_matrix(angles) @ rates, omega) < ROUND_OFF


def test_rate_matrix_inverse(rng):
    angles = rng.uniform(-1.2, 1.2, 3)
    product = euler_rate_matrix(angles) @ euler_rate_matrix_inverse(angles)
    assert error(product, np.eye(3)) < ROUND_OFF


def test_rate_matrix_derivative(rng):
    angles, rates = rng.uniform(-1.2, 1.2, (2, 3))
    exact = (
        np.imag(euler_rate_matrix(angles + 1j * COMPLEX_STEP * rates)) / COMPLEX_STEP
    )
    assert error(euler_rate_matrix_derivative(angles, rates), exact) < ROUND_OFF


def test_fixed_rotation_is_about_moving_axes(rng):
    angles = rng.uniform(-3.0, 3.0, 3)
    assert (
        error(fixed_rotation(angles), Rotation.from_euler("XYZ", angles).as_matrix())
        < ROUND_OFF
    )


def test_quarter_turns_have_exact_zeros():
    """Table 2's rotations are signed permutations; traced code shall see their zeros."""
    rotation = fixed_rotation(np.array([np.pi / 2, 0.0, np.pi]))
    assert set(rotation.ravel()) <= {-1.0, 0.0, 1.0}


def test_fixed_rotation_needs_three_finite_angles():
    with pytest.raises(
        ModelError,
        match=r"angles of a fixed rotation has shape \(2,\); it must be \(3,\)",
    ):
        fixed_rotation(np.array([0.0, 1.0]))
    with pytest.raises(ModelError, match="angles of a fixed rotation is not finite"):
        fixed_rotation(np.array([0.0, 1.0, np.inf]))


def test_cayley_rotation_is_the_product_of_its_definition(rng):
    c = rng.standard_normal(3)
    half = cross_matrix(c) / 2.0
    assert (
        error(cayley_rotation(c), np.linalg.solve(np.eye(3) - half, np.eye(3) + half))
        < ROUND_OFF
    )


def test_cayley_rate_is_the_angular_velocity(rng):
    """dR/dt R^T = w×, in the undeformed frame."""
    c, rate = rng.standard_normal((2, 3))
    turned = np.imag(cayley_rotation(c + 1j * COMPLEX_STEP * rate)) / COMPLEX_STEP
    omega = spin(cayley_rotation(c), turned)
    assert error(cayley_rate_matrix(c) @ rate, omega) < ROUND_OFF


def test_cayley_bias_acceleration_is_the_rate_of_the_angular_velocity(rng):
    c, rate = rng.standard_normal((2, 3))
    exact = (
        np.imag(cayley_rate_matrix(c + 1j * COMPLEX_STEP * rate) @ rate) / COMPLEX_STEP
    )
    assert error(cayley_bias_acceleration(c, rate), exact) < ROUND_OFF
