"""The fastest motion along a path: laws of bang-bang, limits kept, and TOPP-RA as a second opinion."""

from itertools import pairwise

import numpy as np
import pytest
from systems import actuator_limits, assert_near, respond, series

from trussflow.blocks import simulate
from trussflow.models import Hardware, ModelError, SpaceTruss
from trussflow.models.dynamics.task_space import task_drift, to_body
from trussflow.models.feasibility import fastest, single_failures, survey
from trussflow.models.feasibility.reach import least_share
from trussflow.models.geometry.attitude import QUATERNION
from trussflow.models.transport import Mission, path_of

TRUSS = SpaceTruss.consistent()
TURNING = SpaceTruss.consistent(modes=0).with_quaternion()
REST = TRUSS.dynamics.rest[:6]
LIMITS = Hardware.flight(control="torque").limits(TRUSS)
STRONG = actuator_limits(TRUSS.dynamics, force=1e6, base_torque=1e6, joint_torque=1e6)
CURVED = REST + np.array(
    [[0, 0, 0, 0, 0, 0], [2, 0, 3, 0, 0, 0.5], [4, 2, 3, 0.3, 0, 1.0]]
)
# What linear programmes are exact to.
PROGRAM_TOLERANCE = 1e-6
# Of the strength, between points of the grid, of a path that bends; and left unused, as both ends of an
# interval have one acceleration.
EXCESS, UNUSED_SHARE = 2e-3, 0.05


def line(*way):
    return np.stack([REST, REST + np.array(way)])


def at(path, times):
    """Return position, velocity and acceleration at some times."""
    found = [respond(path, t) for t in times]
    return [
        np.array([one[name] for one in found])
        for name in ("position", "velocity", "acceleration")
    ]


def actuator_shares(dynamics, motion):
    """Return the share of the limits that each instant of a motion of rigid truss and arms takes."""
    bounds, shares = LIMITS, []
    for q, rate, change in zip(*motion, strict=True):
        v = to_body(dynamics.attitude, q, rate)
        drift = task_drift(dynamics.attitude, q, v)
        terms = dynamics.evaluate(q, v)
        force = (
            terms.mass_matrix @ to_body(dynamics.attitude, q, change - drift)
            + terms.bias
        )
        shares.append(least_share(terms.actuation_matrix, force, 0.0 * bounds, bounds))
    return np.array(shares)


def test_a_straight_line_is_bang_bang():
    """A Quintic of least duration T has d 10 / sqrt(3) / T^2 at most; all the time takes 2 sqrt(d / a)."""
    mission = Mission.of_case(1)
    healthy = single_failures(TRUSS.dynamics)[:1]
    least = survey(TRUSS.dynamics, path_of(mission, TRUSS), LIMITS, healthy)[
        0
    ].least_duration
    found = fastest(
        TRUSS, line(*mission.position, *mission.attitude), LIMITS, intervals=8
    )
    assert found.duration == pytest.approx(
        2.0 * least / np.sqrt(10.0 / np.sqrt(3.0)), rel=PROGRAM_TOLERANCE
    )
    half = at(found, np.array([0.2, 0.8]) * found.duration)[2]
    assert half[0] == pytest.approx(-half[1], abs=PROGRAM_TOLERANCE)


def test_limits_of_acceleration_and_velocity():
    """A trapezoid: the switch from one to the other lies in one interval of the grid."""
    way = line(0, 3, 0, 0, 0, 0)
    quick = fastest(TRUSS, way, STRONG, acceleration=0.03)
    assert quick.duration == pytest.approx(
        2.0 * np.sqrt(3.0 / 0.03), rel=PROGRAM_TOLERANCE
    )
    late = []
    for intervals in (40, 160):
        capped = fastest(
            TRUSS, way, STRONG, velocity=0.2, acceleration=0.03, intervals=intervals
        )
        late.append(capped.duration - (3.0 / 0.2 + 0.2 / 0.03))
        speed = at(capped, np.linspace(0.0, capped.duration, 400))[1]
        assert_near(speed, 0.0, 0.2 * (1.0 + PROGRAM_TOLERANCE))
    assert 0.0 < late[1] < late[0] < 0.1


def test_actuators_are_strained_to_their_limits_and_not_beyond():
    found = fastest(TRUSS, CURVED, LIMITS)
    motion = at(found, np.linspace(0.003, 0.997, 60) * found.duration)
    shares = actuator_shares(SpaceTruss.consistent(modes=0).dynamics, motion)
    assert max(shares) < 1.0 + EXCESS
    assert np.mean(shares > 1.0 - UNUSED_SHARE) > 0.9


def quaternions(*ways):
    """Return waypoints by displacement and turn from the start, an axis times an angle."""
    start = np.array(QUATERNION.rest)
    return np.array(
        [[*way[:3], *QUATERNION.integrate(start, np.array(way[3:]))] for way in ways]
    )


@pytest.mark.parametrize(
    "way", [(0.0, 0.0, 2.0, 0.0, 0.0, 0.0), (1.0, 0.0, 2.0, 0.0, 0.8, 0.0)]
)
def test_with_a_quaternion_the_same_path_takes_the_same_time(way):
    """About one axis both lead the same way; their grids differ."""
    euler = fastest(TRUSS, line(*way), LIMITS).duration
    other = fastest(TURNING, quaternions((0.0,) * 6, way), LIMITS).duration
    assert other == pytest.approx(
        euler, rel=5e-3 if any(way[3:]) else PROGRAM_TOLERANCE
    )


def test_quaternions_lead_beyond_euler_angles():
    """Turned by 166 degrees about x: velocities are those of the positions, and no limit is passed."""
    ways = [(0.0,) * 6, (1.0, 0.0, 1.0, 1.4, 0.0, 0.0), (1.0, 0.0, 2.0, 2.9, 0.0, 0.0)]
    waypoints = quaternions(*ways) * np.where(
        np.arange(7) < 3, 1.0, [[1.0], [-1.0], [1.0]]
    )
    found = fastest(TURNING, waypoints, LIMITS)
    times = np.linspace(0.0, found.duration, 2001)
    motion, step = at(found, times), times[1]
    position, velocity, acceleration = motion
    turns = position[:, 3:7]
    assert_near(np.linalg.norm(turns, axis=1), 1.0, 1e-14)
    turned = np.array([QUATERNION.difference(*pair) for pair in pairwise(turns)]) / step
    mean, change = (
        (velocity[1:] + velocity[:-1]) / 2.0,
        np.diff(velocity, axis=0) / step,
    )
    assert_near(turned, mean[:, 3:6], 1e-3 * np.abs(velocity[:, 3:6]).max())
    assert_near(
        change, (acceleration[1:] + acceleration[:-1]) / 2.0, 0.1 * np.abs(change).max()
    )
    assert (
        max(actuator_shares(TURNING.dynamics, [each[50:-1:50] for each in motion]))
        < 1.0 + EXCESS
    )
    axis = turns[:, 1:] / np.linalg.norm(turns[:, 1:] + 1e-30, axis=1)[:, None]
    assert np.abs(axis[1:, 1:]).max() < 1e-9


def test_the_motion_passes_the_waypoints_from_rest_to_rest():
    path = fastest(TRUSS, CURVED, LIMITS)
    diagram = series(moves=path)
    end = 0.01 * np.ceil(path.duration / 0.01) + 1.0
    result = simulate(diagram, end, step=0.01, backend="interpreted")
    position, velocity = (
        result[f"moves.{name}"].values for name in ("position", "velocity")
    )
    assert position.shape[1] == TRUSS.rigid == diagram.moves.shape[0]
    for waypoint in CURVED:
        assert np.min(np.linalg.norm(position[:, :6] - waypoint, axis=1)) < 2e-3
    assert position[-1, :6] == pytest.approx(CURVED[-1], abs=1e-12)
    assert not velocity[[0, -1]].any()
    assert np.ptp(position[:, 6:], axis=0).max() < 1e-12
    integral = position[0] + np.cumsum(
        0.01 * (velocity[:-1] + velocity[1:]) / 2.0, axis=0
    )
    assert_near(integral, position[1:], 1e-4)


def test_topp_ra_finds_the_same_duration():
    """With limits on each coordinate, which it knows."""
    pytest.importorskip("toppra", reason="TOPP-RA is a second opinion")
    from toppra import SplineInterpolator, algorithm, constraint

    steps = np.linalg.norm(np.diff(CURVED, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    path = SplineInterpolator(knots, CURVED, bc_type="natural")
    speed, change = np.full(6, 0.2), np.full(6, 0.05)
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-speed, speed])),
        constraint.JointAccelerationConstraint(
            np.column_stack([-change, change]),
            discretization_scheme=constraint.DiscretizationType.Interpolation,
        ),
    ]
    other = algorithm.TOPPRA(
        limits, path, gridpoints=np.linspace(0.0, 1.0, 81), solver_wrapper="seidel"
    )
    found = fastest(
        TRUSS, CURVED, STRONG, velocity=0.2, acceleration=0.05, intervals=80
    )
    assert found.duration == pytest.approx(
        other.compute_trajectory().duration, rel=5e-3
    )


@pytest.mark.parametrize(
    "given, message",
    [
        ({"waypoints": [REST]}, "there must be two waypoints or more"),
        ({"waypoints": [REST, REST]}, "successive ones must differ"),
        ({"waypoints": [[0.0, 1.0]]}, r"fastest: waypoints has shape \(1, 2\)"),
        (
            {"velocity": 0.0},
            "fastest: velocity is 0.0; it must be one number above 0, or six",
        ),
        (
            {"acceleration": [1.0, 2.0]},
            r"fastest: acceleration is \[1.0, 2.0\]; it must be one number",
        ),
        ({"intervals": 1}, "intervals is 1; it must be a whole number from 2 on"),
        (
            {"waypoints": line(0, 0, 1, np.pi / 2, 0, 0)},
            "the singularity of the Euler angles",
        ),
        (
            {"waypoints": line(0, 0, 1, np.pi, 0, 0), "intervals": 5},
            "the singularity of the Euler angles",
        ),
        (
            {
                "limits": actuator_limits(
                    TRUSS.dynamics, force=0.0, base_torque=0.0, joint_torque=1.0
                )
            },
            "the actuators cannot move the truss along this path; raise their limits",
        ),
    ],
)
def test_what_is_refused(given, message):
    arguments = {"waypoints": line(0, 0, 1, 0, 0, 0), "limits": LIMITS, **given}
    with pytest.raises(ModelError, match=message):
        fastest(TRUSS, **arguments)
