"""Rotations against their definitions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trussflow.models import ModelError
from trussflow.models.geometry.rotation import euler_rotation, fixed_rotation

ROUND_OFF = 1e-14


def error(computed, expected):
    return np.max(np.abs(computed - np.asarray(expected)))


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
