"""Actuator failures: parameters of the failed parts, brakes, and metrics of a run."""

import json

import campaign
import numpy as np
import pytest
from flight.failures import (
    BRAKE_FREQUENCY,
    failure_metrics,
    failure_parameters,
    with_failures,
)
from flight.loops import FLIGHT_LOG
from numpy.testing import assert_allclose
from systems import respond

from trussflow.blocks import Simulator
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport

DYNAMICS = SpaceTruss.consistent().dynamics


def loop(brakes=False):
    """Return the mean-axes loop of Case 1, with actuators that may fail."""
    diagram = mean_axes_transport(
        Mission.of_case(1),
        SpaceTruss.consistent(),
        hardware=Hardware.flight(control="torque"),
        seed=1,
    )
    return with_failures(diagram, DYNAMICS, brakes=brakes)


@pytest.mark.parametrize(
    "part, bases, drives", [("base", 3, 28), ("drives", 4, 21), ("robot", 3, 21)]
)
def test_failed_parts_have_no_health(part, bases, drives):
    given = failure_parameters(DYNAMICS, part, 2, 10.0)
    assert given["failure.time"] == 10.0
    assert given["failure.bases"].sum() == bases
    assert given["failure.drives"].sum() == drives
    assert given["failure.bases"][1] == (part == "drives")
    assert (given["failure.drives"][7:14] == (part == "base")).all()


@pytest.fixture(scope="module")
def simulated():
    simulator = Simulator(loop(), step=2e-3, log=FLIGHT_LOG, log_step=0.02)

    def of(part, robot, time, duration):
        parameters = failure_parameters(DYNAMICS, part, robot, time)
        return simulator.run(duration, parameters=parameters)

    return of


@pytest.mark.parametrize(
    "robot, start", [(1, 1.0), *(campaign.only(robot, 10.0) for robot in (1, 2, 3))]
)
def test_a_failed_base_is_isolated(simulated, robot, start):
    """A base fails under up to three newtons of thrust: it is isolated, and the mission continues."""
    found = failure_metrics(simulated("base", robot, start, 2.0 * start))
    assert found["isolated after"] < 0.7
    assert found["false alarms"] == 0
    assert found["position"] < 0.01
    assert found["joints"] < 0.2
    assert found["attitude"] < 0.01


def test_a_failure_after_the_end_is_not_isolated(simulated):
    found = failure_metrics(simulated("base", 1, 100.0, 1.0))
    assert all(np.ndim(value) == 0 for value in found.values())
    assert np.isinf(found["isolated after"])
    assert found["false alarms"] == 0


@pytest.mark.parametrize("start", [0.3, campaign.only(30.0)])
def test_a_failed_robot_is_reported_by_its_excitation(simulated, start):
    """Near rest and while coasting its arm does not follow, and the truss does not tell about its base."""
    run = simulated("robot", 2, start, start + 1.0)
    held = run["controller.monitor.held"].values
    assert held[run["time"].values > start + 0.5][:, 7:14].all()
    assert not np.delete(held, range(7, 14), axis=1).any()
    assert failure_metrics(run)["false alarms"] == 0


def test_an_isolation_before_the_failure_or_of_another_part_is_a_false_alarm(simulated):
    """The base of robot 2 fails at 0.3 s, and is isolated: with another failure, this is a false alarm."""
    run = simulated("base", 2, 0.3, 1.0)
    assert failure_metrics(run)["false alarms"] == 0
    parameters = json.loads(run.attrs["parameters"])
    early = parameters | {"failure.time": 0.9}
    other = parameters | {"failure.bases": [1.0, 1.0, 1.0, 0.0]}
    for changed in (early, other):
        assert (
            failure_metrics(run.assign_attrs(parameters=json.dumps(changed)))[
                "false alarms"
            ]
            == 1
        )


def test_brakes_hold_an_isolated_arm():
    """Their torques return the arm to zero as a critically damped oscillator, and act on no other arm."""
    brakes = loop(brakes=True).blocks["brakes"]
    inertia = DYNAMICS.evaluate(DYNAMICS.rest).mass_matrix[6:34, 6:34]
    limp = np.arange(28) // 7 == 1
    torques = respond(
        brakes, angles=np.full(28, 0.01), rates=np.full(28, 0.02), on=1.0 * limp
    )["torques"]
    assert not torques[~limp].any()
    expected = -(BRAKE_FREQUENCY**2 * 0.01 + 2 * BRAKE_FREQUENCY * 0.02)
    assert_allclose(
        np.linalg.solve(inertia[7:14, 7:14], torques[limp]), expected, rtol=1e-9
    )
