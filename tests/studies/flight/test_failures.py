"""Actuators that die in flight: what dies, when, and what the measures of a flight say."""

import numpy as np
import pytest
from flight.failures import BRAKE, SIGNALS, Loss, fly, losses, with_loss
from numpy.testing import assert_allclose
from systems import respond

from trussflow.blocks import Simulator
from trussflow.models import Hardware, ModelError, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport

TRUSS = SpaceTruss.consistent()
DYNAMICS = TRUSS.dynamics


@pytest.mark.parametrize(("part", "bases", "drives"), [("base", 3, 28), ("drives", 4, 21), ("robot", 3, 21)])
def test_what_dies(part, bases, drives):
    given = Loss(part=part, robot=2, time=10.0).parameters(DYNAMICS)
    assert given["loss.time"] == 10.0
    assert given["loss.bases"].sum() == bases
    assert given["loss.drives"].sum() == drives
    assert given["loss.bases"][1] == (part == "drives")
    assert (given["loss.drives"][7:14] == (part == "base")).all()


def test_all_combinations_have_labels():
    labels = [str(loss) for loss in losses()]
    assert len(set(labels)) == 18
    assert labels[-1] == "robot 3 dead at 50 s"


def test_what_cannot_die():
    with pytest.raises(ModelError, match="part"):
        Loss(part="hand", robot=1, time=1.0)
    with pytest.raises(ModelError, match="robot"):
        Loss(part="base", robot=5, time=1.0).parameters(DYNAMICS)


@pytest.fixture(scope="module")
def simulator():
    diagram = mean_axes_transport(
        Mission.of_case(1), SpaceTruss.consistent(), hardware=Hardware.flight(), seed=1
    )
    return Simulator(with_loss(diagram, DYNAMICS), step=2e-3, log=list(SIGNALS), log_step=0.02)


@pytest.mark.parametrize(
    ("robot", "start"),
    [(1, 1.0), *(pytest.param(robot, 10.0, marks=pytest.mark.campaign) for robot in (1, 2, 3))],
)
def test_a_failed_base_is_found(simulator, robot, start):
    """A base fails under up to three newtons of thrust: it is isolated, and the mission goes on."""
    found = fly(simulator, DYNAMICS, Loss(part="base", robot=robot, time=start), duration=2.0 * start)
    assert found.delays["base"] < 0.3
    assert found.flown
    assert found.attitude < 0.01


def test_a_failure_that_does_not_happen_is_not_found(simulator):
    found = fly(simulator, DYNAMICS, Loss(part="base", robot=1, time=100.0), duration=1.0)
    assert np.isinf(found.delays["base"])
    assert not found.false_alarms
    assert not found.flown


@pytest.mark.parametrize("start", [0.3, pytest.param(30.0, marks=pytest.mark.campaign)])
def test_a_failed_robot_is_found_by_its_probe(simulator, start):
    """Near rest and while coasting, its actuators have nothing else to do."""
    found = fly(simulator, DYNAMICS, Loss(part="robot", robot=2, time=start), duration=start + 1.0)
    assert max(found.delays.values()) < 0.5
    assert not found.false_alarms


def test_brakes_hold_an_arm_that_is_believed_limp():
    """Their torques take what moves an arm to zero as a critically damped oscillator, and act on no other."""
    diagram = mean_axes_transport(Mission.of_case(1), SpaceTruss.consistent(), hardware=Hardware.flight())
    brakes = with_loss(diagram, DYNAMICS, brakes=True).blocks["brakes"]
    inertia = DYNAMICS.evaluate(DYNAMICS.rest).mass_matrix[6:34, 6:34]
    limp = np.arange(28) // 7 == 1
    left = np.append(np.ones(24), ~limp)
    torques = respond(brakes, angles=np.full(28, 0.01), rates=np.full(28, 0.02), effectiveness=left)[
        "torques"
    ]
    assert not torques[~limp].any()
    expected = -(BRAKE**2 * 0.01 + 2 * BRAKE * 0.02)
    assert_allclose(np.linalg.solve(inertia[7:14, 7:14], torques[limp]), expected, rtol=1e-9)
