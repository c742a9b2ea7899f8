"""What the probe does to truss, arms and noise, and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, respond

from trussflow.models import (
    ActuatorExcitation,
    FaultDetection,
    FreeModes,
    Hardware,
    MeanAxesAllocation,
    MeanAxesDesign,
    SpaceTruss,
)
from trussflow.models.plant.tunable_truss import TunableTruss

DYNAMICS = TunableTruss.accurate().dynamics
RIGID = DYNAMICS.rigid_freedoms
DESIGN = MeanAxesDesign.shipped()
STEP = DESIGN.sample_time
MONITOR = FaultDetection(DYNAMICS, DESIGN)
MODES = FreeModes.of(DYNAMICS, DYNAMICS.modes.modes)
TERMS = DYNAMICS.evaluate(DYNAMICS.rest)
RESPONSE = np.linalg.solve(
    TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID]
)
PARTS = MONITOR.members.T > 0.0
"""Of each base, then of the drives of each arm: which actuators are its."""


def probed(dynamics=DYNAMICS, design=DESIGN, samples=1):
    """Return the torques of each sample."""
    block = ActuatorExcitation(dynamics, design, FaultDetection(dynamics, design))
    return np.array(
        [respond(block, k * design.sample_time)["probe"] for k in range(samples)]
    )


def test_neither_the_root_nor_a_mode_feels_it():
    probe = probed(samples=2)[1]
    felt = np.append(RESPONSE[:6] @ probe, MODES.influence @ probe)
    could = np.append(
        np.abs(RESPONSE[:6]) @ np.abs(probe), np.abs(MODES.influence) @ np.abs(probe)
    )
    assert np.all(np.abs(felt) < 1e-9 * could)
    assert np.count_nonzero(probe[:24].reshape(4, 6)[:, :3]) == 0  # no thrust


@pytest.mark.parametrize("strength", [1.0, DESIGN.probe])
def test_each_part_stands_out_alike(strength):
    probe = probed(design=replace(DESIGN, probe=strength), samples=2)[1]
    for mine in PARTS:
        change = STEP * RESPONSE[6:] @ np.where(mine, probe, 0.0)
        assert np.sqrt(change @ MONITOR.precision @ change) == pytest.approx(
            strength, rel=1e-9
        )


def test_no_other_torques_of_a_part_stand_out_more(rng):
    """Of those that leave the root alone, and are as large."""
    probe, drives = probed(samples=2)[1], np.flatnonzero(PARTS[5])
    still = np.linalg.svd(RESPONSE[:6, drives])[2][3:].T
    assert_near(
        RESPONSE[:6, drives] @ still, 0.0, 1e-9 * np.abs(RESPONSE[:6, drives]).max()
    )
    for ways in rng.standard_normal((20, still.shape[1])):
        other = still @ ways
        other *= np.linalg.norm(probe[drives]) / np.linalg.norm(other)
        change = STEP * RESPONSE[6:][:, drives] @ other
        assert np.sqrt(change @ MONITOR.precision @ change) < DESIGN.probe


@pytest.mark.parametrize("time", [0.02, 0.05])
def test_joints_that_rest_come_back_to_where_they_are(time):
    """Up, down, down, up: from rest their mean speed is none, and after a period they are back."""
    probe = probed(design=replace(DESIGN, sample_time=time), samples=401)
    assert not probe[0, 24:].any()
    for torques in (probe[:400, :24], probe[1:, 24:]):
        signs = np.sign(torques[:, np.argmax(np.abs(torques[0]))])
        assert_array_equal(signs * signs[0], np.tile([1.0, -1.0, -1.0, 1.0], 100))
        speeds = np.cumsum(torques, axis=0)
        ways = np.cumsum(speeds - torques / 2.0, axis=0)
        for each in (speeds, ways):
            assert_near(each[3::4], 0.0, 1e-12 * np.abs(ways).max())


def test_bases_and_drives_are_excited_in_quadrature():
    """Otherwise losses of both could cancel each other, where their effects have the same direction."""
    signs = np.sign(probed(samples=5)[1:])
    assert_array_equal(signs[:, :24].T @ signs[:, 24:], 0.0)


def test_none_at_no_strength_and_of_robots_without_enough_joints(random_system):
    """In general more than six torques, lest the truss should feel them; bases here need only three."""
    assert not probed(design=replace(DESIGN, probe=0.0)).any()
    none = DESIGN.neutral_modes
    for joints in (0, 4, 6):
        assert not probed(
            random_system((joints, joints), none, elastic_integrals=True)
        ).any()
    system = random_system((7, 4), none, elastic_integrals=True)
    probe = probed(system, samples=2)[1]
    assert_array_equal(np.flatnonzero(probe), np.arange(12, 19))


def test_within_limits_and_also_of_failed_actuators():
    """A part that works again can only be found if it is excited."""
    limits = Hardware.flight().limits(SpaceTruss(DYNAMICS))
    allocation = MeanAxesAllocation(DYNAMICS, limits, DESIGN)
    left = np.where(PARTS[6], 0.0, 1.0)
    matrices = {
        "actuation_matrix": TERMS.actuation_matrix[:RIGID],
        "inertia": MODES.inertia,
    }
    command = respond(allocation, probe=2.0 * limits, effectiveness=left, **matrices)[
        "command"
    ]
    assert_array_equal(command, limits)
