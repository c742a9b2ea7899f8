"""A flexible truss with a quaternion: flown as with Euler angles in small turns, and in large ones too."""

from dataclasses import replace

import campaign
import numpy as np
import pytest
from systems import assert_near

from trussflow.blocks import Simulator
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport
from trussflow.models.transport.results import logged

LOG_STEP = 0.2  # s
ERROR_TOLERANCE = 1e-4  # m, rad; the noise of all that is measured


@pytest.fixture
def truss(random_system):
    """Return a truss of 15 points with three modes of 2 to 3 Hz, between two robots of one joint."""
    dynamics = random_system(("R", "R"), 3, elastic_integrals=True)
    modes = replace(
        dynamics.modes,
        frequencies=np.linspace(2.0, 3.0, 3),
        damping_ratios=np.full(3, 0.01),
        grasp_translations=0.1 * dynamics.modes.grasp_translations,
        grasp_rotations=0.1 * dynamics.modes.grasp_rotations,
    )
    return SpaceTruss(replace(dynamics, modes=modes))


def mission(turn, duration):
    place = np.array([0.3, 0.2, 0.1])
    return replace(Mission.of_case(1), position=place, attitude=turn, duration=duration)


def flights(truss, hardware, *missions):
    """Return flights for one and a quarter durations, all by one program."""
    diagram = mean_axes_transport(missions[0], truss, hardware=hardware)
    simulator = Simulator(diagram, step=4e-3, log=logged(diagram), log_step=LOG_STEP)
    found = []
    for each in missions:
        way = {"trajectory.displacement": each.displacement(truss.rigid)}
        run = simulator.run(1.25 * each.duration, parameters=way)
        found.append(run)
    return found


@pytest.mark.parametrize("duration", [4.0, campaign.only(10.0)])
def test_small_turns_are_flown_as_with_euler_angles(truss, duration):
    """What differs is of second order: half the turn, a quarter of the difference."""
    missions = [mission(s * np.array([0.04, -0.06, 0.1]), duration) for s in (1.0, 0.5)]
    hardware, ours = Hardware.exact(0.02, 0.02), truss.with_quaternion()
    pairs = zip(
        flights(truss, hardware, *missions),
        flights(ours, hardware, *missions),
        strict=True,
    )
    off = []
    for euler, numbers in pairs:
        errors = euler["attitude_error"].values
        off.append(np.abs(errors - numbers["attitude_error"].values).max())
        assert off[-1] < 0.15 * np.abs(errors).max()  # the turn
    assert off[1] < off[0] / 3.0


@pytest.mark.campaign
def test_the_paper_s_truss_slews_by_a_third_of_a_circle():
    """Two metres up and 120 degrees about x, behind all hardware, with wheels that resist being turned.

    They hold 1.7 N*m*s; unless their drives make up for it, that is too much for the law.

    The actuators need 63 s for it: of what they can do, 100 s take 40 %.
    """
    hardware = replace(Hardware.flight(), gyroscopic="cancelled")
    truss = hardware.mounted(SpaceTruss.consistent().with_quaternion())
    turn = np.deg2rad([120.0, 0.0, 0.0])
    way = replace(
        Mission.of_case(1),
        position=np.array([0.0, 0.0, 2.0]),
        attitude=turn,
        duration=100.0,
    )
    diagram = mean_axes_transport(way, truss, hardware=hardware)
    simulator = Simulator(diagram, step=1e-3, log=logged(diagram), log_step=LOG_STEP)
    found = simulator.run(110.0)
    angle = 2.0 * np.arctan2(
        found["attitude"].values[:, 1], found["attitude"].values[:, 0]
    )
    assert angle[-1] == pytest.approx(turn[0], abs=ERROR_TOLERANCE)
    for name in ("position_error", "attitude_error"):
        assert_near(found[name], 0.0, ERROR_TOLERANCE)
    assert_near(found["joint_error"], 0.0, 50.0 * ERROR_TOLERANCE)
    assert np.abs(found["base_force"]).max() < 5.0
