r"""Task space: the rigid motion as a controller states it, whatever the attitude's coordinates.

Positions :math:`x_1` are the rigid coordinates themselves; rates, accelerations, forces and errors have six
numbers for the truss, along inertial axes and of the attitude's task coordinates, and one for each joint.
Rates are :math:`J_g x_2`, for Euler angles :math:`\dot x_1` (Li, Wei, Chen 2026, Eq. 44); :math:`J_g` is made
of the rotation and of the inverse of `AttitudeCoordinates.rate_matrix`.
"""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.types import Array
from trussflow.models.geometry.attitude import AttitudeCoordinates


def task_velocity(kind: AttitudeCoordinates, position: Array, speeds: Array) -> Array:
    r"""Return :math:`J_g x_2`.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Coordinates, of which those of the truss count [m, unit of the attitude].
    speeds : array, shape (m,)
        :math:`x_2`, truss velocities in truss axes [m/s, rad/s].
    """
    attitude = position[3 : kind.end]
    linear = kind.rotation(attitude) @ speeds[:3]
    angular = kind.rate_matrix_inverse(attitude) @ speeds[3:6]
    return np.concatenate([linear, angular, speeds[6:]])


def to_body(kind: AttitudeCoordinates, position: Array, task: Array) -> Array:
    r"""Return :math:`J_g^{-1} y`, task-space rates in the axes of the generalized speeds.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Coordinates, of which those of the truss count [m, unit of the attitude].
    task : array, shape (m,)
        Components along inertial axes, of the attitude, and of joints; of a rate or, without
        the drift, of an acceleration.
    """
    attitude = position[3 : kind.end]
    linear = kind.rotation(attitude).T @ task[:3]
    angular = kind.rate_matrix(attitude) @ task[3:6]
    return np.concatenate([linear, angular, task[6:]])


def task_drift(kind: AttitudeCoordinates, position: Array, speeds: Array) -> Array:
    r"""Return :math:`\dot J_g x_2`, the task acceleration at constant generalized speeds.

    .. math:: \frac{d}{dt}(R_t) v_t = R_t (\omega_t \times v_t), \qquad
              \frac{d}{dt}(A^{-1})\,\omega_t = -A^{-1} \dot A\, \dot\Theta_t

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Coordinates, of which those of the truss count [m, unit of the attitude].
    speeds : array, shape (m,)
        :math:`x_2`, truss velocities in truss axes [m/s, rad/s].
    """
    attitude = position[3 : kind.end]
    linear = kind.rotation(attitude) @ np.cross(speeds[3:6], speeds[:3])
    return np.concatenate([linear, kind.drift(attitude, speeds[3:6]), np.zeros(speeds.shape[0] - 6)])


def task_force_to_body(kind: AttitudeCoordinates, position: Array, force: Array) -> Array:
    r"""Return :math:`J_g^T f`, the generalized force that does the same work as a task force.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Coordinates, of which those of the truss count [m, unit of the attitude].
    force : array, shape (m,)
        Inertial force [N], moments conjugate to the attitude [N·m], joint torques [N·m].
    """
    attitude = position[3 : kind.end]
    linear = kind.rotation(attitude).T @ force[:3]
    angular = kind.rate_matrix_inverse(attitude).T @ force[3:6]
    return np.concatenate([linear, angular, force[6:]])


def moved(kind: AttitudeCoordinates, position: Array, way: Array) -> Array:
    """Return the position after a way of any size in task coordinates.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Rigid coordinates [m, unit of the attitude, rad].
    way : array, shape (m,)
        Displacement, turn as `AttitudeCoordinates.turned` takes it, and changes of joints [m, rad].
    """
    k = kind.end
    attitude = kind.turned(position[3:k], way[3:6])
    return np.concatenate([position[:3] + way[:3], attitude, position[k:] + way[6:]])


def normalized(kind: AttitudeCoordinates, position: Array) -> Array:
    """Return a position of which the attitude was summed up from small changes.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Rigid coordinates, nearly [m, unit of the attitude, rad].
    """
    k = kind.end
    return np.concatenate([position[:3], kind.normalized(position[3:k]), position[k:]])


def way_to(kind: AttitudeCoordinates, position: Array, goal: Array) -> Array:
    """Return in task coordinates where a goal is, seen from a position: their difference.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position, goal : array
        Rigid coordinates [m, unit of the attitude, rad].
    """
    k = kind.end
    turn = kind.difference(position[3:k], goal[3:k])
    return np.concatenate([goal[:3] - position[:3], turn, goal[k:] - position[k:]])


def seen_from(
    kind: AttitudeCoordinates, position: Array, speeds: Array, goal: Array, rate: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Return in task coordinates how fast and how steeply a goal moves, seen from a position.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position : array
        Rigid coordinates [m, unit of the attitude, rad].
    speeds : array, shape (m,)
        :math:`x_2`, of which the angular velocity counts [m/s, rad/s].
    goal : array
        Rigid coordinates wanted [m, unit of the attitude, rad].
    rate, acceleration : array, shape (m,)
        Of the goal, in its task coordinates [m/s, rad/s; m/s², rad/s²].
    """
    k = kind.end
    both = kind.carried(position[3:k], speeds[3:6], goal[3:k], rate[3:6], acceleration[3:6])
    turning, bend = (
        np.concatenate([moving[:3], turn, moving[6:]])
        for moving, turn in zip((rate, acceleration), both, strict=True)
    )
    return turning, bend


def task_motion(
    kind: AttitudeCoordinates, position: Array, rate: Array, change: Array
) -> tuple[Array, Array, Array]:
    """Return position, and its rate and acceleration in task coordinates, from coordinates that move.

    Parameters
    ----------
    kind : AttitudeCoordinates
        Of the attitude.
    position, rate, change : array
        Rigid coordinates, nearly, and their derivatives [m, unit of the attitude, rad; 1/s, 1/s² of these].
    """
    k, numbers = kind.end, (position, rate, change)
    turning = kind.motion(position[3:k], rate[3:k], change[3:k])
    where, velocity, acceleration = (
        np.concatenate([each[:3], turn, each[k:]]) for each, turn in zip(numbers, turning, strict=True)
    )
    return where, velocity, acceleration
