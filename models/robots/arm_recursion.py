r"""Dynamics of one robot: recursive Newton–Euler and composite-rigid-body algorithm.

The outward pass computes positions, velocities, and accelerations at zero joint accelerations.
The inward pass sums forces (recursive Newton–Euler algorithm, for the bias) and inertias
(composite-rigid-body algorithm, for the mass matrix). All quantities are about the truss origin
in truss axes (see `trussflow.models.geometry.spatial`), so these sums need no transformations.

References
----------
Featherstone (2008), *Rigid Body Dynamics Algorithms*, chapters 5 and 6. docs/notation.md derives both
passes from Li, Wei, Chen (2026), Eqs. 31–42.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trussflow.blocks.support.types import Array
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
    r"""Terms of one robot with n joints in the equations of the system.

    With the spatial acceleration :math:`a_0` of the hand about :math:`O_t` they are

    .. math::
        f_0 = I_c a_0 + F^T \ddot\theta + f_b, \qquad
        u = F a_0 + M \ddot\theta + b

    where :math:`f_0` is the force of the truss on the hand and :math:`u` are the joint
    torques, or forces of sliding joints.

    Attributes
    ----------
    mass_matrix : array, shape (n, n)
        :math:`M`, the drives included [kg·m²; kg·m, kg of sliding joints].
    root_coupling : array, shape (n, 6)
        :math:`F`: row j is the momentum of all bodies beyond joint j per joint rate [kg·m, kg·m²; kg,
        kg·m of sliding joints].
    joint_bias : array, shape (n,)
        :math:`b` [N·m; N of sliding joints].
    static_moment : array, shape (3,)
        Static moment of the whole robot about :math:`O_t` [kg·m].
    inertia : array, shape (3, 3)
        Inertia of the whole robot about :math:`O_t` [kg·m²].
    root_bias : array, shape (6,)
        :math:`f_b` [N; N·m].
    base_rotation : array, shape (3, 3)
        Rotation from base frame :math:`O_i` to truss axes.
    base_position : array, shape (3,)
        Centroid of the base in :math:`O_t` [m].
    screws : array, shape (n, 6)
        Row j is the motion of the bodies beyond joint j per joint rate, :math:`S_j` [m, 1; 1, 0 of sliding
        joints].
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
    """Return the terms of a robot in the equations of the system.

    Parameters
    ----------
    arm : RobotArm
        Robot with n joints.
    joint_angles : array, shape (n,)
        Angles, or displacements of sliding joints [rad; m].
    joint_rates : array, shape (n,)
        Rates of the joints [rad/s; m/s].
    grasp_rotation : array, shape (3, 3)
        Elastic rotation of the truss at the grasp point.
    grasp_position : array, shape (3,)
        Grasp point in the truss frame, elastic displacement included [m].
    hand_velocity : array, shape (6,)
        Spatial velocity of the hand about :math:`O_t` in truss axes [m/s; rad/s].
    hand_acceleration : array, shape (6,)
        Spatial acceleration of the hand at zero generalized accelerations [m/s²; rad/s²].

    Returns
    -------
    ArmTerms

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 22, 23, 31–39. Composite inertias replace the paper's sums over the
    34 columns of partial velocities; the results are equal.
    """
    # Outward pass, from hand to base (Eqs. 33-39): motion of each body, and its inertial force.
    rotation, position = grasp_rotation @ arm.hand_rotation, grasp_position
    velocity, acceleration = hand_velocity, hand_acceleration
    cosines, sines = np.cos(joint_angles), np.sin(joint_angles)
    inertias = [moved_inertia(arm.bodies[0], rotation, position)]
    forces = [inertial_force(inertias[0], velocity, acceleration)]
    screws: list[Array] = []
    for j in range(arm.joints):
        position = position + rotation @ arm.joint_origins[j]
        rotation = rotation @ arm.joint_rotations[j]
        # A joint moves about or along the z axis of its frame, which its motion keeps.
        axis = rotation[:, 2]
        if arm.sliding[j]:
            # A sliding joint does not turn the bodies beyond it: no angular part.
            position = position + axis * joint_angles[j]
            screw = np.concatenate([axis, np.zeros(3)])
        else:
            rotation = _turned(rotation, cosines[j], sines[j])
            # Velocity at O_t of a rotation about an axis through p: axis x (0 - p) = p
            # x axis.
            screw = np.concatenate([cross(position, axis), axis])
        # The screw is fixed to both bodies of its joint and so moves with the inner one.
        # Eq. 38
        acceleration = acceleration + motion_product(velocity, screw) * joint_rates[j]
        velocity = velocity + screw * joint_rates[j]  # Eq. 36
        inertias.append(moved_inertia(arm.bodies[j + 1], rotation, position))
        # rigid body in Eq. 23
        forces.append(inertial_force(inertias[-1], velocity, acceleration))
        screws.append(screw)

    # Inward pass, from base to hand: inertia and force of all bodies beyond each joint.
    carried, force = inertias[-1], forces[-1]
    matrix: list[list[Array]] = [[0.0] * arm.joints for _ in range(arm.joints)]
    coupling: list[Array] = [0.0] * arm.joints
    bias: list[Array] = [0.0] * arm.joints
    for j in reversed(range(arm.joints)):
        # composite-rigid-body algorithm, Eq. 22
        coupling[j] = momentum(carried, screws[j])
        bias[j] = screws[j] @ force  # recursive Newton-Euler algorithm, Eq. 23
        # All bodies beyond joint j move with both joints: M_jk = S_k^T I_j^c S_j, k <=
        # j.
        for k in range(j + 1):
            matrix[j][k] = matrix[k][j] = screws[k] @ coupling[j]  # Eq. 22
        # A rotor turns n times as fast as its joint; effects smaller by 1 / n are neglected.
        if arm.drive_inertias[j]:
            matrix[j][j] = matrix[j][j] + arm.drive_inertias[j]
        # Body j is on the inner side of joint j, so it does not move with that joint.
        carried = combined(carried, inertias[j])
        force = force + forces[j]
    return ArmTerms(
        mass_matrix=matrix_of(matrix) if matrix else np.zeros((0, 0)),
        root_coupling=stacked(coupling, (6,)),
        joint_bias=stacked(bias, ()),
        static_moment=carried.static_moment,
        inertia=carried.inertia,
        root_bias=force,
        # After the outward pass, `rotation` and `position` are those of the last link.
        base_rotation=rotation @ arm.base_rotation,
        base_position=position + rotation @ arm.base_position,
        screws=stacked(screws, (6,)),
    )


def _turned(rotation: Array, cosine: Array, sine: Array) -> Array:
    """Return `rotation` followed by a rotation about its z axis."""
    x, y, z = rotation[:, 0], rotation[:, 1], rotation[:, 2]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z]).T
