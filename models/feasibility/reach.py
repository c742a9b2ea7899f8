r"""Feasibility of a path with failed actuators, and its least duration.

Along a path of the truss, with the joints held, the rigid equations need the generalized force

.. math:: w(t) = G(q)\,\dot v + c(q, v) = P_r(q)\,Q, \qquad |Q_k| \le l_k

where the acceleration of limp joints is free, and the torque of locked ones is unlimited. A linear programme
decides whether such a Q exists; others give the factor by which limits or torques must increase. With the
duration T' the same path needs :math:`(T/T')^2 w`, since inertial forces are quadratic in rates. So the
largest needed share of the limits gives the least duration.

The analysis is rigid and instantaneous: without modes, reserves for feedback, and motion of limp arms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from trussflow.blocks.control.trajectory import Quintic, Trajectory
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import is_whole, shown
from trussflow.models.dynamics.assembly import DynamicsTerms
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import task_drift, to_body
from trussflow.models.errors import ModelError
from trussflow.models.feasibility.failures import ActuatorFailure, single_failures
from trussflow.models.geometry.attitude import EULER
from trussflow.models.validation import frozen_array

RELATIVE_TOLERANCE = 1e-6
"""Relative tolerance of linear programmes and margins [-]."""

SOLVED, INFEASIBLE = 0, 2
"""Status codes of `linprog`."""

LEAST_COSINE = 0.05
"""Least cosine of φ, below which the Euler angles count as singular [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Feasibility:
    """Feasibility of a path after a failure.

    Attributes
    ----------
    failure : str
        Name of the failure.
    direction : str
        Direction of the acceleration at the critical instant, in truss axes.
    margin : float
        Largest feasible factor of all demands; below 1 the path is infeasible [1].
    duration, least_duration : float
        Duration of the path, and its least feasible duration [s].
    instant : float
        Critical instant, with the largest share of the limits [s].
    torque, needed_torque : float
        Largest available torque, and the least common limit of base and joint torques for a feasible path
        with the same force limits; infinite if there is none [N·m].
    remark : str
        Remark on the geometry of the healthy bases.
    """

    failure: str
    direction: str
    margin: float
    duration: float
    least_duration: float
    instant: float
    torque: float
    needed_torque: float
    remark: str

    @property
    def feasible(self) -> bool:
        """Whether the path is feasible with its duration."""
        return self.margin >= 1.0 - RELATIVE_TOLERANCE

    def __str__(self) -> str:
        start = f"{self.failure} along {self.direction}: "
        if self.feasible:
            return f"{start}margin {self.margin:.3g}, least duration {self.least_duration:.4g} s"
        needs = f"needs {self.needed_torque:.3g} N·m of base and joint torque, has {self.torque:.3g}"
        if not np.isfinite(self.needed_torque):
            needs = "needs more force, whatever the torque"
        least = "no duration is feasible"
        if np.isfinite(self.least_duration):
            least = f"least duration {self.least_duration:.4g} s"
        return f"{start}{self.remark}{needs} at {self.duration:g} s; {least}"


class Demand(NamedTuple):
    """Demand of a path at one instant.

    Attributes
    ----------
    time : float
        Instant [s].
    force : Vector, shape (m,)
        Generalized force, w [N, N·m].
    terms : DynamicsTerms
        Rigid equations of truss and robots.
    acceleration : Vector, shape (m,)
        Rates of the generalized speeds, in truss axes [m/s², rad/s²].
    """

    time: float
    force: Vector
    terms: DynamicsTerms
    acceleration: Vector


def survey(
    dynamics: TrussDynamics,
    path: Trajectory,
    limits: Vector,
    failures: Sequence[ActuatorFailure] | None = None,
    *,
    instants: int = 25,
) -> tuple[Feasibility, ...]:
    """Return the feasibility of a path after each of some failures during the whole path.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots; modes are ignored.
    path : Trajectory
        Path of all rigid coordinates, for example by `path_of`.
    limits : Vector, shape (actuators,)
        Limit of each healthy actuator, such as `Hardware.limits` [N, N·m].
    failures : sequence of ActuatorFailure, optional
        Failures; by default none and each single failure.
    instants : int
        Number of equidistant instants; breakpoints and instants of peak acceleration are added [-].

    Returns
    -------
    tuple of Feasibility
        Result per failure; as text it is one line of a report.

    Raises
    ------
    ModelError
        If the path has other coordinates, rests, or is near a singularity of the Euler angles. Also if the
        limits do not fit the robots, or no actuator is healthy.
    """
    failures = single_failures(dynamics) if failures is None else failures
    limits = frozen_array("actuator limits", limits, (dynamics.actuators,))
    bounds = [bounds_of(limits, failure) for failure in failures]
    demands = demands_of(dynamics, path, instants)
    return tuple(
        _checked(demands, *each, path) for each in zip(failures, bounds, strict=True)
    )


def shares_left(
    dynamics: TrussDynamics, path: Quintic, limits: Vector, *, reserve: float = 0.25
) -> Vector:
    """Return the feasible factor of a path's peak acceleration after the failure of each base, at most 1.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots; modes are ignored.
    path : Quintic
        Path of all rigid coordinates.
    limits : Vector, shape (actuators,)
        Limit of each healthy actuator, such as `Hardware.limits` [N, N·m].
    reserve : float
        Share of the feasible acceleration reserved for feedback, from 0 to below 1 [1].

    Returns
    -------
    Vector, shape (robots,)
        Factors for `RetimedQuintic` and `mean_axes_transport` [1].

    Raises
    ------
    ModelError
        If the reserve is out of range, or `survey` raises.
    """
    if not 0.0 <= reserve < 1.0:
        raise ModelError(
            f"shares left: reserve is {reserve}; it must be at least 0 and below 1"
        )
    losses = [ActuatorFailure.of(dynamics, i + 1) for i in range(len(dynamics.arms))]
    margins = [each.margin for each in survey(dynamics, path, limits, losses)]
    # A feasible path is unchanged, even if its reserve is smaller.
    return np.array(
        [1.0 if margin >= 1.0 else (1.0 - reserve) * margin for margin in margins]
    )


def demands_of(
    dynamics: TrussDynamics, path: Trajectory, instants: int
) -> list[Demand]:
    """Return the demands of a path at instants, or the largest one if they differ by a factor only.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    path : Trajectory
        Path of all rigid coordinates.
    instants : int
        Number of equidistant instants, see `survey` [-].

    Raises
    ------
    ModelError
        See `survey`.
    """
    rigid, kind = dynamics.without_modes(), dynamics.attitude
    p = Signals("path", path.parameters)
    if path.shape != (rigid.freedoms,):
        raise ModelError(
            f"cannot check a path of shape {path.shape}: it must be of the {rigid.freedoms} coordinates of "
            "truss and joints"
        )
    if not is_whole(instants) or instants < 1:
        raise ModelError(
            f"cannot check a path at {shown(instants)} instants; give a whole number from 1 on"
        )
    demands = []
    # Normalized instants at which a quintic has its largest acceleration.
    steepest = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    start, *between, end = path.breakpoints()
    taus = np.union1d(np.linspace(0.0, 1.0, instants), steepest)
    times = np.union1d(start + taus * (end - start), between)
    # A `RetimedQuintic` is checked without its states, as a `Quintic`.
    output = partial(Quintic.output, path) if isinstance(path, Quintic) else path.output
    motion = [output(time, p, p, p) for time in times]
    rates = np.abs([at["velocity"] for at in motion])
    if not np.any(rates):
        raise ModelError("cannot check a path that rests; let it move the truss")
    if np.max(rates[:, 6:], initial=0.0) > RELATIVE_TOLERANCE * np.max(rates):
        raise ModelError(
            "cannot check a path that moves joints: they are held here; let them rest"
        )
    for time, at in zip(times, motion, strict=True):
        q = at["position"]
        if kind == EULER and abs(np.cos(q[3])) < LEAST_COSINE:
            raise ModelError(
                f"at {time:.3g} s the path comes to φ = {np.degrees(q[3]):.3g}°, where the Euler angles are "
                "singular (±90°); choose another attitude to start from, turned about the direction of "
                "flight, or a truss with a quaternion"
            )
        v = to_body(kind, q, at["velocity"])
        acceleration = to_body(kind, q, at["acceleration"] - task_drift(kind, q, v))
        terms = rigid.evaluate(q, v)
        force = terms.mass_matrix @ acceleration + terms.bias
        demands.append(Demand(time, force, terms, acceleration))
    # The limits are symmetric, so the largest of proportional demands decides.
    if np.linalg.matrix_rank(np.stack([demand.force for demand in demands])) == 1:
        return [max(demands, key=lambda demand: float(np.abs(demand.force).max()))]
    return demands


def bounds_of(limits: Vector, failure: ActuatorFailure) -> Vector:
    """Return the `limits` of all actuators after a `failure` [N, N·m]; locked joints are unlimited.

    Raises
    ------
    ModelError
        If no actuator is healthy, or the failure has another number of actuators.
    """
    left = np.asarray(failure.health, dtype=float)
    if left.shape != limits.shape or not np.all(left >= 0.0):
        raise ModelError(
            f"{failure.name}: health must be {limits.size} numbers from 0 on, not {left}"
        )
    locked = np.isinf(left)
    bounds: Vector = np.where(locked, np.inf, limits * np.where(locked, 1.0, left))
    if not np.any(bounds[~locked]):
        raise ModelError(
            f"{failure.name}: no actuator is left; raise its limit or its health above 0"
        )
    return bounds


def columns(demand: Demand, failure: ActuatorFailure) -> Vector:
    """Return the matrix from actuations and accelerations of limp joints to generalized forces.

    Parameters
    ----------
    demand : Demand
        Demand with the equations of motion.
    failure : ActuatorFailure
        ActuatorFailure with the limp joints.
    """
    terms = demand.terms
    # Limp joints accelerate freely, so their accelerations are unknowns. Three numbers
    # per base position, six actuators per base: hence the factor 2.
    limp = 6 + np.flatnonzero(failure.health[terms.base_positions.size * 2 :] == 0.0)
    return np.hstack([terms.actuation_matrix, -terms.mass_matrix[:, limp]])


def solution(cost: Vector, **constraints: Any) -> Any:
    """Return the solution of a linear programme; it has no `x` if the programme is infeasible.

    Parameters
    ----------
    cost : array
        Coefficients of the minimized function [-].
    **constraints
        Matrices, right-hand sides and bounds, as for `scipy.optimize.linprog`.

    Raises
    ------
    ModelError
        If the programme is feasible, but could not be solved.
    """
    from scipy.optimize import linprog  # slow to import

    result = linprog(cost, **constraints)
    if result.status not in (SOLVED, INFEASIBLE):
        raise ModelError(f"a linear programme could not be solved: {result.message}")
    return result


def least_share(matrix: Vector, force: Vector, fixed: Vector, growing: Vector) -> float:
    r"""Return the least θ ≥ 0 with which a force is feasible, or infinity.

    .. math:: A z = w, \qquad |z_k| \le f_k + \theta g_k

    Parameters
    ----------
    matrix : Vector, shape (m, n)
        Matrix A [any].
    force : Vector, shape (m,)
        Force w [any].
    fixed, growing : Vector, shape (k,)
        Limits f and g of the first k variables; g may be infinite, and the others are free [any].
    """
    size = float(np.abs(force).max())  # for scaling
    if size == 0.0:
        return 0.0
    total, grows = (
        matrix.shape[1],
        np.flatnonzero((growing > 0.0) & np.isfinite(growing)),
    )
    limit = np.full(total, np.inf)
    limit[: len(fixed)] = np.where(growing > 0.0, np.inf, fixed / size)
    both = np.kron([[1.0], [-1.0]], np.eye(total)[grows])
    result = solution(
        np.append(np.zeros(total), 1.0),
        A_ub=np.column_stack([both, -np.tile(growing[grows], 2)]),
        b_ub=np.tile(fixed[grows] / size, 2),
        A_eq=np.column_stack([matrix, np.zeros(len(force))]),
        b_eq=force / size,
        bounds=[*zip(-limit, limit, strict=True), (0.0, np.inf)],
    )
    return np.inf if result.fun is None else size * float(result.fun)


def _checked(
    demands: list[Demand], failure: ActuatorFailure, bounds: Vector, path: Trajectory
) -> Feasibility:
    """Return the feasibility of a path after one failure."""
    torque = np.arange(len(bounds)) % 6 >= 3
    torque[2 * demands[0].terms.base_positions.size :] = True
    forces, effective = (
        np.where(torque, 0.0, bounds),
        np.where(torque, failure.health, 0.0),
    )
    shares, needed = [], []
    for demand in demands:
        matrix = columns(demand, failure)
        shares.append(least_share(matrix, demand.force, np.zeros_like(bounds), bounds))
        needed.append(least_share(matrix, demand.force, forces, effective))
    start, *_, end = path.breakpoints()
    worst, duration = int(np.argmax(shares)), end - start
    return Feasibility(
        failure=failure.name,
        direction=_direction(demands[worst].acceleration),
        margin=1.0 / shares[worst],
        duration=duration,
        # Accelerations and squared speeds, so all forces, scale with 1 / duration^2.
        least_duration=duration * np.sqrt(shares[worst]),
        instant=float(demands[worst].time),
        torque=float(bounds[torque & np.isfinite(bounds)].max(initial=0.0)),
        needed_torque=max(needed),
        remark=_remark(demands[worst], bounds),
    )


def _direction(acceleration: Vector) -> str:
    """Return the direction of a linear or, if that is zero, angular acceleration in words."""
    linear, angular = acceleration[:3], acceleration[3:6]
    what, vector = ("body", linear) if np.any(linear) else ("turns about body", angular)
    if not np.any(vector):
        return "a steady turn"
    unit = vector / np.linalg.norm(vector)
    axis = int(np.abs(unit).argmax())
    if abs(unit[axis]) > 1.0 - RELATIVE_TOLERANCE:
        return f"{what} {'xyz'[axis]}"
    return f"{what} ({', '.join(f'{x:.2f}' for x in unit)})"


def _remark(demand: Demand, bounds: Vector) -> str:
    """Return a remark if the healthy bases are on one line or at one point, with the lever arm."""
    bases, G, push = (
        demand.terms.base_positions,
        demand.terms.mass_matrix,
        demand.acceleration[:3],
    )
    pushing = np.flatnonzero(
        np.any(bounds[: 2 * bases.size].reshape(-1, 6)[:, :3], axis=1)
    )
    if not pushing.size:
        return "no base has forces left; "
    first, *others = bases[pushing]
    _, extent, axes = np.linalg.svd(np.array([first, *others]) - first)
    if len(extent) > 1 and extent[1] > RELATIVE_TOLERANCE * extent[0]:
        return ""
    push = push / np.linalg.norm(push) if np.any(push) else push
    # G = [m I, -S^x; S^x, J], so the centre of mass S / m is in its lower left block.
    moment = np.cross(np.array([G[5, 1], G[3, 2], G[4, 0]]) / G[0, 0] - first, push)
    names = ", ".join(str(i + 1) for i in pushing)
    line = f"bases {names} lie on one line" if others else f"base {names} is alone"
    distance = abs(axes[0] @ moment) if others else np.linalg.norm(moment)
    return f"{line}, {distance:.2f} m beside the force that moves the centre of mass; "
