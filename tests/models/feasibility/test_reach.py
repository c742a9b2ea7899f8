"""What limited actuators can do, against other formulations, moments by hand, and known figures."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from refused import check_refused, over_calls
from scipy.optimize import linprog
from systems import actuator_limits, assert_near

from trussflow import models
from trussflow.blocks import Quintic
from trussflow.blocks.control.trajectory import PEAK_ACCELERATION
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.feasibility import (
    ActuatorFailure,
    shares_left,
    single_failures,
    survey,
)
from trussflow.models.transport import Mission, path_of

TRUSS = SpaceTruss.consistent(modes=0)
DYNAMICS = TRUSS.dynamics
LIMITS = Hardware.flight(control="torque").limits(TRUSS)
ALONG_Z = path_of(Mission.of_case(1), TRUSS)
TURNING = path_of(Mission.of_case(2), TRUSS)
HEALTHY, *_ = single_failures(DYNAMICS)
BASE_4 = ActuatorFailure.of(DYNAMICS, 4)
EXACT = 1e-6  # of a linear programme, relative


def checked(path, limits, failure):
    """Check one failure."""
    return survey(DYNAMICS, path, limits, [failure])[0]


def test_moment_about_the_line_of_bases():
    """Without base 4 three robots' torques make up the moment of the inertial force about their line, body x.

    Forces at points of the line have no moment about it, and the torque of a base passes through the first
    joint of its arm, whose axis lies on the line as well: so it is three times the limit at most.
    """
    terms = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
    inertia, bases = terms.mass_matrix, terms.base_positions
    assert_near(bases[:3, 1:], bases[[0, 0, 0], 1:], 1e-12)
    beside = inertia[3, 2] / inertia[0, 0] - bases[0, 1]
    moment = abs(inertia[0, 0] * PEAK_ACCELERATION * 6.0 / 60.0**2 * beside)
    assert moment == pytest.approx(11.48, abs=0.005)
    found = checked(ALONG_Z, LIMITS, BASE_4)
    assert found.needed_torque == pytest.approx(moment / 3.0, rel=EXACT)
    assert found.least_duration == pytest.approx(
        60.0 * np.sqrt(moment / 3.0 / 0.3), rel=EXACT
    )
    assert str(found) == (
        "base 4 along body z: bases 1, 2, 3 lie on one line, 2.07 m beside the force that moves the centre "
        "of mass; needs 3.83 N·m of base and joint torque, has 0.3 at 60 s; least duration 214.3 s"
    )


def test_single_failures_of_case_1():
    """Figures of an independent programme of the same equations: least durations at 0.3 and 1 N·m [s]."""
    for torque, known in (
        (0.3, [48.2, 53.4, 48.6, 48.6, 214.3]),
        (1.0, [44.8, 49.6, 46.0, 46.0, 117.4]),
    ):
        limits = actuator_limits(
            DYNAMICS, force=5.0, base_torque=torque, joint_torque=torque
        )
        found = survey(DYNAMICS, ALONG_Z, limits)
        assert len(found) == 13
        for each in found:
            robot = int(each.failure.split(",")[0].split()[-1].replace("healthy", "0"))
            assert each.least_duration == pytest.approx(known[robot], abs=0.05), (
                each.failure
            )
            assert each.feasible == (robot != 4)
    weak = survey(
        DYNAMICS,
        ALONG_Z,
        actuator_limits(DYNAMICS, force=3.0, base_torque=0.3, joint_torque=0.3),
    )
    assert_near(
        [e.needed_torque for e in weak[:5]], [0.39, 1.02, 0.51, 0.51, 3.83], 0.005
    )


def asked(path, t):
    """Return the generalized force that a path asks for, and the actuation matrix.

    Speeds are those whose kinematics give the rates of the path; accelerations are differences of them.
    """

    def state(t):
        p, s = path.parameters, t / 60.0
        q = p["start"] + p["displacement"] * s**3 * (10 - 15 * s + 6 * s**2)
        rates = p["displacement"] * 30 * s**2 * (1 - s) ** 2 / 60.0
        kinematics = np.column_stack(
            [DYNAMICS.kinematics(q, e) for e in np.eye(len(q))]
        )
        return q, np.linalg.solve(kinematics, rates)

    (q, v), step = state(t), 1e-3
    terms = DYNAMICS.evaluate(q, v)
    slope = (state(t + step)[1] - state(t - step)[1]) / (2 * step)
    return terms.mass_matrix @ slope + terms.bias, terms.actuation_matrix


@pytest.mark.parametrize(
    "failure", [HEALTHY, BASE_4, ActuatorFailure.of(DYNAMICS, 2, axes=["force z"])]
)
def test_least_duration_by_the_dual(failure):
    r"""The share of the limits that is needed is the dual's: the most work of the demand per effort.

    .. math:: \max\ w^T y \quad\text{with}\quad \sum_k l_k |P^T y|_k \le 1
    """
    limits, shares = LIMITS * failure.health, []
    steepest = 30.0 + np.array([-30.0, 30.0]) / np.sqrt(3.0)
    for t in [*np.linspace(0.0, 60.0, 13), *steepest]:
        w, P = asked(TURNING, t)
        m, n = P.shape
        result = linprog(
            np.concatenate([-w, np.zeros(n)]),
            A_ub=np.block(
                [
                    [P.T, -np.eye(n)],
                    [-P.T, -np.eye(n)],
                    [np.zeros((1, m)), limits[None]],
                ]
            ),
            b_ub=np.append(np.zeros(2 * n), 1.0),
            bounds=[(None, None)] * m + [(0.0, None)] * n,
        )
        shares.append(-result.fun)
    found = survey(DYNAMICS, TURNING, LIMITS, [failure], instants=13)[0]
    assert found.least_duration == pytest.approx(60.0 * np.sqrt(max(shares)), rel=EXACT)


def test_demands_scale_as_the_theory_says():
    """Flown in the least duration the margin is one; and with the torque that is needed, too."""
    for path, failure in ((ALONG_Z, BASE_4), (TURNING, HEALTHY), (TURNING, BASE_4)):
        found = checked(path, LIMITS, failure)
        p = path.parameters
        slower = Quintic(p["displacement"], found.least_duration, start=p["start"])
        assert checked(slower, LIMITS, failure).margin == pytest.approx(1.0, rel=EXACT)
        torque = found.needed_torque
        enough = actuator_limits(
            DYNAMICS, force=5.0, base_torque=torque, joint_torque=torque
        )
        assert checked(path, enough, failure).margin == pytest.approx(1.0, rel=EXACT)
        assert found.margin == pytest.approx(
            (60.0 / found.least_duration) ** 2, rel=EXACT
        )


def test_limp_joints_move_and_locked_ones_hold():
    """Locked joints need no torque; limp ones are not asked to hold the arm. The base works in all cases."""
    weak = actuator_limits(DYNAMICS, force=5.0, base_torque=0.3, joint_torque=0.01)
    whole, limp, locked = (
        checked(TURNING, weak, ActuatorFailure.of(DYNAMICS, 4, axes=[], joints=state))
        for state in ("working", "limp", "locked")
    )
    assert locked.margin > 1.001 * whole.margin
    assert abs(limp.margin / whole.margin - 1.0) > 1e-3
    assert locked.failure == "robot 4, joints locked ()"


def test_path_out_of_reach():
    dead = np.zeros(DYNAMICS.actuators)
    dead[2] = 1.0  # force z of base 1 alone
    joints = np.where(np.arange(len(dead)) < 24, dead, np.inf)
    found = checked(ALONG_Z, LIMITS, ActuatorFailure(name="all but one", health=joints))
    assert (found.margin, found.least_duration, found.needed_torque) == (
        0.0,
        np.inf,
        np.inf,
    )
    assert "base 1 is alone" in str(found)
    assert (
        "needs more force, whatever the torque at 60 s; no duration is feasible"
        in str(found)
    )


NO_ACTUATOR = actuator_limits(DYNAMICS, force=0.0, base_torque=0.0, joint_torque=0.0)
OVER = Quintic(np.pi * np.eye(34)[3], 60.0, start=DYNAMICS.rest)


@over_calls(__file__)
def test_bad_input(call, error, message):
    check_refused(call, error, message, vars(models) | globals())


def test_shares_left():
    """What can be flown after a loss stays as it is; of all else a reserve is kept."""
    margins = np.array(
        [
            each.margin
            for each in survey(
                DYNAMICS, ALONG_Z, LIMITS, single_failures(DYNAMICS)[1:5]
            )
        ]
    )
    assert (margins >= 1.0).tolist() == [True, True, True, False]
    found = shares_left(DYNAMICS, ALONG_Z, LIMITS, reserve=0.4)
    assert_allclose(found, [1.0, 1.0, 1.0, 0.6 * margins[3]], rtol=EXACT)
