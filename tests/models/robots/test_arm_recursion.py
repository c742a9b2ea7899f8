"""One robot's terms against the energy and momentum of its bodies."""

import numpy as np
import pytest

from trussflow.models import RobotArm, arm_terms
from trussflow.models.geometry.rotation import fixed_rotation

TOLERANCE = 1e-12


def at(arm, angles, rates, velocity, acceleration):
    rotation = fixed_rotation(np.array([0.3, -0.4, 0.5]))
    return arm_terms(arm, angles, rates, rotation, np.array([1.0, -2.0, 0.5]), velocity, acceleration)


@pytest.mark.parametrize("arm", [RobotArm.literal(), RobotArm.jaco()], ids=lambda arm: arm.name)
def test_composite_mass_and_centre(arm, rng):
    """The whole robot's static moment is that of its nine bodies, placed one by one."""
    angles = rng.uniform(-2, 2, 7)
    rotation = fixed_rotation(np.array([0.3, -0.4, 0.5])) @ arm.hand_rotation
    origin = np.array([1.0, -2.0, 0.5])
    moment = arm.masses[0] * origin + rotation @ arm.static_moments[0]
    for j in range(7):
        origin = origin + rotation @ arm.joint_origins[j]
        turn = fixed_rotation(np.array([0.0, 0.0, angles[j]]))
        rotation = rotation @ arm.joint_rotations[j] @ turn
        moment = moment + arm.masses[j + 1] * origin + rotation @ arm.static_moments[j + 1]
    base = origin + rotation @ (arm.base_origin + arm.base_rotation @ arm.base_centroid)
    moment = moment + arm.base_mass * base
    terms = at(arm, angles, np.zeros(7), np.zeros(6), np.zeros(6))
    assert np.max(np.abs(terms.static_moment - moment)) < TOLERANCE
    assert np.max(np.abs(terms.base_position - base)) < TOLERANCE


def test_locked_robot_is_a_rigid_body(rng):
    """At zero joint rates the root bias is that of one rigid body, v ×* I v + I a."""
    arm, angles = RobotArm.literal(), rng.uniform(-2, 2, 7)
    velocity, acceleration = rng.standard_normal((2, 6))
    terms = at(arm, angles, np.zeros(7), velocity, acceleration)
    v, w = velocity[:3], velocity[3:]
    S, J, m = terms.static_moment, terms.inertia, arm.mass
    a, alpha = acceleration[:3] + np.cross(w, v), acceleration[3:]
    force = m * a + np.cross(alpha, S) + np.cross(w, np.cross(w, S))
    torque = np.cross(S, a) + J @ alpha + np.cross(w, J @ w)
    expected = np.concatenate([force, torque])
    assert np.max(np.abs(terms.root_bias - expected)) < TOLERANCE * np.max(np.abs(expected))


def test_joint_matrix_is_the_coupling_seen_along_the_screws(rng):
    """Row j of M up to column j is the momentum beyond joint j projected on the inner screws."""
    terms = at(RobotArm.jaco(), rng.uniform(-2, 2, 7), np.zeros(7), np.zeros(6), np.zeros(6))
    projected = np.tril(terms.root_coupling @ terms.screws.T)
    assert np.max(np.abs(np.tril(terms.mass_matrix) - projected)) < TOLERANCE
    assert np.array_equal(terms.mass_matrix, terms.mass_matrix.T)


def test_joint_torques_do_not_depend_on_where_the_truss_origin_is(rng):
    """A robot at rest on the truss, its joints moving: M and b know nothing of the grasp point."""
    arm = RobotArm.literal()
    angles, rates = rng.standard_normal((2, 7))
    still = np.zeros(6)
    near = arm_terms(arm, angles, rates, np.eye(3), np.zeros(3), still, still)
    far = arm_terms(arm, angles, rates, np.eye(3), np.array([5.0, 3.0, -2.0]), still, still)
    assert np.max(np.abs(near.mass_matrix - far.mass_matrix)) < TOLERANCE
    assert np.max(np.abs(near.joint_bias - far.joint_bias)) < TOLERANCE
