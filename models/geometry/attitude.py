r"""Attitude coordinates of the truss: Euler angles or a quaternion.

`EULER` are the 3-1-2 angles of the paper, singular at φ = ±90°. `QUATERNION` has four numbers and no
singularity. An instance gives size, units, rates and errors of the attitude.

Control laws use **task coordinates**, of which the attitude always has three: the Euler angles, or small
rotations about the axes of the truss, whose rates are the angular velocity.

References
----------
Wie, Weiss, Arapostathis (1989), *Quaternion feedback regulator for spacecraft eigenaxis rotations*, J.
Guidance 12(3); Wen, Kreutz-Delgado (1991), *The attitude control problem*, IEEE Trans. Aut. Control 36(10).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import (
    cross_matrix,
    euler_rate_matrix,
    euler_rate_matrix_derivative,
    euler_rate_matrix_inverse,
    euler_rotation,
)

UNIT_LENGTH_TOLERANCE = 1e-6
"""Tolerance of the length of a quaternion from a user [-]."""

NORM_FEEDBACK_GAIN = 1.0
"""Rate at which the length of an integrated quaternion returns to one [1/s]."""


@dataclass(frozen=True, slots=True)
class AttitudeCoordinates:
    r"""Attitude as 3-1-2 Euler angles φ, θ, ψ, as in the paper; singular where cos φ = 0.

    Derived classes describe an attitude by other numbers, a. They must override all attributes, and all methods
    down to `bias_acceleration`, which are those of Euler angles here.

    Attributes
    ----------
    name : str
        Name in files.
    rest : tuple of float
        Numbers of the identity rotation [see units].
    labels : tuple of str
        Names of the numbers.
    units : tuple of str
        Units of the numbers.
    task_labels : tuple of str
        Names of the three task coordinates [rad].
    per_radian : float
        Change of the numbers per angle of a small rotation [unit/rad].
    """

    name: ClassVar[str] = "euler"
    rest: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0)
    labels: ClassVar[tuple[str, ...]] = ("phi", "theta", "psi")
    units: ClassVar[tuple[str, ...]] = ("rad",) * 3
    task_labels: ClassVar[tuple[str, ...]] = labels
    per_radian: ClassVar[float] = 1.0

    @property
    def end(self) -> int:
        """Index behind the attitude in coordinates that begin with a position [-]."""
        return 3 + len(self.rest)

    def rotation(self, a: Array) -> Array:
        """Return the rotation from the truss frame to the inertial frame.

        Parameters
        ----------
        a : array
            Attitude [unit].
        """
        return euler_rotation(a)

    def rates(self, a: Array, turning: Array) -> Array:
        """Return da/dt.

        Parameters
        ----------
        a : array
            Attitude [unit].
        turning : array, shape (3,)
            Angular velocity in the truss frame [rad/s].
        """
        return euler_rate_matrix_inverse(a) @ turning

    def rate_matrix(self, a: Array) -> Array:
        """Return the matrix from rates of the task coordinates to angular velocity in the truss frame.

        For Euler angles it is A of Li, Wei, Chen (2026), below Eq. 44.

        Parameters
        ----------
        a : array
            Attitude [unit].
        """
        return euler_rate_matrix(a)

    def rate_matrix_inverse(self, a: Array) -> Array:
        """Return the inverse of `rate_matrix`.

        Parameters
        ----------
        a : array
            Attitude [unit].
        """
        return euler_rate_matrix_inverse(a)

    def bias_acceleration(self, a: Array, turning: Array) -> Array:
        r"""Return the second derivative of the task coordinates at constant angular velocity [rad/s²].

        For Euler angles it is :math:`-A^{-1} \dot A\, \dot\Theta`.

        Parameters
        ----------
        a : array
            Attitude [unit].
        turning : array, shape (3,)
            Angular velocity in the truss frame [rad/s].
        """
        # omega = A dTheta/dt gives A d2Theta/dt2 = -dA/dt dTheta/dt at constant omega.
        inverse = euler_rate_matrix_inverse(a)
        rates = inverse @ turning
        return -(inverse @ (euler_rate_matrix_derivative(a, rates) @ rates))

    def normalized(self, a: Array) -> Array:
        """Return a valid attitude from an integrated one.

        Parameters
        ----------
        a : array
            Attitude with errors of integration [unit].
        """
        return a

    def integrate(self, a: Array, turn: Array) -> Array:
        """Return the attitude after a rotation of any size.

        Parameters
        ----------
        a : array
            Attitude before the rotation [unit].
        turn : array, shape (3,)
            Changes of the Euler angles, or rotation axis in the truss frame times angle [rad].
        """
        return a + turn

    def motion(self, a: Array, da: Array, dda: Array) -> tuple[Array, Array, Array]:
        """Return the normalized attitude, and rate and acceleration of its task coordinates.

        Parameters
        ----------
        a, da, dda : array
            Attitude before normalization, first and second derivative [unit, unit/s, unit/s²].
        """
        return a, da, dda

    def difference(self, a: Array, goal: Array) -> Array:
        """Return the difference of goal and attitude in task coordinates [rad].

        Parameters
        ----------
        a : array
            Attitude [unit].
        goal : array
            Desired attitude [unit].
        """
        return goal - a

    def reference_rates(
        self, a: Array, turning: Array, goal: Array, rate: Array, acceleration: Array
    ) -> tuple[Array, Array]:
        """Return rate and acceleration of a goal in the task coordinates of the attitude.

        Parameters
        ----------
        a : array
            Attitude [unit].
        turning : array, shape (3,)
            Angular velocity in the truss frame [rad/s].
        goal : array
            Desired attitude [unit].
        rate, acceleration : array, shape (3,)
            Motion of the goal in its own task coordinates [rad/s, rad/s²].
        """
        return rate, acceleration

    def checked(self, a: Vector) -> Vector:
        """Return an attitude from a user [unit] if it is valid.

        Raises
        ------
        ModelError
            If the numbers are not a valid attitude.
        """
        return a


@dataclass(frozen=True, slots=True)
class Quaternion(AttitudeCoordinates):
    r"""Unit quaternions (w, x, y, z), scalar first, from the truss frame to the inertial frame.

    .. math:: \dot a = \tfrac12\, a \circ (0, \omega) + (1 - a^T a)\, a

    The second term corrects the length, which drifts by errors of the solver; it does not rotate. The
    quaternions a and -a describe the same attitude. Errors use the nearer of the two, so that control laws
    rotate by the smaller angle.
    """

    name = "quaternion"
    rest = (1.0, 0.0, 0.0, 0.0)
    labels = ("q_w", "q_x", "q_y", "q_z")
    units = ("1",) * 4
    task_labels = ("about_x", "about_y", "about_z")
    per_radian = 0.5

    def rotation(self, a: Array) -> Array:
        """Return the rotation to the inertial frame, for any length of the quaternion."""
        cross = cross_matrix(a[1:])
        return np.eye(3) + (a[0] * cross + cross @ cross) * (2.0 / (a @ a))

    def rates(self, a: Array, turning: Array) -> Array:
        """Return da/dt."""
        return (
            0.5 * product(a, with_scalar(0.0, turning))
            # Parallel to a, so this term changes the length only, not the rotation.
            + NORM_FEEDBACK_GAIN * (1.0 - a @ a) * a
        )

    def rate_matrix(self, a: Array) -> Array:
        """Return the identity: task rates are the angular velocity."""
        return np.eye(3)

    def rate_matrix_inverse(self, a: Array) -> Array:
        """Return the identity."""
        return np.eye(3)

    def bias_acceleration(self, a: Array, turning: Array) -> Array:
        """Return zeros."""
        return np.zeros(3)

    def normalized(self, a: Array) -> Array:
        """Return the quaternion divided by its length."""
        return a / np.sqrt(a @ a)

    def integrate(self, a: Array, turn: Array) -> Array:
        """Return the attitude rotated about the axis by the angle."""
        square = turn @ turn
        # The square root has no derivative at zero.
        angle = np.sqrt(np.where(square > 0.0, square, 1.0))
        scalar = np.where(square > 0.0, np.cos(angle / 2.0), 1.0)
        share = np.where(square > 0.0, np.sin(angle / 2.0) / angle, 0.5)
        return product(a, with_scalar(scalar, share * turn))

    def motion(self, a: Array, da: Array, dda: Array) -> tuple[Array, Array, Array]:
        r"""Return quaternion, angular velocity and angular acceleration, for any length.

        .. math:: \omega = \frac{2\,\mathrm{vec}(\bar a \circ \dot a)}{a^T a}, \qquad
                  \dot\omega = \frac{2\,\mathrm{vec}(\bar a \circ \ddot a) - 2\,(a^T \dot a)\,\omega}{a^T a}
        """
        square = a @ a
        rate = 2.0 * _way(a, da)[1:] / square
        return (
            self.normalized(a),
            rate,
            2.0 * (_way(a, dda)[1:] - (a @ da) * rate) / square,
        )

    def difference(self, a: Array, goal: Array) -> Array:
        r"""Return twice the vector part of the quaternion to the goal, with the smaller angle.

        .. math:: e = 2\,\mathrm{sgn}(\epsilon_w)\,(\epsilon_x, \epsilon_y, \epsilon_z), \qquad
                  \epsilon = \bar a \circ a_d

        The result has the direction of the axis and the length 2 sin(angle / 2).
        """
        way = _way(a, goal)
        # a and -a are one attitude. `sign` is 0 for half a turn and would stop the
        # rotation.
        return 2.0 * np.where(way[0] < 0.0, -1.0, 1.0) * way[1:]

    def reference_rates(
        self, a: Array, turning: Array, goal: Array, rate: Array, acceleration: Array
    ) -> tuple[Array, Array]:
        """Return rate and acceleration in truss axes, with the term of the rotating axes."""
        rotation = self.rotation(_way(a, goal))
        seen = rotation @ rate
        return seen, rotation @ acceleration - np.cross(turning, seen)

    def checked(self, a: Vector) -> Vector:
        """Return the quaternion if its length is one."""
        length = float(np.linalg.norm(a))
        if not abs(length - 1.0) <= UNIT_LENGTH_TOLERANCE:
            raise ModelError(
                f"the quaternion {a.tolist()} has a length of {length:g}; it must be 1, with components "
                "(w, x, y, z), scalar first; divide it by its length"
            )
        return a


def product(left: Array, right: Array) -> Array:
    r"""Return the product of two quaternions: the right rotation followed by the left one.

    Parameters
    ----------
    left, right : array, shape (4,)
        (w, x, y, z) [1].
    """
    vector = left[0] * right[1:] + right[0] * left[1:] + np.cross(left[1:], right[1:])
    return with_scalar(left[0] * right[0] - left[1:] @ right[1:], vector)


def _way(a: Array, goal: Array) -> Array:
    """Return the quaternion of the rotation from one attitude to another."""
    return product(with_scalar(a[0], -a[1:]), goal)


def with_scalar(scalar: Array | float, vector: Array) -> Array:
    """Return a quaternion from scalar and vector part.

    Parameters
    ----------
    scalar : float
        w [1].
    vector : array, shape (3,)
        (x, y, z) [1].
    """
    return np.concatenate([np.stack([scalar]), vector])


EULER, QUATERNION = AttitudeCoordinates(), Quaternion()
ATTITUDES: dict[str, AttitudeCoordinates] = {
    kind.name: kind for kind in (EULER, QUATERNION)
}
"""Kinds of attitude coordinates, keyed by their names in files."""
