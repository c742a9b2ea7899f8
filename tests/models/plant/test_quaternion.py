"""The plant with a quaternion: the motion with Euler angles, and motion through their singularity."""

import numpy as np
import pytest
from systems import assert_near

from trussflow.models import EULER, QUATERNION, SpaceTruss

SOLVER_ERROR = 1e-9  # what the solvers' tolerance of 1e-11 leaves after some seconds
ANGLES = (0.4, -0.3, 0.9)  # rad, far from the singularity


# Steps of an adaptive solver, to the tolerances of which SOLVER_ERROR belongs.
ADAPTIVE = {"solver": "DOP853", "rtol": 1e-11, "atol": 1e-12}


@pytest.fixture
def modules(random_system):
    """Return a flexible truss that holds two bases by its own, without symmetry, in some attitude."""
    dynamics = random_system(("", "R"), 2, elastic_integrals=True)
    return SpaceTruss(dynamics).turned(np.array(ANGLES))


def test_the_same_motion_as_with_euler_angles(modules, rng, free_motion):
    speeds = 0.3 * rng.standard_normal(modules.n)
    euler, ours = (
        free_motion(
            truss,
            2.0,
            truss.parameters["initial_coordinates"],
            speeds,
            log_step=0.05,
            **ADAPTIVE,
        )
        for truss in (modules, modules.with_quaternion())
    )
    assert np.ptp(euler.q[:, 3]) > 0.1
    assert_near(ours.v, euler.v, SOLVER_ERROR)
    assert_near(
        np.delete(ours.q, np.s_[3:7], 1),
        np.delete(euler.q, np.s_[3:6], 1),
        SOLVER_ERROR,
    )
    for one, other in zip(euler.q, ours.q, strict=True):
        assert_near(
            EULER.rotation(one[3:6]), QUATERNION.rotation(other[3:7]), SOLVER_ERROR
        )


def test_a_tumble_through_the_singularity_conserves_all(modules, free_motion):
    """Three turns about body x, which pass φ = 90° six times, with the modes and a joint in motion."""
    truss = modules.with_quaternion()
    speeds = np.r_[0.1, 0.2, -0.1, 2.0, 0.1, 0.05, np.full(truss.n - 6, 0.05)]
    start = truss.parameters["initial_coordinates"]
    motion = free_motion(truss, 10.0, start, speeds, log_step=0.25, **ADAPTIVE)
    upright = [QUATERNION.rotation(each[3:7])[2, 1] for each in motion.q]  # sin φ
    assert max(upright) > 0.9
    assert min(upright) < -0.9
    assert np.max(motion.drifts) < SOLVER_ERROR
    assert_near(np.linalg.norm(motion.q[:, 3:7], axis=1), 1.0, SOLVER_ERROR)


def test_the_length_comes_back(modules, free_motion):
    """A start that is off by a tenth has length one again after a while, and turns nothing meanwhile."""
    truss = modules.with_quaternion()
    q = truss.parameters["initial_coordinates"]
    start = np.concatenate([q[:3], 0.9 * q[3:7], q[7:]])
    motion = free_motion(
        truss, 12.0, start, np.zeros(truss.n), log_step=12.0, **ADAPTIVE
    )
    assert_near(motion.q[-1], q, SOLVER_ERROR)
