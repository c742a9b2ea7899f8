r"""Optimal attitude of the truss for a straight path: the largest acceleration after any single failure.

Without rotation, the feasible accelerations :math:`a` after each of some failures f,

.. math:: G\,(a, 0) = P\,Q_f, \qquad |Q_{f,k}| \le l_{f,k} \quad\text{for all } f,

are a convex polytope around zero. The optimal direction is that of its farthest vertex. An ascent from each
of a grid of directions d finds the vertex farthest along d, sets d to its direction, and repeats until the
distance does not increase. Each step is a linear programme and does not decrease the distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.control.trajectory import PEAK_ACCELERATION, Quintic
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import is_whole
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.feasibility.failures import ActuatorFailure, single_failures
from trussflow.models.feasibility.reach import (
    LEAST_COSINE,
    RELATIVE_TOLERANCE,
    bounds_of,
    columns,
    demands_of,
    solution,
)
from trussflow.models.validation import frozen_array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BestAttitude:
    """Optimal attitude for a path.

    Attributes
    ----------
    direction : Vector, shape (3,)
        Direction of the displacement, in truss axes [1].
    attitude : Vector, shape (3,)
        3-1-2 Euler angles of the smallest rotation to that direction [rad].
    acceleration : float
        Largest feasible acceleration along the path after each failure [m/s²].
    least_duration : float
        Least duration of the path in that attitude after each failure [s].
    """

    direction: Vector
    attitude: Vector
    acceleration: float
    least_duration: float


def best_attitude(
    dynamics: TrussDynamics,
    path: Quintic,
    limits: Vector,
    failures: Sequence[ActuatorFailure] | None = None,
    *,
    normal: npt.ArrayLike = (0.0, 0.0, 0.0),
    directions: int = 64,
) -> BestAttitude:
    """Return the attitude with the least duration of a path that is feasible after each failure.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots; modes are ignored.
    path : Quintic
        Path without rotation; its joint angles are used, its initial attitude is not.
    limits : Vector, shape (actuators,)
        Limit of each healthy actuator, such as `Hardware.limits` [N, N·m].
    failures : sequence of ActuatorFailure, optional
        Failures; by default none and each single failure.
    normal : array_like, shape (3,)
        Normal, in truss axes, of the considered directions [1]. With the x axis, rotations about body x
        suffice for a path along body y or z. By default all directions are considered.
    directions : int
        Number of initial directions of the ascent, distributed over half the sphere [-].

    Returns
    -------
    BestAttitude

    Raises
    ------
    ModelError
        If `survey` raises, the path rotates the truss or moves joints, or the attitude is singular.
    """
    failures = single_failures(dynamics) if failures is None else failures
    if not failures or not is_whole(directions) or directions < 1:
        raise ModelError(
            "`failures` must have at least one element, and `directions` must be at least 1"
        )
    demands = demands_of(dynamics, path, 2)
    displacement = path.parameters["displacement"][:3]
    way = float(np.linalg.norm(displacement))
    if np.any(path.parameters["displacement"][3:]) or not way:
        raise ModelError(
            "the path must move the truss, without rotation of truss or joints"
        )
    (demand,) = demands  # the demands of a straight path differ by a factor only
    matrices = [columns(demand, failure) for failure in failures]
    limit = [np.full(matrix.shape[1], np.inf) for matrix in matrices]
    for each, failure in zip(limit, failures, strict=True):
        each[: dynamics.actuators] = bounds_of(limits, failure)
    sizes = np.concatenate([*limit, np.full(3, np.inf)])
    normal = frozen_array("normal of the directions", normal, (3,))
    moved = np.vstack(
        [np.tile(-demand.terms.mass_matrix[:, :3], (len(failures), 1)), normal]
    )
    equations = np.hstack([scipy.linalg.block_diag(*matrices, np.zeros((1, 0))), moved])

    def farthest(direction: Vector) -> Vector:
        cost = np.concatenate([np.zeros(len(sizes) - 3), -direction])
        bounds = list(zip(-sizes, sizes, strict=True))
        result = solution(
            cost, A_eq=equations, b_eq=np.zeros(len(equations)), bounds=bounds
        )
        return np.zeros(3) if result.x is None else result.x[-3:]

    best = np.zeros(3)
    for direction in _half_sphere(directions):
        length, corner = 0.0, farthest(direction)
        # The norm is convex, so the corner farthest along the last one is never
        # shorter. The maximum is a local one, hence several start directions.
        while np.linalg.norm(corner) > (1.0 + RELATIVE_TOLERANCE) * length:
            length = float(np.linalg.norm(corner))
            corner = farthest(corner / length)
        best = max(best, corner, key=lambda each: float(np.linalg.norm(each)))
    acceleration = float(np.linalg.norm(best))
    if acceleration == 0.0:
        raise ModelError(
            "no direction is feasible after each of the failures; omit some failures"
        )
    # All limits hold in both directions, so the opposite acceleration is feasible too.
    best = best if best @ displacement > 0.0 else -best
    return BestAttitude(
        direction=best / acceleration,
        attitude=attitude_along(best, displacement),
        acceleration=acceleration,
        least_duration=float(np.sqrt(PEAK_ACCELERATION * way / acceleration)),
    )


def attitude_along(
    direction: npt.ArrayLike, displacement: npt.ArrayLike, *, spin: float = 0.0
) -> Vector:
    """Return the attitude in which a displacement is along a direction of the truss.

    Parameters
    ----------
    direction : array_like, shape (3,)
        Direction in truss axes, of any length except 0 [any].
    displacement : array_like, shape (3,)
        Displacement in inertial axes [m].
    spin : float
        Additional rotation about the displacement, after the smallest rotation from zero attitude [rad].

    Returns
    -------
    Vector, shape (3,)
        3-1-2 Euler angles for `SpaceTruss.turned` [rad].

    Raises
    ------
    ModelError
        If one of the vectors is zero, or the Euler angles are singular in that attitude.
    """
    from scipy.spatial.transform import Rotation

    own, way = (
        frozen_array(f"attitude: {name}", vector, (3,))
        for name, vector in (("direction", direction), ("displacement", displacement))
    )
    if not own.any() or not way.any():
        raise ModelError("attitude: direction and displacement must not be zero")
    smallest, _ = Rotation.align_vectors(way[None], own[None])
    rotation = Rotation.from_rotvec(spin * way / np.linalg.norm(way)) * smallest
    if np.hypot(*rotation.as_matrix()[2, ::2]) < LEAST_COSINE:
        raise ModelError(
            "the Euler angles of the attitude are singular (φ = ±90°); rotate it about the displacement "
            "by spin="
        )
    psi, phi, theta = rotation.as_euler("ZXY")
    return np.array([phi, theta, psi])


def _half_sphere(count: int) -> Vector:
    """Return directions distributed evenly over half the sphere, on a golden-angle spiral."""
    k = np.arange(count) + 0.5
    height, angle = k / count, np.pi * (3.0 - np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
