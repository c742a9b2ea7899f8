r"""The dynamics of one robot, by recursion along its chain.

Outward: positions, velocities and the accelerations at zero joint accelerations. Inward:
composite inertias and forces. Everything is about the truss origin in truss axes (see
`trussflow.models.geometry.spatial`), so the inward sums need no transformations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.models.geometry.rotation import cross, matrix_of, stacked
from trussflow.models.geometry.spatial import (
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
    torques, or forces of joints that slide.

    Attributes
    ----------
    mass_matrix : array, shape (n, n)
        :math:`M` [kg·m²; kg·m, kg where joints slide].
    root_coupling : array, shape (n, 6)
        :math:`F`: row j is the momentum of all bodies beyond joint j per joint rate [kg·m; kg·m²; kg;
        kg·m where joints slide].
    joint_bias : array, shape (n,)
        :math:`b` [N·m; N where joints slide].
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
        Row j is the motion of what lies beyond joint j per joint rate [m; 1; 1; 0 where joints slide].
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
        [rad; m where joints slide].
    joint_rates : array, shape (n,)
        [rad/s; m/s].
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
    # Outward, from the hand to the base: where each body is, and the force it needs.
    rotation, position = grasp_rotation @ arm.hand_rotation, grasp_position
    velocity, acceleration = hand_velocity, hand_acceleration
    cosines, sines = np.cos(joint_angles), np.sin(joint_angles)
    inertias = [moved_inertia(arm.bodies[0], rotation, position)]
    forces = [inertial_force(inertias[0], velocity, acceleration)]
    screws: list[Array] = []
    for j in range(arm.joints):
        position = position + rotation @ arm.joint_origins[j]
        rotation = rotation @ arm.joint_rotations[j]
        axis = rotation[:, 2]
        if arm.sliding[j]:
            position = position + axis * joint_angles[j]
            screw = np.concatenate([axis, np.zeros(3)])
        else:
            rotation = _turned(rotation, cosines[j], sines[j])
            screw = np.concatenate([cross(position, axis), axis])
        # The screw is fixed to both bodies of its joint, so the inner one's velocity moves it.
        acceleration = acceleration + motion_product(velocity, screw) * joint_rates[j]
        velocity = velocity + screw * joint_rates[j]
        inertias.append(moved_inertia(arm.bodies[j + 1], rotation, position))
        forces.append(inertial_force(inertias[-1], velocity, acceleration))
        screws.append(screw)

    # Inward, from the base to the hand: what each joint carries.
    carried, force = inertias[-1], forces[-1]
    matrix: list[list[Array]] = [[0.0] * arm.joints for _ in range(arm.joints)]
    coupling: list[Array] = [0.0] * arm.joints
    bias: list[Array] = [0.0] * arm.joints
    for j in reversed(range(arm.joints)):
        coupling[j] = momentum(carried, screws[j])
        bias[j] = screws[j] @ force
        for k in range(j + 1):
            matrix[j][k] = matrix[k][j] = screws[k] @ coupling[j]
        carried = combined(carried, inertias[j])
        force = force + forces[j]
    return ArmTerms(
        mass_matrix=matrix_of(matrix) if matrix else np.zeros((0, 0)),
        root_coupling=stacked(coupling, (6,)),
        joint_bias=stacked(bias, ()),
        static_moment=carried.static_moment,
        inertia=carried.inertia,
        root_bias=force,
        base_rotation=rotation @ arm.base_rotation,
        base_position=position + rotation @ arm.base_position,
        screws=stacked(screws, (6,)),
    )


def _turned(rotation: Array, cosine: Array, sine: Array) -> Array:
    """Return `rotation` followed by a turn about its z axis."""
    x, y, z = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z]).T
