r"""Task space: rigid motion for controllers, with any attitude coordinates.

Positions :math:`x_1` are the rigid coordinates. Rates, accelerations, forces and errors have three components
in inertial axes, three of the attitude's task coordinates, and one per joint. Rates are :math:`J_g x_2`, for
Euler angles :math:`\dot x_1` (Li, Wei, Chen 2026, Eqs. 44 and 45). :math:`J_g` consists of the rotation and
the inverse of `AttitudeCoordinates.rate_matrix`.
"""

from __future__ import annotations

import numpy as np

from trussflow.blocks.support.types import Array
from trussflow.models.geometry.attitude import AttitudeCoordinates


def task_velocity(kind: AttitudeCoordinates, position: Array, speeds: Array) -> Array:
    r"""Return the task velocity :math:`J_g x_2`.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Coordinates; only those of the truss are used [m, unit of the attitude].
    speeds : array, shape (m,)
        :math:`x_2`, with truss velocities in truss axes [m/s, rad/s].
    """
    attitude = position[3 : kind.end]
    return _mapped(kind.rotation(attitude), kind.rate_matrix_inverse(attitude), speeds)


def to_body(kind: AttitudeCoordinates, position: Array, task: Array) -> Array:
    r"""Return :math:`J_g^{-1} y`, task rates in the axes of the generalized speeds.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Coordinates; only those of the truss are used [m, unit of the attitude].
    task : array, shape (m,)
        Task rate, or task acceleration without the drift [m/s, rad/s; m/s², rad/s²].
    """
    attitude = position[3 : kind.end]
    return _mapped(kind.rotation(attitude).T, kind.rate_matrix(attitude), task)


def task_drift(kind: AttitudeCoordinates, position: Array, speeds: Array) -> Array:
    r"""Return :math:`\dot J_g x_2`, the task acceleration at constant generalized speeds.

    .. math:: \frac{d}{dt}(R_t) v_t = R_t (\omega_t \times v_t), \qquad
              \frac{d}{dt}(A^{-1})\,\omega_t = -A^{-1} \dot A\, \dot\Theta_t

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Coordinates; only those of the truss are used [m, unit of the attitude].
    speeds : array, shape (m,)
        :math:`x_2`, with truss velocities in truss axes [m/s, rad/s].
    """
    attitude = position[3 : kind.end]
    # v is in truss axes: d(R v)/dt = R (dv/dt + omega x v), here with dv/dt = 0.
    linear = kind.rotation(attitude) @ np.cross(speeds[3:6], speeds[:3])
    angular = kind.bias_acceleration(attitude, speeds[3:6])
    return np.concatenate([linear, angular, np.zeros(speeds.shape[0] - 6)])


def task_force_to_body(
    kind: AttitudeCoordinates, position: Array, force: Array
) -> Array:
    r"""Return :math:`J_g^T f`, the generalized force with the same power as a task force.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Coordinates; only those of the truss are used [m, unit of the attitude].
    force : array, shape (m,)
        Force in inertial axes [N], moments conjugate to the attitude [N·m], joint torques [N·m].
    """
    attitude = position[3 : kind.end]
    return _mapped(
        # Equal power, f^T (J_g x_2) = (J_g^T f)^T x_2, requires the transposed
        # matrices.
        kind.rotation(attitude).T,
        kind.rate_matrix_inverse(attitude).T,
        force,
    )


def _mapped(linear: Array, angular: Array, vector: Array) -> Array:
    """Return a vector with its linear and angular part multiplied by one matrix each."""
    return np.concatenate([linear @ vector[:3], angular @ vector[3:6], vector[6:]])


def moved(kind: AttitudeCoordinates, position: Array, way: Array) -> Array:
    """Return the position after a displacement of any size in task coordinates.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Rigid coordinates [m, unit of the attitude, rad].
    way : array, shape (m,)
        Displacement, turn (see `AttitudeCoordinates.integrate`), and changes of joint angles [m, rad].
    """
    k = kind.end
    attitude = kind.integrate(position[3:k], way[3:6])
    return np.concatenate([position[:3] + way[:3], attitude, position[k:] + way[6:]])


def normalized(kind: AttitudeCoordinates, position: Array) -> Array:
    """Return a position with its attitude normalized, after integration.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Rigid coordinates before normalization [m, unit of the attitude, rad].
    """
    k = kind.end
    return np.concatenate([position[:3], kind.normalized(position[3:k]), position[k:]])


def way_to(kind: AttitudeCoordinates, position: Array, goal: Array) -> Array:
    """Return the difference of a goal and a position, in task coordinates.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position, goal : array
        Rigid coordinates [m, unit of the attitude, rad].
    """
    k = kind.end
    turn = kind.difference(position[3:k], goal[3:k])
    return np.concatenate([goal[:3] - position[:3], turn, goal[k:] - position[k:]])


def seen_from(
    kind: AttitudeCoordinates,
    position: Array,
    speeds: Array,
    goal: Array,
    rate: Array,
    acceleration: Array,
) -> tuple[Array, Array]:
    """Return rate and acceleration of a goal in the task coordinates of a position.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position : array
        Rigid coordinates [m, unit of the attitude, rad].
    speeds : array, shape (m,)
        :math:`x_2`; only the angular velocity is used [m/s, rad/s].
    goal : array
        Desired rigid coordinates [m, unit of the attitude, rad].
    rate, acceleration : array, shape (m,)
        Motion of the goal in its own task coordinates [m/s, rad/s; m/s², rad/s²].
    """
    k = kind.end
    both = kind.reference_rates(
        position[3:k], speeds[3:6], goal[3:k], rate[3:6], acceleration[3:6]
    )
    turning, bend = (
        np.concatenate([moving[:3], turn, moving[6:]])
        for moving, turn in zip((rate, acceleration), both, strict=True)
    )
    return turning, bend


def task_motion(
    kind: AttitudeCoordinates, position: Array, rate: Array, change: Array
) -> tuple[Array, Array, Array]:
    """Return position, task rate and task acceleration from coordinates and their derivatives.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Attitude coordinates of the truss.
    position, rate, change : array
        Rigid coordinates before normalization, first and second derivative [m, unit of the attitude, rad; per
        s, per s²].
    """
    k, numbers = kind.end, (position, rate, change)
    turning = kind.motion(position[3:k], rate[3:k], change[3:k])
    where, velocity, acceleration = (
        np.concatenate([each[:3], turn, each[k:]])
        for each, turn in zip(numbers, turning, strict=True)
    )
    return where, velocity, acceleration
