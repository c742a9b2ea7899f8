"""Rotations against their definitions."""

import numpy as np
import pytest
import scipy.linalg
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


def off(found, expected):
    return float(np.max(np.abs(np.asarray(found) - np.asarray(expected))))


def spin(rotation, rate):
    """Return the angular velocity in the parent frame, from dR/dt R^T = w×."""
    matrix = rate @ rotation.T
    return np.array([matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def test_cross_matrix_is_the_cross_product(rng):
    a, b = rng.standard_normal((2, 3))
    assert off(cross_matrix(a) @ b, np.cross(a, b)) < ROUND_OFF


def test_attitude_is_the_matrix_of_the_paper(rng):
    """The nine elements of b_t^T below Eq. 44, written out."""
    phi, theta, psi = angles = rng.uniform(-1.5, 1.5, 3)
    (sf, st, sp), (cf, ct, cp) = np.sin(angles), np.cos(angles)
    printed = [
        [ct * cp - sf * st * sp, -cf * sp, st * cp + sf * ct * sp],
        [ct * sp + sf * st * cp, cf * cp, st * sp - sf * ct * cp],
        [-cf * st, sf, cf * ct],
    ]
    assert off(euler_rotation(angles), printed) < ROUND_OFF
    library = Rotation.from_euler("ZXY", [psi, phi, theta]).as_matrix()
    assert off(euler_rotation(angles), library) < ROUND_OFF


def test_rate_matrix_gives_the_angular_velocity_in_body_axes(rng):
    """R^T dR/dt = w×."""
    angles, rates = rng.uniform(-1.2, 1.2, (2, 3))
    rotation = euler_rotation(angles)
    rate = np.imag(euler_rotation(angles + 1j * COMPLEX_STEP * rates)) / COMPLEX_STEP
    omega = rotation.T @ spin(rotation, rate)
    assert off(euler_rate_matrix(angles) @ rates, omega) < ROUND_OFF


def test_rate_matrix_inverse(rng):
    angles = rng.uniform(-1.2, 1.2, 3)
    product = euler_rate_matrix(angles) @ euler_rate_matrix_inverse(angles)
    assert off(product, np.eye(3)) < ROUND_OFF


def test_rate_matrix_derivative(rng):
    angles, rates = rng.uniform(-1.2, 1.2, (2, 3))
    exact = np.imag(euler_rate_matrix(angles + 1j * COMPLEX_STEP * rates)) / COMPLEX_STEP
    assert off(euler_rate_matrix_derivative(angles, rates), exact) < ROUND_OFF


def test_fixed_rotation_is_about_moving_axes(rng):
    angles = rng.uniform(-3.0, 3.0, 3)
    assert off(fixed_rotation(angles), Rotation.from_euler("XYZ", angles).as_matrix()) < ROUND_OFF


def test_quarter_turns_have_exact_zeros():
    """Table 2's rotations are signed permutations; traced code shall see their zeros."""
    rotation = fixed_rotation(np.array([np.pi / 2, 0.0, np.pi]))
    assert set(rotation.ravel()) <= {-1.0, 0.0, 1.0}


def test_fixed_rotation_needs_three_finite_angles():
    with pytest.raises(ModelError, match=r"angles of a fixed rotation has shape \(2,\); it must be \(3,\)"):
        fixed_rotation(np.array([0.0, 1.0]))
    with pytest.raises(ModelError, match="angles of a fixed rotation is not finite"):
        fixed_rotation(np.array([0.0, 1.0, np.inf]))


def test_cayley_rotation_is_a_rotation(rng):
    """For every vector, and the identity at rest without 0/0."""
    rotation = cayley_rotation(3.0 * rng.standard_normal(3))
    assert off(rotation.T @ rotation, np.eye(3)) < ROUND_OFF
    assert abs(np.linalg.det(rotation) - 1.0) < ROUND_OFF
    assert np.array_equal(cayley_rotation(np.zeros(3)), np.eye(3))


def test_cayley_rotation_is_the_product_of_its_definition(rng):
    c = rng.standard_normal(3)
    half = cross_matrix(c) / 2.0
    assert off(cayley_rotation(c), np.linalg.solve(np.eye(3) - half, np.eye(3) + half)) < ROUND_OFF


def test_cayley_rotation_agrees_with_the_exponential_to_third_order(rng):
    """The angle is 2 atan(|c|/2) = |c| - |c|³/12 + ..., about the same axis."""
    c = rng.standard_normal(3)
    sizes = np.array([0.4, 0.2, 0.1, 0.05])
    errors = [
        np.linalg.norm(cayley_rotation(s * c) - scipy.linalg.expm(cross_matrix(s * c)))
        for s in sizes / np.linalg.norm(c)
    ]
    assert np.all(np.abs(np.diff(np.log2(errors)) + 3.0) < 0.1)
    assert abs(errors[-1] / (np.sqrt(2.0) * 0.05**3 / 12.0) - 1.0) < 0.01


def test_cayley_rate_is_the_angular_velocity(rng):
    """dR/dt R^T = w×, in the undeformed frame."""
    c, rate = rng.standard_normal((2, 3))
    turned = np.imag(cayley_rotation(c + 1j * COMPLEX_STEP * rate)) / COMPLEX_STEP
    omega = spin(cayley_rotation(c), turned)
    assert off(cayley_rate_matrix(c) @ rate, omega) < ROUND_OFF
    assert off((rate + np.cross(c, rate) / 2) / (1 + c @ c / 4), omega) < ROUND_OFF


def test_cayley_bias_acceleration_is_the_rate_of_the_angular_velocity(rng):
    c, rate = rng.standard_normal((2, 3))
    exact = np.imag(cayley_rate_matrix(c + 1j * COMPLEX_STEP * rate) @ rate) / COMPLEX_STEP
    assert off(cayley_bias_acceleration(c, rate), exact) < ROUND_OFF
