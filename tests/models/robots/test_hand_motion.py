"""The hands as the paper has them; the sums over particles of the dynamics hold the exact ones."""

import numpy as np
from systems import assert_near

from trussflow.models.robots.hand_motion import hand_motion

ROUND_OFF = 1e-12


def test_published_motion_is_the_one_printed(modes, rng):
    """Eqs. 32-34 in truss axes: point velocity, spin, and their accelerations."""
    tau, rates = rng.standard_normal((2, 6))
    v, w = rng.standard_normal((2, 3))
    for grasp in range(modes.grasps):
        T, R = modes.grasp_translations[grasp], modes.grasp_rotations[grasp]
        rho = modes.grasp_positions[grasp] + T @ tau
        hand = hand_motion(
            modes.data, grasp, tau, np.concatenate([v, w]), rates, exact=False
        )
        point_velocity = v + np.cross(w, rho) + T @ rates
        spin = w + R @ rates
        assert_near(hand.position, rho, ROUND_OFF)
        assert_near(hand.velocity[3:], spin, ROUND_OFF)
        found = hand.velocity[:3] + np.cross(spin, rho)
        assert_near(found, point_velocity, ROUND_OFF)
        # Accelerations in inertial space at zero dv/dt, dw/dt, tau''.
        spin_acceleration = np.cross(w, R @ rates)
        point_acceleration = (
            np.cross(w, v) + np.cross(w, np.cross(w, rho)) + 2 * np.cross(w, T @ rates)
        )
        assert_near(hand.acceleration[3:], spin_acceleration, ROUND_OFF)
        # From the spatial acceleration, which is of the body's point passing through O_t.
        found = (
            hand.acceleration[:3]
            + np.cross(hand.acceleration[3:], rho)
            + np.cross(spin, point_velocity)
        )
        assert_near(found, point_acceleration, ROUND_OFF)
