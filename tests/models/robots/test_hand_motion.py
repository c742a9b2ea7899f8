"""The hands against the time derivatives of their place and orientation."""

import numpy as np
import pytest

from trussflow.models.geometry.rotation import cayley_rotation
from trussflow.models.robots.hand_motion import hand_motion

ROUND_OFF = 1e-12
COMPLEX_STEP = 1e-40


def test_exact_motion_is_the_rate_of_the_place(modes, rng):
    """Relative to the truss frame: T tau' and the spin of the elastic rotation."""
    tau, rates = rng.standard_normal((2, 6))
    for grasp in range(modes.grasps):
        hand = hand_motion(modes.data, grasp, tau, np.zeros(6), rates, exact=True)
        spin, point = (hand.velocity[3:], hand.velocity[:3] + np.cross(hand.velocity[3:], hand.position))
        rotation = cayley_rotation(modes.grasp_rotations[grasp] @ (tau + 1j * COMPLEX_STEP * rates))
        turned = np.imag(rotation) / COMPLEX_STEP @ np.real(rotation).T
        assert np.allclose(point, modes.grasp_translations[grasp] @ rates, rtol=0, atol=ROUND_OFF)
        assert np.allclose(np.cross(spin, np.eye(3)).T, turned, rtol=0, atol=ROUND_OFF)
        assert np.allclose(hand.rotation, np.real(rotation), rtol=0, atol=ROUND_OFF)


def test_published_motion_is_the_one_printed(modes, rng):
    """Eqs. 32-34 in truss axes: point velocity, spin, and their accelerations."""
    tau, rates = rng.standard_normal((2, 6))
    v, w = rng.standard_normal((2, 3))
    for grasp in range(modes.grasps):
        T, R = modes.grasp_translations[grasp], modes.grasp_rotations[grasp]
        rho = modes.grasp_positions[grasp] + T @ tau
        hand = hand_motion(modes.data, grasp, tau, np.concatenate([v, w]), rates, exact=False)
        point_velocity = v + np.cross(w, rho) + T @ rates
        spin = w + R @ rates
        assert np.allclose(hand.position, rho, rtol=0, atol=ROUND_OFF)
        assert np.allclose(hand.velocity[3:], spin, rtol=0, atol=ROUND_OFF)
        found = hand.velocity[:3] + np.cross(spin, rho)
        assert np.allclose(found, point_velocity, rtol=0, atol=ROUND_OFF)
        # Accelerations in inertial space at zero dv/dt, dw/dt, tau''.
        spin_acceleration = np.cross(w, R @ rates)
        point_acceleration = np.cross(w, v) + np.cross(w, np.cross(w, rho)) + 2 * np.cross(w, T @ rates)
        assert np.allclose(hand.acceleration[3:], spin_acceleration, rtol=0, atol=ROUND_OFF)
        # From the spatial acceleration, which is of the body's point passing through O_t.
        found = hand.acceleration[:3] + np.cross(hand.acceleration[3:], rho) + np.cross(spin, point_velocity)
        assert np.allclose(found, point_acceleration, rtol=0, atol=ROUND_OFF)


def test_both_agree_where_the_truss_is_undeformed(modes, rng):
    rates, motion = rng.standard_normal(6), rng.standard_normal(6)
    one, two = (hand_motion(modes.data, 3, np.zeros(6), motion, rates, exact=e) for e in (False, True))
    for a, b in zip(one, two, strict=True):
        assert np.allclose(a, b, rtol=0, atol=ROUND_OFF)


@pytest.mark.parametrize("exact", [False, True])
def test_the_clamped_grasp_moves_with_the_truss(modes, rng, exact):
    """Grasp point 1 is at the clamp: no elastic motion there."""
    tau, rates, motion = rng.standard_normal((3, 6))
    hand = hand_motion(modes.data, 0, tau, motion, rates, exact=exact)
    assert np.array_equal(hand.rotation, np.eye(3))
    assert np.array_equal(hand.velocity, motion)
    assert not np.any(hand.modal_motion)
    assert not np.any(hand.acceleration)
