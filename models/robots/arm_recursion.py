r"""The dynamics of one robot, by recursion along its chain.

Outward: positions, velocities and the accelerations at zero joint accelerations. Inward:
composite inertias and forces. Everything is about the truss origin in truss axes (see
`trussflow.models.geometry.spatial`), so the inward sums need no transformations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.models.geometry.spatial import (
    SpatialInertia,
    combined,
    inertial_force,
    momentum,
    motion_product,
    moved_inertia,
)
from trussflow.models.robots.robot_arm import RobotArm


class ArmTerms(NamedTuple):
    r"""What one robot adds to the equations of the system, n joints.

    With the acceleration :math:`a_0` of the hand (spatial, about :math:`O_t`) the robot obeys

    .. math::
        f_0 = I_c a_0 + F^T \ddot\theta + f_b, \qquad
        u = F a_0 + M \ddot\theta + b

    where :math:`f_0` is the force the truss exerts on the hand and :math:`u` are the joint
    torques.

    Attributes
    ----------
    mass_matrix : array, shape (n, n)
        :math:`M` [kg·m²].
    root_coupling : array, shape (n, 6)
        :math:`F`: row j is the momentum of all bodies beyond joint j per joint rate [kg·m; kg·m²].
    joint_bias : array, shape (n,)
        :math:`b` [N·m].
    static_moment : array, shape (3,)
        Of the whole robot about :math:`O_t` [kg·m].
    inertia : array, shape (3, 3)
        Of the whole robot about :math:`O_t` [kg·m²].
    root_bias : array, shape (6,)
        :math:`f_b` [N; N·m].
    base_rotation : array, shape (3, 3)
        Base frame :math:`O_i` to truss axes.
    base_position : array, shape (3,)
        Centroid of the base in :math:`O_t` [m].
    screws : array, shape (n, 6)
        Row j is the motion of what lies beyond joint j per joint rate [m; 1].
    """

    mass_matrix: Array
    root_coupling: Array
    joint_bias: Array
    static_moment: Array
    inertia: Array
    root_bias: Array
    base_rotation: Array
    base_position: Array
    screws: Array


class _Chain(NamedTuple):
    """Results of the outward pass: per body inertia and force, per joint screw."""

    inertias: list[SpatialInertia]
    forces: list[Array]
    screws: list[Array]
    base_rotation: Array
    base_position: Array


def arm_terms(
    arm: RobotArm,
    joint_angles: Array,
    joint_rates: Array,
    grasp_rotation: Array,
    grasp_position: Array,
    hand_velocity: Array,
    hand_acceleration: Array,
) -> ArmTerms:
    """Return what a robot adds to the equations of the system.

    Parameters
    ----------
    arm : RobotArm
        Any number n of joints.
    joint_angles : array, shape (n,)
        [rad].
    joint_rates : array, shape (n,)
        [rad/s].
    grasp_rotation : array, shape (3, 3)
        Elastic rotation of the truss at the grasp point; the identity if undeformed.
    grasp_position : array, shape (3,)
        Grasp point in the truss frame, elastic displacement included [m].
    hand_velocity : array, shape (6,)
        Velocity of the hand, about and in the truss frame [m/s; rad/s].
    hand_acceleration : array, shape (6,)
        Spatial acceleration of the hand at zero generalized accelerations [m/s²; rad/s²].

    Returns
    -------
    ArmTerms

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 22, 23, 36–39, with composite inertias in place of sums over
    34-column partial velocities; the results are the same.
    """
    rotation = grasp_rotation @ arm.hand_rotation
    chain = _outward(
        arm, joint_angles, joint_rates, rotation, grasp_position, hand_velocity, hand_acceleration
    )
    return _inward(chain)


def _outward(
    arm: RobotArm,
    angles: Array,
    rates: Array,
    rotation: Array,
    position: Array,
    velocity: Array,
    acceleration: Array,
) -> _Chain:
    """Go from the hand to the base, link by link."""
    cosines, sines = np.cos(angles), np.sin(angles)
    inertias = [moved_inertia(arm.bodies[0], rotation, position)]
    forces = [inertial_force(inertias[0], velocity, acceleration)]
    screws: list[Array] = []
    for j in range(arm.joints):
        position = position + rotation @ arm.joint_origins[j]
        rotation = _turned(rotation @ arm.joint_rotations[j], cosines[j], sines[j])
        axis = rotation[:, 2]
        screw = np.concatenate([np.cross(position, axis), axis])
        acceleration = acceleration + motion_product(velocity, screw) * rates[j]
        velocity = velocity + screw * rates[j]
        inertias.append(moved_inertia(arm.bodies[j + 1], rotation, position))
        forces.append(inertial_force(inertias[-1], velocity, acceleration))
        screws.append(screw)
    return _Chain(
        inertias, forces, screws, rotation @ arm.base_rotation, position + rotation @ arm.base_position
    )


def _inward(chain: _Chain) -> ArmTerms:
    """Go from the base to the hand, collecting what each joint carries."""
    joints = len(chain.screws)
    carried, force = chain.inertias[-1], chain.forces[-1]
    matrix: list[list[Array]] = [[0.0] * joints for _ in range(joints)]
    coupling: list[Array] = [0.0] * joints
    bias: list[Array] = [0.0] * joints
    for j in reversed(range(joints)):
        coupling[j] = momentum(carried, chain.screws[j])
        bias[j] = chain.screws[j] @ force
        for k in range(j + 1):
            matrix[j][k] = matrix[k][j] = chain.screws[k] @ coupling[j]
        carried = combined(carried, chain.inertias[j])
        force = force + chain.forces[j]
    return ArmTerms(
        mass_matrix=np.stack([np.stack(row) for row in matrix]),
        root_coupling=np.stack(coupling),
        joint_bias=np.stack(bias),
        static_moment=carried.static_moment,
        inertia=carried.inertia,
        root_bias=force,
        base_rotation=chain.base_rotation,
        base_position=chain.base_position,
        screws=np.stack(chain.screws),
    )


def _turned(rotation: Array, cosine: Array, sine: Array) -> Array:
    """Return `rotation` followed by a turn about its z axis."""
    x, y, z = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z]).T
