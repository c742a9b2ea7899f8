r"""Spatial vectors and inertias about the truss origin, in truss axes (Featherstone 2008, chapter 2).

A spatial motion is (velocity of the body point at :math:`O_t`; angular velocity), a spatial
force (force; torque about :math:`O_t`). With one reference point and one set of axes, the
motions, forces and inertias of different bodies add without 6×6 coordinate transformations.
The paper's recursion (Eqs. 36–39) has the same quantities with the joints as reference points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trussflow.blocks.support.types import Array
from trussflow.models.geometry.rotation import cross, cross_matrix, matrix_of


class SpatialInertia(NamedTuple):
    """Mass, static moment and inertia of one or several bodies.

    Attributes
    ----------
    mass : float
        Mass [kg].
    static_moment : array, shape (3,)
        Mass integral of the position [kg·m].
    inertia : array, shape (3, 3)
        Inertia matrix about the reference point [kg·m²].
    """

    mass: float
    static_moment: Array
    inertia: Array


def moved_inertia(
    body: SpatialInertia, rotation: Array, position: Array
) -> SpatialInertia:
    r"""Return the inertia of a body about :math:`O_t` from that about the origin of its own frame.

    .. math::
        S' = R S + m p, \qquad
        J' = R J R^T + 2 (p^T R S) I - p (R S)^T - (R S) p^T + m (p^T p\, I - p p^T)

    Parameters
    ----------
    body : SpatialInertia
        Inertia about the origin and in the axes of the body frame.
    rotation : array, shape (3, 3)
        Rotation from body frame to truss axes, :math:`R`.
    position : array, shape (3,)
        Origin of the body frame, :math:`p` [m].

    Returns
    -------
    SpatialInertia
        Inertia about :math:`O_t`, in truss axes.
    """
    arm = rotation @ body.static_moment
    # p (R S + m p / 2)^T plus its transpose is the sum of both mixed terms and m p p^T.
    mixed = np.outer(position, arm + (body.mass / 2.0) * position)
    spread = 2.0 * (position @ arm) + body.mass * (position @ position)
    inertia = (
        rotation @ body.inertia @ rotation.T - mixed - mixed.T + spread * np.eye(3)
    )
    return SpatialInertia(body.mass, arm + body.mass * position, _mirrored(inertia))


def combined(first: SpatialInertia, second: SpatialInertia) -> SpatialInertia:
    """Return the sum of the inertias of two bodies.

    Parameters
    ----------
    first, second : SpatialInertia
        Inertias about the same point, in the same axes.

    Returns
    -------
    SpatialInertia
    """
    return SpatialInertia(
        first.mass + second.mass,
        first.static_moment + second.static_moment,
        first.inertia + second.inertia,
    )


def inertia_matrix(body: SpatialInertia) -> Array:
    r"""Return the 6×6 matrix from motion to momentum, :math:`[m I, -S^\times; S^\times, J]`.

    Parameters
    ----------
    body : SpatialInertia
        Inertia about the truss origin.

    Returns
    -------
    array, shape (6, 6)
        Matrix [kg, kg·m; kg·m, kg·m²].
    """
    moment = cross_matrix(body.static_moment)
    return np.block([[body.mass * np.eye(3), -moment], [moment, body.inertia]])


def momentum(body: SpatialInertia, motion: Array) -> Array:
    """Return the product of inertia and motion, without the 6×6 matrix.

    Parameters
    ----------
    body : SpatialInertia
        Inertia about the truss origin.
    motion : array, shape (6,)
        Velocity [m/s; rad/s] or acceleration [m/s²; rad/s²].

    Returns
    -------
    array, shape (6,)
        Momentum [kg·m/s; N·m·s] or rate of change of momentum [N; N·m].
    """
    linear, angular = motion[:3], motion[3:]
    on_linear = body.mass * linear + cross(angular, body.static_moment)
    return np.concatenate(
        [on_linear, cross(body.static_moment, linear) + body.inertia @ angular]
    )


def motion_product(velocity: Array, motion: Array) -> Array:
    """Return the cross product of motions: the rate of a motion vector that moves with `velocity`.

    Parameters
    ----------
    velocity : array, shape (6,)
        [m/s; rad/s].
    motion : array, shape (6,)
        Any motion vector.

    Returns
    -------
    array, shape (6,)
        `motion`'s unit times rad/s.
    """
    linear = cross(velocity[3:], motion[:3]) + cross(velocity[:3], motion[3:])
    return np.concatenate([linear, cross(velocity[3:], motion[3:])])


def force_product(velocity: Array, force: Array) -> Array:
    """Return the cross product of motion and force: the rate of a force vector that moves with `velocity`.

    Parameters
    ----------
    velocity : array, shape (6,)
        [m/s; rad/s].
    force : array, shape (6,)
        Any force or momentum vector.

    Returns
    -------
    array, shape (6,)
        `force`'s unit times rad/s.
    """
    torque = cross(velocity[:3], force[:3]) + cross(velocity[3:], force[3:])
    return np.concatenate([cross(velocity[3:], force[:3]), torque])


def inertial_force(body: SpatialInertia, velocity: Array, acceleration: Array) -> Array:
    r"""Return the inertial force of a body by Newton–Euler, :math:`I a + v \times^* I v`.

    Parameters
    ----------
    body : SpatialInertia
        Inertia about the truss origin.
    velocity : array, shape (6,)
        [m/s; rad/s].
    acceleration : array, shape (6,)
        Spatial acceleration: rates of the velocity components [m/s²; rad/s²].

    Returns
    -------
    array, shape (6,)
        [N; N·m].

    References
    ----------
    Li, Wei, Chen (2026), rigid-body terms of Eq. 23. Featherstone (2008), Eq. 2.63.
    """
    return momentum(body, acceleration) + force_product(
        velocity, momentum(body, velocity)
    )


def _mirrored(matrix: Array) -> Array:
    """Return a symmetric 3×3 matrix from its upper triangle.

    The lower triangle of a traced matrix has different expressions of the same values. If the upper
    triangle is used twice, the compiler evaluates it once.
    """
    return matrix_of(
        [[matrix[min(i, j), max(i, j)] for j in range(3)] for i in range(3)]
    )
