r"""Time-optimal motion along a path, by a linear programme in the squared path velocities.

On the path q(s), with :math:`x = \dot s^2` and :math:`\ddot s = x' / 2`, the rigid equations are

.. math:: (M q')\,\ddot s + (M q'' + h(q, q'))\,x = P(q)\,Q, \qquad |Q_k| \le l_k

linear in x, x' and Q. Limits of velocity bound x, those of acceleration :math:`q' \ddot s + q'' x`. Between
grid points x is linear in s; all limits hold at both ends of each interval. The pointwise maximum of two
feasible profiles is feasible, except for errors of the grid. So the profile with the largest sum is optimal.

TOPP-RA solves the same problem with limits on each coordinate. Here there are more actuators than
coordinates, so that the actuations of each point are unknowns.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import is_whole, shown
from trussflow.models.dynamics.task_space import task_drift, task_motion, to_body
from trussflow.models.errors import ModelError
from trussflow.models.feasibility.reach import LEAST_COSINE, solution
from trussflow.models.feasibility.truss_path import TrussPath, on_one_side
from trussflow.models.geometry.attitude import EULER
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.validation import frozen_array


class FastestPath(TrussPath):
    """Trajectory by `fastest`, at rest before and after.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    times : Vector, shape (k,)
        Times of the grid points [s].
    position, velocity : Vector, shape (k, rigid_q)
        Coordinates of the grid points, and their derivatives [unit, unit/s].
    after, before : Vector, shape (k - 1, rigid_q)
        Second derivatives at the start and at the end of each interval [unit/s²].
    """

    def __init__(
        self,
        truss: SpaceTruss,
        times: Vector,
        position: Vector,
        velocity: Vector,
        after: Vector,
        before: Vector,
    ) -> None:
        h = np.diff(times)[:, None]
        v, a = velocity[:-1], after / 2.0
        # Fifth-degree polynomials that meet position, velocity and acceleration at both
        # ends.
        gap = position[1:] - position[:-1] - h * (v + h * a)
        rate, bend = h * (velocity[1:] - v - 2.0 * h * a), h**2 * (before - after)
        coefficients = [
            position[:-1],
            v,
            a,
            (10.0 * gap - 4.0 * rate + bend / 2.0) / h**3,
            (-15.0 * gap + 7.0 * rate - bend) / h**4,
            (6.0 * gap - 3.0 * rate + bend / 2.0) / h**5,
        ]
        super().__init__(truss, times, coefficients)

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return float(self._times[-1])


def fastest(
    truss: SpaceTruss,
    waypoints: npt.ArrayLike,
    limits: Vector,
    *,
    velocity: npt.ArrayLike = np.inf,
    acceleration: npt.ArrayLike = np.inf,
    intervals: int = 40,
) -> FastestPath:
    """Return the fastest motion of the truss along a path, from rest to rest, with the joints held.

    The path is the cubic spline through the waypoints. The truss is rigid here. Use a share of the true
    limits, to keep a reserve for feedback and flexibility. `ShapedTrajectory` avoids excitation of a mode.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    waypoints : array_like, shape (k, 6) or (k, 7)
        Positions of the truss frame with its Euler angles or quaternions, at least two rows, the start first
        [m, rad or 1]. Quaternions rotate by the smaller angle.
    limits : Vector, shape (actuators,)
        Limit of each actuator, such as `Hardware.limits` [N, N·m].
    velocity, acceleration : array_like
        Positive limits of the six task coordinates, one number or six; by default none [m/s, rad/s; m/s²,
        rad/s²].
    intervals : int
        Number of grid intervals along the path [-].

    Returns
    -------
    FastestPath
        Trajectory of all rigid coordinates. Its `duration` is optimal for the grid, at whose points the
        limits hold. Violations between them decrease with the number of intervals.

    Raises
    ------
    ModelError
        If waypoints or limits are invalid, or two successive waypoints are equal. Also if the path is near a
        singularity of the Euler angles, or the actuators cannot move the truss along it.
    """
    from scipy.interpolate import make_interp_spline

    kind = truss.dynamics.attitude
    rows = on_one_side(
        kind, frozen_array("fastest: waypoints", waypoints, (None, kind.end))
    )
    for row in rows:
        kind.checked(row[3:])
    most = np.array(
        [_positive("velocity", velocity), _positive("acceleration", acceleration)]
    )
    steps = np.linalg.norm(
        np.diff(rows / ([1.0] * 3 + [kind.per_radian] * (kind.end - 3)), axis=0), axis=1
    )
    if not (len(steps) and np.all(steps > 0.0)):
        raise ModelError(
            "fastest: there must be two waypoints or more, and successive ones must differ"
        )
    if not is_whole(intervals) or intervals < 2:
        raise ModelError(
            f"fastest: intervals is {shown(intervals)}; it must be a whole number from 2 on"
        )
    joints = np.tile(truss.start_position[kind.end :], (len(rows), 1))
    at = np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps)
    spline = make_interp_spline(at, np.hstack([rows, joints]), k=3, bc_type="natural")
    s = np.linspace(0.0, 1.0, intervals + 1)
    q, dq, ddq = (spline(s, nu=order) for order in range(3))
    between = np.cos(spline(np.linspace(0.0, 1.0, 10 * intervals + 1))[:, 3])
    if kind == EULER and (
        np.min(np.abs(between)) < LEAST_COSINE or np.ptp(np.sign(between))
    ):
        raise ModelError(
            "fastest: the path is near the singularity of the Euler angles at φ = ±90°"
        )
    where, slope, bend = map(
        np.array, zip(*map(partial(task_motion, kind), q, dq, ddq), strict=True)
    )
    x = _squared_speeds(truss, limits, where, slope, bend, most)
    speed = np.sqrt(x)[:, None]
    if not np.all(speed[1:-1] > 0.0):
        raise ModelError(
            "fastest: the actuators cannot move the truss along this path; raise their limits"
        )
    # x = (ds/dt)^2 is linear in s in an interval, so that d2s/dt2 = (dx/ds) / 2 there.
    along = np.diff(x)[:, None] * intervals / 2.0
    # ds over the mean speed is exact, since the acceleration is constant in s.
    times = np.concatenate(
        [[0.0], np.cumsum(2.0 / intervals / (speed[:-1, 0] + speed[1:, 0]))]
    )
    after, before = (
        dq[e] * along + ddq[e] * x[e, None] for e in (slice(None, -1), slice(1, None))
    )
    return FastestPath(truss, times, q, dq * speed, after, before)


def _positive(name: str, given: npt.ArrayLike) -> Vector:
    """Return limits of the six coordinates, which must be positive."""
    try:
        found: Vector = np.broadcast_to(np.asarray(given, dtype=float), 6)
    except (TypeError, ValueError):
        found = np.zeros(6)
    if not np.all(found > 0.0):
        raise ModelError(
            f"fastest: {name} is {shown(given)}; it must be one number above 0, or six"
        )
    return found


def _squared_speeds(
    truss: SpaceTruss, limits: Vector, q: Vector, dq: Vector, ddq: Vector, most: Vector
) -> Vector:
    """Return the optimal squared path velocities at the grid points, zero at both ends [1/s²]."""
    from scipy.sparse import block_diag, csr_array, hstack

    rigid, kind = truss.dynamics.without_modes(), truss.dynamics.attitude
    bounds, count = frozen_array("actuator limits", limits, (rigid.actuators,)), len(q)
    forces, limited = rigid.rigid_freedoms, np.isfinite(most[1])
    blocks, mixes = [], []
    for where, slope, bend in zip(q, dq, ddq, strict=True):
        v = to_body(kind, where, slope)
        terms = rigid.evaluate(where, v)
        mass = terms.mass_matrix
        curved = (
            mass @ to_body(kind, where, bend - task_drift(kind, where, v)) + terms.bias
        )
        blocks.append(terms.actuation_matrix)
        # generalized forces, then accelerations of the six coordinates with a limit
        mixes.append(
            [
                np.append(mass @ v, slope[:6][limited]),
                np.append(curved, bend[:6][limited]),
            ]
        )
    # x is scaled so that the strongest actuator has the limit 1.
    unit = np.max(bounds) / np.max(np.abs(np.array(mixes)[..., :forces]))
    rows = np.zeros((2 * (count - 1), len(mixes[0][0]), count))
    points = [i + end for i in range(count - 1) for end in (0, 1)]
    for row, j in enumerate(points):
        # by x_j and the acceleration (x_{i + 1} - x_i) / (2 ds)
        i = row // 2
        pair, change = np.eye(2)[j - i], np.array([-1.0, 1.0]) * (count - 1) / 2.0
        ahead, aside = mixes[j]
        rows[row, :, i : i + 2] = unit * (
            np.outer(ahead, change) + np.outer(aside, pair)
        )
    asked, bent = (part.reshape(-1, count) for part in np.split(rows, [forces], axis=1))
    acting = block_diag([blocks[j] for j in points], format="csr")
    with np.errstate(divide="ignore"):
        squares = np.min((most[0] / np.abs(dq[:, :6])) ** 2, axis=1) / unit
    squares[[0, -1]] = 0.0
    each = np.tile(bounds, len(points))
    matrices: Any = {  # SciPy's type stubs lack sparse matrices here
        "A_eq": hstack([csr_array(-asked), acting]),
        "A_ub": hstack(
            [csr_array(np.vstack([bent, -bent])), csr_array((2 * len(bent), len(each)))]
        ),
        "bounds": np.column_stack(
            [np.append(np.zeros(count), -each), np.append(squares, each)]
        ),
    }
    found = solution(
        np.append(-np.ones(count), np.zeros(len(each))),
        b_eq=np.zeros(len(acting.indptr) - 1),
        b_ub=np.tile(most[1][limited], 2 * len(points)),
        **matrices,
    )
    return np.asarray(unit * np.maximum(found.x[:count], 0.0))
