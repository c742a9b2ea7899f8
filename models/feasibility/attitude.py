r"""The attitude in which a truss is flown best: which way to accelerate, seen from it, if anything may fail.

Without turning, the accelerations :math:`a` within reach after every one of some failures f,

.. math:: G\,(a, 0) = P\,Q_f, \qquad |Q_{f,k}| \le l_{f,k} \quad\text{for all } f,

are a convex polytope around zero, and the best direction is that of its farthest corner. From each of a grid
of directions d a climb finds a corner: the one farthest along d, then, with d towards that, again, until none
is farther. Each step is a linear programme, and leads at least as far as the one before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy

from trussflow.blocks.control.trajectory import PEAK_ACCELERATION, Quintic
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.framework.validation import is_whole
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.feasibility.failures import ActuatorLimits, Failure, single_failures
from trussflow.models.feasibility.reach import (
    EXACT,
    INFEASIBLE,
    LEAST_COSINE,
    SOLVED,
    bounds_of,
    columns,
    demands_of,
)
from trussflow.models.validation import frozen_array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightAttitude:
    """An attitude to fly a path in.

    Attributes
    ----------
    direction : Vector, shape (3,)
        Of the displacement, in truss axes [1].
    attitude : Vector, shape (3,)
        3-1-2 Euler angles in which that is the direction of the path, by the smallest turn [rad].
    acceleration : float
        The largest along it that is within reach after every failure [m/s²].
    least_duration : float
        Of the path, in that attitude, after every failure [s].
    """

    direction: Vector
    attitude: Vector
    acceleration: float
    least_duration: float


def best_attitude(
    dynamics: TrussDynamics,
    path: Quintic,
    limits: ActuatorLimits,
    failures: Sequence[Failure] | None = None,
    *,
    normal: npt.ArrayLike = (0.0, 0.0, 0.0),
    directions: int = 64,
) -> FlightAttitude:
    """Return the attitude in which a path is flown fastest if each of some failures must be survived.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots; modes do not matter.
    path : Quintic
        Without turning; its joints count, and its attitude at the start does not.
    limits : ActuatorLimits
        Of what works.
    failures : sequence of Failure, optional
        By default none, and then each single failure.
    normal : array_like, shape (3,)
        Only directions perpendicular to it, in truss axes, are looked at: with that of x, turns about body x
        suffice for a path along body y or z [1]. By default all directions.
    directions : int
        From how many, spread over half the sphere, to climb [-].

    Returns
    -------
    FlightAttitude

    Raises
    ------
    ModelError
        As `survey`, and if the path turns the truss or moves joints, or the attitude is a singular one.
    """
    from scipy.optimize import linprog

    failures = single_failures(dynamics) if failures is None else failures
    if not failures or not is_whole(directions) or directions < 1:
        raise ModelError("an attitude is sought for one failure or more, and from one direction or more")
    demands = demands_of(dynamics, path, 2)
    displacement = path.parameters["displacement"][:3]
    way = float(np.linalg.norm(displacement))
    if np.any(path.parameters["displacement"][3:]) or not way:
        raise ModelError("the path must move the truss, without turning it or its joints")
    (demand,) = demands  # all of a straight path are alike
    matrices = [columns(demand, failure) for failure in failures]
    limit = [np.full(matrix.shape[1], np.inf) for matrix in matrices]
    for each, failure in zip(limit, failures, strict=True):
        each[: dynamics.actuators] = bounds_of(limits.of(dynamics), failure)
    sizes = np.concatenate([*limit, np.full(3, np.inf)])
    normal = frozen_array("normal of the directions", normal, (3,))
    moved = np.vstack([np.tile(-demand.terms.mass_matrix[:, :3], (len(failures), 1)), normal])
    equations = np.hstack([scipy.linalg.block_diag(*matrices, np.zeros((1, 0))), moved])

    def farthest(direction: Vector) -> Vector:
        cost = np.concatenate([np.zeros(len(sizes) - 3), -direction])
        bounds = list(zip(-sizes, sizes, strict=True))
        result = linprog(cost, A_eq=equations, b_eq=np.zeros(len(equations)), bounds=bounds)
        if result.status not in (SOLVED, INFEASIBLE):
            raise ModelError(f"a linear programme could not be solved: {result.message}")
        return np.zeros(3) if result.x is None else result.x[-3:]

    best = np.zeros(3)
    for direction in _half_sphere(directions):
        length, corner = 0.0, farthest(direction)
        while np.linalg.norm(corner) > (1.0 + EXACT) * length:
            length = float(np.linalg.norm(corner))
            corner = farthest(corner / length)
        best = max(best, corner, key=lambda each: float(np.linalg.norm(each)))
    acceleration = float(np.linalg.norm(best))
    if acceleration == 0.0:
        raise ModelError("there is no direction in which each of the failures is survived; leave some out")
    best = best if best @ displacement > 0.0 else -best
    return FlightAttitude(
        direction=best / acceleration,
        attitude=attitude_along(best, displacement),
        acceleration=acceleration,
        least_duration=float(np.sqrt(PEAK_ACCELERATION * way / acceleration)),
    )


def attitude_along(direction: npt.ArrayLike, displacement: npt.ArrayLike, *, spin: float = 0.0) -> Vector:
    """Return the attitude in which a displacement points along a direction of the truss.

    Parameters
    ----------
    direction : array_like, shape (3,)
        In truss axes; any length but 0 [any].
    displacement : array_like, shape (3,)
        In inertial axes [m].
    spin : float
        The attitude is turned by as much about the displacement, beyond the smallest turn from zero that
        will do [rad].

    Returns
    -------
    Vector, shape (3,)
        3-1-2 Euler angles [rad], as `SpaceTruss.turned` takes them.

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
            "in the attitude asked for the Euler angles are singular, φ being ±90°; turn it about the "
            "displacement by spin="
        )
    psi, phi, theta = rotation.as_euler("ZXY")
    return np.array([phi, theta, psi])


def _half_sphere(count: int) -> Vector:
    """Return directions spread evenly over half the sphere, along a spiral by the golden angle."""
    k = np.arange(count) + 0.5
    height, angle = k / count, np.pi * (3.0 - np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - height**2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
