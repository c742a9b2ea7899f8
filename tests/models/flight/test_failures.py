"""Actuators that die in flight: what dies, when, and what the measures of a flight say."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Simulator
from trussflow.blocks.framework.declarations import Signals
from trussflow.models import Hardware, ModelError, SpaceTruss
from trussflow.models.flight.failures import BRAKE, SIGNALS, Loss, fly, losses, with_loss
from trussflow.models.transport import Mission, mean_axes_transport

DYNAMICS = SpaceTruss.consistent().dynamics


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


@pytest.mark.slow
def test_one_program_flies_several_losses():
    """Base 1 dies at 10 s, named within 0.3 s; then nothing; then a robot in the coast, by its probe."""
    plant = SpaceTruss.consistent()
    diagram = with_loss(
        mean_axes_transport(Mission.of_case(1), plant, hardware=Hardware.flight(), seed=1), DYNAMICS
    )
    simulator = Simulator(diagram, step=2e-3, log=list(SIGNALS), log_step=0.02)
    base = Loss(part="base", robot=1, time=10.0)
    found = fly(simulator, DYNAMICS, base, duration=20.0)
    assert found.delays["base"] < 0.3
    assert found.flown
    never = fly(simulator, DYNAMICS, replace(base, time=100.0), duration=9.0)
    assert np.isinf(never.delays["base"])
    assert not never.false_alarms
    assert not never.flown
    robot = fly(simulator, DYNAMICS, Loss(part="robot", robot=2, time=30.0), duration=32.0)
    assert max(robot.delays.values()) < 0.5
    assert not robot.false_alarms


def test_brakes_hold_an_arm_that_is_believed_limp():
    """Their torques take what moves an arm to zero as a critically damped oscillator, and act on no other."""
    plant = SpaceTruss.consistent()
    diagram = mean_axes_transport(Mission.of_case(1), plant, hardware=Hardware.flight())
    brakes = with_loss(diagram, DYNAMICS, brakes=True).blocks["brakes"]
    inertia = DYNAMICS.mass_matrix(DYNAMICS.rest)[6:34, 6:34]
    given = {"angles": np.full(28, 0.01), "rates": np.full(28, 0.02), "effectiveness": np.ones(52)}
    given["effectiveness"][31:38] = 0.0
    signals = Signals("brakes", given)
    torques = brakes.output(0.0, Signals("", {}), signals, Signals("", {}))["torques"]
    assert not torques[:7].any()
    assert not torques[14:].any()
    expected = -(BRAKE**2 * 0.01 + 2 * BRAKE * 0.02)
    np.testing.assert_allclose(np.linalg.solve(inertia[7:14, 7:14], torques[7:14]), expected, rtol=1e-9)
