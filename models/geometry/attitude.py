r"""Attitude coordinates: the numbers that say how the truss is turned.

Two kinds, `EULER`, the source's 3-1-2 angles, which are singular at φ = ±90°, and `QUATERNION`, four numbers
without a singularity. Whoever needs to know an attitude's size, units, rates or errors asks one of these.

Laws work in **task coordinates**, of which the attitude has three whatever its kind: Euler angles
themselves, or small turns about the axes of the truss, whose rates are its angular velocity.

References
----------
Wie, Weiss, Arapostathis (1989), *Quaternion feedback regulator for spacecraft eigenaxis rotations*, J.
Guidance 12(3); Wen, Kreutz-Delgado (1991), *The attitude control problem*, IEEE Trans. Aut. Control 36(10).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trussflow.blocks.framework.types import Array, Vector
from trussflow.models.errors import ModelError
from trussflow.models.geometry.rotation import (
    cross_matrix,
    euler_rate_matrix,
    euler_rate_matrix_derivative,
    euler_rate_matrix_inverse,
    euler_rotation,
)

UNIT_LENGTH = 1e-6
"""How far from one the length of a quaternion may be that a user gives [-]."""

RESTORED = 1.0
"""How fast the length of an integrated quaternion goes back to one [1/s]."""


class AttitudeCoordinates(ABC):
    """One way to describe an attitude by numbers, a.

    Attributes
    ----------
    name : str
        What it is called in files.
    rest : tuple of float
        The numbers of no rotation; they tell how many there are [see units].
    labels : tuple of str
        Of the numbers.
    units : tuple of str
        Of the numbers.
    task_labels : tuple of str
        Of the attitude in task coordinates [rad].
    per_radian : float
        How much the numbers change when the truss turns by a small angle, by that [unit/rad].
    """

    name: ClassVar[str]
    rest: ClassVar[tuple[float, ...]]
    labels: ClassVar[tuple[str, ...]]
    units: ClassVar[tuple[str, ...]]
    task_labels: ClassVar[tuple[str, ...]]
    per_radian: ClassVar[float]

    @property
    def end(self) -> int:
        """Where the attitude ends in coordinates that begin with a position [-]."""
        return 3 + len(self.rest)

    @abstractmethod
    def rotation(self, a: Array) -> Array:
        """Return the rotation from the truss frame to the inertial frame.

        Parameters
        ----------
        a : array
            The attitude [unit].
        """

    @abstractmethod
    def rates(self, a: Array, turning: Array) -> Array:
        """Return da/dt.

        Parameters
        ----------
        a : array
            The attitude [unit].
        turning : array, shape (3,)
            Angular velocity in the truss frame [rad/s].
        """

    @abstractmethod
    def rate_matrix(self, a: Array) -> Array:
        """Return the matrix from rates of the task coordinates to angular velocity in the truss frame.

        Parameters
        ----------
        a : array
            The attitude [unit].
        """

    @abstractmethod
    def rate_matrix_inverse(self, a: Array) -> Array:
        """Return the inverse of `rate_matrix`.

        Parameters
        ----------
        a : array
            The attitude [unit].
        """

    @abstractmethod
    def drift(self, a: Array, turning: Array) -> Array:
        """Return the second derivative of the task coordinates at constant angular velocity [rad/s²].

        Parameters
        ----------
        a : array
            The attitude [unit].
        turning : array, shape (3,)
            Angular velocity in the truss frame [rad/s].
        """

    @abstractmethod
    def normalized(self, a: Array) -> Array:
        """Return the numbers of an attitude, of `a` that were summed up from small changes.

        Parameters
        ----------
        a : array
            Nearly an attitude [unit].
        """

    @abstractmethod
    def turned(self, a: Array, turn: Array) -> Array:
        """Return the attitude after a turn of any size.

        Parameters
        ----------
        a : array
            The attitude before [unit].
        turn : array, shape (3,)
            In task coordinates: changes of Euler angles, or axis in the truss frame times angle [rad].
        """

    @abstractmethod
    def motion(self, a: Array, da: Array, dda: Array) -> tuple[Array, Array, Array]:
        """Return an attitude, and rate and acceleration of its task coordinates, from numbers that move.

        Parameters
        ----------
        a, da, dda : array
            Numbers of which `normalized` is the attitude, and their derivatives [unit, unit/s, unit/s²].
        """

    @abstractmethod
    def difference(self, a: Array, goal: Array) -> Array:
        """Return in task coordinates where a goal is, seen from the attitude [rad].

        Parameters
        ----------
        a : array
            The attitude [unit].
        goal : array
            The attitude wanted [unit].
        """

    @abstractmethod
    def carried(
        self, a: Array, turning: Array, goal: Array, rate: Array, acceleration: Array
    ) -> tuple[Array, Array]:
        """Return in task coordinates how fast and how steeply a goal moves, seen from the attitude.

        Parameters
        ----------
        a : array
            The attitude [unit].
        turning : array, shape (3,)
            Its angular velocity in the truss frame [rad/s].
        goal : array
            The attitude wanted [unit].
        rate, acceleration : array, shape (3,)
            Of the goal in its task coordinates [rad/s, rad/s²].
        """

    @abstractmethod
    def checked(self, a: Vector) -> Vector:
        """Return an attitude that a user gave [unit], or raise if it is none.

        Raises
        ------
        ModelError
            If the numbers are no attitude.
        """


@dataclass(frozen=True, slots=True)
class EulerAngles(AttitudeCoordinates):
    """The source's 3-1-2 Euler angles φ, θ, ψ; singular where cos φ = 0."""

    name = "euler"
    rest = (0.0, 0.0, 0.0)
    labels = task_labels = ("phi", "theta", "psi")
    units = ("rad",) * 3
    per_radian = 1.0

    def rotation(self, a: Array) -> Array:
        """Return the rotation to the inertial frame."""
        return euler_rotation(a)

    def rates(self, a: Array, turning: Array) -> Array:
        """Return da/dt."""
        return euler_rate_matrix_inverse(a) @ turning

    def rate_matrix(self, a: Array) -> Array:
        """Return A of Li, Wei, Chen (2026), below Eq. 44."""
        return euler_rate_matrix(a)

    def rate_matrix_inverse(self, a: Array) -> Array:
        """Return its inverse."""
        return euler_rate_matrix_inverse(a)

    def drift(self, a: Array, turning: Array) -> Array:
        r"""Return :math:`-A^{-1} \\dot A\\, \\dot\\Theta`."""
        inverse = euler_rate_matrix_inverse(a)
        rates = inverse @ turning
        return -(inverse @ (euler_rate_matrix_derivative(a, rates) @ rates))

    def normalized(self, a: Array) -> Array:
        """Return the angles: any three are an attitude."""
        return a

    def turned(self, a: Array, turn: Array) -> Array:
        """Return the angles changed."""
        return a + turn

    def motion(self, a: Array, da: Array, dda: Array) -> tuple[Array, Array, Array]:
        """Return all as they are."""
        return a, da, dda

    def difference(self, a: Array, goal: Array) -> Array:
        """Return the goal less the angles."""
        return goal - a

    def carried(
        self, a: Array, turning: Array, goal: Array, rate: Array, acceleration: Array
    ) -> tuple[Array, Array]:
        """Return both as they are."""
        return rate, acceleration

    def checked(self, a: Vector) -> Vector:
        """Return the angles."""
        return a


@dataclass(frozen=True, slots=True)
class Quaternion(AttitudeCoordinates):
    r"""Unit quaternions (w, x, y, z), scalar first, from the truss frame to the inertial frame.

    .. math:: \dot a = \tfrac12\, a \circ (0, \omega) + (1 - a^T a)\, a

    The second term brings back the length that the errors of a solver change; it turns nothing. The same
    attitude has two quaternions, a and -a; errors take the nearer one, so that no law goes the long way.
    """

    name = "quaternion"
    rest = (1.0, 0.0, 0.0, 0.0)
    labels = ("w", "x", "y", "z")
    units = ("1",) * 4
    task_labels = ("about_x", "about_y", "about_z")
    per_radian = 0.5

    def rotation(self, a: Array) -> Array:
        """Return the rotation to the inertial frame, whatever the length."""
        cross = cross_matrix(a[1:])
        return np.eye(3) + (a[0] * cross + cross @ cross) * (2.0 / (a @ a))

    def rates(self, a: Array, turning: Array) -> Array:
        """Return da/dt."""
        return 0.5 * product(a, with_scalar(0.0, turning)) + RESTORED * (1.0 - a @ a) * a

    def rate_matrix(self, a: Array) -> Array:
        """Return one: the task's rates are the angular velocity."""
        return np.eye(3)

    def rate_matrix_inverse(self, a: Array) -> Array:
        """Return one."""
        return np.eye(3)

    def drift(self, a: Array, turning: Array) -> Array:
        """Return nothing."""
        return np.zeros(3)

    def normalized(self, a: Array) -> Array:
        """Return the quaternion with a length of one."""
        return a / np.sqrt(a @ a)

    def turned(self, a: Array, turn: Array) -> Array:
        """Return the attitude turned about the axis by the angle."""
        square = turn @ turn
        # The root has no derivative at exactly zero.
        angle = np.sqrt(np.where(square > 0.0, square, 1.0))
        scalar = np.where(square > 0.0, np.cos(angle / 2.0), 1.0)
        share = np.where(square > 0.0, np.sin(angle / 2.0) / angle, 0.5)
        return product(a, with_scalar(scalar, share * turn))

    def motion(self, a: Array, da: Array, dda: Array) -> tuple[Array, Array, Array]:
        r"""Return quaternion, angular velocity and acceleration, whatever the length.

        .. math:: \omega = \frac{2\,\mathrm{vec}(\bar a \circ \dot a)}{a^T a}, \qquad
                  \dot\omega = \frac{2\,\mathrm{vec}(\bar a \circ \ddot a) - 2\,(a^T \dot a)\,\omega}{a^T a}
        """
        square = a @ a
        rate = 2.0 * _way(a, da)[1:] / square
        return self.normalized(a), rate, 2.0 * (_way(a, dda)[1:] - (a @ da) * rate) / square

    def difference(self, a: Array, goal: Array) -> Array:
        r"""Return twice the vector of the quaternion to the goal, the shorter way.

        .. math:: e = 2\,\mathrm{sgn}(\epsilon_w)\,(\epsilon_x, \epsilon_y, \epsilon_z), \qquad
                  \epsilon = \bar a \circ a_d

        It is along the axis, as long as twice the sine of half the angle.
        """
        way = _way(a, goal)
        return 2.0 * np.where(way[0] < 0.0, -1.0, 1.0) * way[1:]

    def carried(
        self, a: Array, turning: Array, goal: Array, rate: Array, acceleration: Array
    ) -> tuple[Array, Array]:
        """Return both in axes of the truss, which turn."""
        rotation = self.rotation(_way(a, goal))
        seen = rotation @ rate
        return seen, rotation @ acceleration - np.cross(turning, seen)

    def checked(self, a: Vector) -> Vector:
        """Return the quaternion, or raise if its length is not one."""
        length = float(np.linalg.norm(a))
        if not abs(length - 1.0) <= UNIT_LENGTH:
            raise ModelError(
                f"the quaternion {a.tolist()} has a length of {length:g}; an attitude is one of length 1, "
                "(w, x, y, z) with the scalar first; divide it by its length"
            )
        return a


def product(left: Array, right: Array) -> Array:
    r"""Return the product of two quaternions: first the turn on the right, then that on the left.

    Parameters
    ----------
    left, right : array, shape (4,)
        (w, x, y, z) [1].
    """
    vector = left[0] * right[1:] + right[0] * left[1:] + np.cross(left[1:], right[1:])
    return with_scalar(left[0] * right[0] - left[1:] @ right[1:], vector)


def _way(a: Array, goal: Array) -> Array:
    """Return the turn from one attitude to another, in axes of both."""
    return product(with_scalar(a[0], -a[1:]), goal)


def with_scalar(scalar: Array | float, vector: Array) -> Array:
    """Return a quaternion from its parts.

    Parameters
    ----------
    scalar : float
        w [1].
    vector : array, shape (3,)
        (x, y, z) [1].
    """
    return np.concatenate([np.stack([scalar]), vector])


EULER, QUATERNION = EulerAngles(), Quaternion()
ATTITUDES: dict[str, AttitudeCoordinates] = {kind.name: kind for kind in (EULER, QUATERNION)}
"""By the names that they have in files."""
