r"""Rotations: 3-1-2 Euler angles, fixed frame rotations, small elastic rotations.

A rotation matrix maps components in the child frame to components in the parent frame.
All functions except `fixed_rotation` can be traced.

References
----------
Li, Wei, Chen (2026), *Anti-Disturbance Trajectory Tracking Control of Large Space Flexible
Truss by Four Space Robots*, Actuators 15(2), 108, Eq. 44 and the matrices below it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.models.validation import frozen_array

# cross_matrix(a)[i, j] = CROSS[i, j, k] a[k]: minus the Levi-Civita symbol.
_CROSS = np.zeros((3, 3, 3))
_CROSS[0, 1, 2] = _CROSS[1, 2, 0] = _CROSS[2, 0, 1] = -1.0
_CROSS[0, 2, 1] = _CROSS[2, 1, 0] = _CROSS[1, 0, 2] = 1.0

# Sines and cosines of multiples of 90 degrees are 1e-16 instead of 0 in floating point. Elements below
# this tolerance are set to zero, so that traced code can omit them.
_ROUND_OFF = 1e-15


def cross_matrix(vector: Array) -> Array:
    r"""Return the matrix of the cross product, :math:`a^\times b = a \times b`.

    Parameters
    ----------
    vector : array, shape (3,)
        Components of :math:`a`, any unit and frame.

    Returns
    -------
    array, shape (3, 3)
        Skew-symmetric, unit and frame of `vector`.

    References
    ----------
    Li, Wei, Chen (2026), below Eq. 10.
    """
    return _CROSS @ vector


def cross(a: Array, b: Array) -> Array:
    r"""Return :math:`a \times b` of two vectors, equal to ``np.cross`` but faster.

    Equations are evaluated in NumPy during the check of a block, and without a compiler. ``np.cross`` would
    take a third of that time, most of it for the handling of axes.

    Parameters
    ----------
    a, b : array, shape (3,)
        Any unit and frame.

    Returns
    -------
    array, shape (3,)
        Product of the units, in the frame of both.
    """
    if not (
        isinstance(a, np.ndarray)
        and isinstance(b, np.ndarray)
        and a.shape == b.shape == (3,)
    ):
        return np.cross(a, b)
    (x, y, z), (X, Y, Z) = a.tolist(), b.tolist()
    return np.array([y * Z - z * Y, z * X - x * Z, x * Y - y * X])


def stacked(rows: Sequence[Array], shape: tuple[int, ...]) -> Array:
    """Return stacked arrays of one shape, traced or not; an empty array if there are none.

    Parameters
    ----------
    rows : sequence of array
        Arrays to stack, any unit.
    shape : tuple of int
        Shape of each array.
    """
    return np.stack(rows) if len(rows) else np.zeros((0, *shape))


def matrix_of(rows: Sequence[Sequence[Array]]) -> Array:
    """Return a matrix from its elements, traced or not.

    Parameters
    ----------
    rows : sequence of sequence of float
        Elements row by row, any unit.
    """
    # faster than np.stack
    plain = all(isinstance(element, float) for row in rows for element in row)
    return np.array(rows) if plain else np.stack([np.stack(row) for row in rows])


def cosine_and_sine(angle: Array) -> tuple[Array, Array]:
    """Return cosine and sine of an angle.

    Parameters
    ----------
    angle : float
        [rad].
    """
    return np.cos(angle), np.sin(angle)


def rotation_about_x(angle: Array) -> Array:
    """Return the rotation about the x axis.

    Parameters
    ----------
    angle : float
        [rad].

    Returns
    -------
    array, shape (3, 3)
    """
    c, s = cosine_and_sine(angle)
    return matrix_of([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_about_y(angle: Array) -> Array:
    """Return the rotation about the y axis.

    Parameters
    ----------
    angle : float
        [rad].

    Returns
    -------
    array, shape (3, 3)
    """
    c, s = cosine_and_sine(angle)
    return matrix_of([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_about_z(angle: Array) -> Array:
    """Return the rotation about the z axis.

    Parameters
    ----------
    angle : float
        [rad].

    Returns
    -------
    array, shape (3, 3)
    """
    c, s = cosine_and_sine(angle)
    return matrix_of([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def euler_rotation(angles: Array) -> Array:
    r"""Return the truss attitude from its 3-1-2 Euler angles.

    .. math:: R_t = R_z(\psi)\, R_x(\phi)\, R_y(\theta)

    Parameters
    ----------
    angles : array, shape (3,)
        :math:`\Theta_t = (\phi, \theta, \psi)` [rad].

    Returns
    -------
    array, shape (3, 3)
        Rotation from the truss frame to the inertial frame.

    References
    ----------
    Li, Wei, Chen (2026), the matrix :math:`b_t^T` below Eq. 44.
    """
    phi, theta, psi = angles[0], angles[1], angles[2]
    return rotation_about_z(psi) @ rotation_about_x(phi) @ rotation_about_y(theta)


def euler_rate_matrix(angles: Array) -> Array:
    r"""Return the matrix from Euler rates to angular velocity, :math:`\omega_t = A \dot\Theta_t`.

    Parameters
    ----------
    angles : array, shape (3,)
        :math:`\Theta_t = (\phi, \theta, \psi)` [rad].

    Returns
    -------
    array, shape (3, 3)
        :math:`A`, for the angular velocity [rad/s] in the truss frame. Singular where
        :math:`\cos\phi = 0`.

    References
    ----------
    Li, Wei, Chen (2026), the matrix :math:`A_t` below Eq. 44.
    """
    c_phi, s_phi = cosine_and_sine(angles[0])
    c_theta, s_theta = cosine_and_sine(angles[1])
    return matrix_of(
        [
            [c_theta, 0.0, -c_phi * s_theta],
            [0.0, 1.0, s_phi],
            [s_theta, 0.0, c_phi * c_theta],
        ]
    )


def euler_rate_matrix_inverse(angles: Array) -> Array:
    r"""Return the matrix from angular velocity to Euler rates, :math:`A^{-1}`.

    Parameters
    ----------
    angles : array, shape (3,)
        :math:`\Theta_t = (\phi, \theta, \psi)` [rad]; infinite where :math:`\cos\phi = 0`.

    Returns
    -------
    array, shape (3, 3)
        Maps the angular velocity [rad/s] in the truss frame to :math:`\dot\Theta_t` [rad/s].

    References
    ----------
    Inverse of :math:`A_t`, Li, Wei, Chen (2026), below Eq. 44.
    """
    c_phi, t_phi = np.cos(angles[0]), np.tan(angles[0])
    c_theta, s_theta = cosine_and_sine(angles[1])
    return matrix_of(
        [
            [c_theta, 0.0, s_theta],
            [t_phi * s_theta, 1.0, -t_phi * c_theta],
            [-s_theta / c_phi, 0.0, c_theta / c_phi],
        ]
    )


def euler_rate_matrix_derivative(angles: Array, rates: Array) -> Array:
    r"""Return the time derivative of the Euler rate matrix, :math:`\dot A(\Theta, \dot\Theta)`.

    Parameters
    ----------
    angles : array, shape (3,)
        :math:`\Theta_t = (\phi, \theta, \psi)` [rad].
    rates : array, shape (3,)
        :math:`\dot\Theta_t` [rad/s].

    Returns
    -------
    array, shape (3, 3)
        :math:`\dot A` [1/s] of :math:`\dot\omega_t = A \ddot\Theta_t + \dot A \dot\Theta_t`, the
        angular part of :math:`\dot J_g` (Li, Wei, Chen 2026, Eq. 53).
    """
    c_phi, s_phi = cosine_and_sine(angles[0])
    c_theta, s_theta = cosine_and_sine(angles[1])
    d_phi, d_theta = rates[0], rates[1]
    by_phi, by_theta = s_phi * d_phi, c_phi * d_theta
    return matrix_of(
        [
            [-s_theta * d_theta, 0.0, by_phi * s_theta - by_theta * c_theta],
            [0.0, 0.0, c_phi * d_phi],
            [c_theta * d_theta, 0.0, -by_phi * c_theta - by_theta * s_theta],
        ]
    )


def fixed_rotation(angles: Vector) -> Vector:
    r"""Return the rotation between two frames of one body from three angles, as in Table 2.

    .. math:: R = R_x(q_1)\, R_y(q_2)\, R_z(q_3)

    Parameters
    ----------
    angles : array, shape (3,)
        Angles of the x-y-z sequence [rad]; numbers, not traced.

    Returns
    -------
    array, shape (3, 3)
        Rotation from child to parent. Elements within round-off of 0 or ±1 are rounded to these.

    Raises
    ------
    ModelError
        If `angles` is not an array of three finite numbers.

    References
    ----------
    Li, Wei, Chen (2026), section 4.1. The paper does not state whether the sequence is about
    moving or fixed axes. Moving axes are assumed, as in its 3-1-2 attitude matrix.
    """
    x, y, z = frozen_array("angles of a fixed rotation", angles, (3,))
    rotation = rotation_about_x(x) @ rotation_about_y(y) @ rotation_about_z(z)
    nearest = np.round(rotation)
    # Adding zero turns -0.0 into 0.0, which traced code omits.
    cleaned: Vector = (
        np.where(np.abs(rotation - nearest) < _ROUND_OFF, nearest, rotation) + 0.0
    )
    return cleaned


def cayley_rotation(vector: Array) -> Array:
    r"""Return the rotation of a small elastic rotation vector, by Cayley's formula.

    .. math::
        R(c) = \frac{(1 - \tfrac14 c^T c) I + \tfrac12 c c^T + c^\times}{1 + \tfrac14 c^T c}

    Parameters
    ----------
    vector : array, shape (3,)
        Elastic rotation :math:`c = R_i \tau` [rad].

    Returns
    -------
    array, shape (3, 3)
        Rotation from the deformed to the undeformed frame.

    Notes
    -----
    Any smooth :math:`R(c) = I + c^\times + O(c^2)` describes the small rotations of linear
    elasticity. Cayley's formula is a proper rotation for every `vector` and agrees with the
    matrix exponential up to terms of third order (:math:`|c|^3/12`). Since it is rational, it
    has no 0/0 at zero deformation, unlike Rodrigues' formula.
    """
    square = vector @ vector
    numerator = (1.0 - square / 4.0) * np.eye(3) + np.outer(vector, vector) / 2.0
    return (numerator + cross_matrix(vector)) / (1.0 + square / 4.0)


def cayley_rate_matrix(vector: Array) -> Array:
    r"""Return the matrix from :math:`\dot c` to the angular velocity of `cayley_rotation`.

    .. math:: \omega = B(c)\,\dot c, \qquad B(c) = \frac{I + \tfrac12 c^\times}{1 + \tfrac14 c^T c}

    Parameters
    ----------
    vector : array, shape (3,)
        Elastic rotation :math:`c` [rad].

    Returns
    -------
    array, shape (3, 3)
        :math:`B(c)` [1], for :math:`\omega` in the undeformed frame.

    Notes
    -----
    Cayley's formula is the rotation of the quaternion :math:`(1, c/2)/\sqrt{1 + c^T c/4}`. The
    angular velocity of a unit quaternion :math:`(a, b)` in the parent frame is
    :math:`2(a\dot b - \dot a b + b \times \dot b)`, in which the norm cancels.
    """
    return (np.eye(3) + cross_matrix(vector) / 2.0) / (1.0 + (vector @ vector) / 4.0)


def cayley_bias_acceleration(vector: Array, rate: Array) -> Array:
    r"""Return the angular acceleration of `cayley_rotation` at :math:`\ddot c = 0`.

    .. math:: \dot B(c)\,\dot c = -\frac{c^T \dot c}{2 (1 + \tfrac14 c^T c)}\; B(c)\,\dot c

    Parameters
    ----------
    vector : array, shape (3,)
        Elastic rotation :math:`c` [rad].
    rate : array, shape (3,)
        :math:`\dot c` [rad/s].

    Returns
    -------
    array, shape (3,)
        [rad/s²], in the undeformed frame.
    """
    factor = (vector @ rate) / (2.0 + (vector @ vector) / 2.0)
    return -factor * (cayley_rate_matrix(vector) @ rate)
