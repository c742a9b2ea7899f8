"""Allocation of the mean-axes law: the task first, then the modes, then effort, never beyond limits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, respond

from trussflow.blocks.errors import ParameterError
from trussflow.models import FreeModes, MeanAxesDesign, SpaceTruss
from trussflow.models.mean_axes.allocation import MeanAxesAllocation

DYNAMICS = SpaceTruss.consistent().dynamics
RIGID = DYNAMICS.rigid_coordinates
LIMITS = np.concatenate([np.tile([5.0] * 3 + [0.3] * 3, 4), np.full(28, 0.3)])
TERMS = DYNAMICS.evaluate(DYNAMICS.rest, np.zeros(DYNAMICS.coordinates))
G, P = TERMS.mass_matrix[:RIGID, :RIGID], TERMS.actuation_matrix[:RIGID]
DESIGN = MeanAxesDesign.shipped()


def allocated(slow=0.0, fast=0.0, design=DESIGN, **more):
    """Return the command for accelerations wanted slowly, and by the feedback."""
    wanted = G @ (np.zeros(RIGID) + slow)
    forces = {"slow_force": wanted, "force": wanted + G @ (np.zeros(RIGID) + fast)}
    block = MeanAxesAllocation(DYNAMICS, LIMITS, design)
    return respond(block, actuation_matrix=P, inertia=G, **forces, **more)["command"]


def acceleration(**elements):
    wanted = np.zeros(RIGID)
    for name, value in elements.items():
        wanted["xyz".index(name)] = value
    return wanted


def test_a_task_within_reach_is_met():
    wanted = acceleration(z=5e-3)
    command = allocated(wanted)
    missing = np.linalg.solve(G, P @ command) - wanted
    assert_near(missing[:6], 0.0, 1e-3 * 5e-3)
    assert (np.abs(command) < 0.95 * LIMITS).all()


def test_limits_and_dead_actuators_hold():
    wanted = acceleration(x=8e-3, y=8e-3, z=8e-3)
    alive = np.ones(len(LIMITS))
    alive[6:12] = 0.0
    command = allocated(wanted, 0.5 * wanted, effectiveness=alive)
    assert (np.abs(command) <= LIMITS * (1 + 1e-12)).all()
    assert_array_equal(command[6:12], 0.0)
    assert np.abs(command[:6]).max() > 3.0


def test_feedback_leaves_the_modes_alone():
    """A rate of the feedback works on the neutral modes; the dearer that is, the less it does.

    With cheap joint torques, which do most of it: they are dear in the shipped design.
    """
    wanted, design = acceleration(z=1e-3), replace(DESIGN, joint_reluctance=1.0)
    influence = FreeModes.of(DYNAMICS, DESIGN.neutral_modes).influence
    work = [
        np.abs(influence @ allocated(0.0, wanted, replace(design, neutrality=n))).max()
        for n in (1e-9, DESIGN.neutrality, 1.0)
    ]
    assert work[1] < 0.3 * work[0]
    assert work[2] < 0.01 * work[0]


def test_feedback_at_rest_makes_no_second_step_of_thrust():
    """What is beyond it others do; what changes slowly, and a path that moves, may have all."""
    fast, slow = acceleration(z=2e-3), acceleration(z=5e-3)
    thrusts = np.tile(np.arange(6) < 3, 4)
    most = DESIGN.resting_thrust
    moving, resting = (allocated(0.0, fast, at_rest=rests) for rests in (0.0, 1.0))
    assert np.abs(moving[:24][thrusts]).max() > 1.5 * most
    assert np.abs(resting[:24][thrusts]).max() == pytest.approx(most, rel=1e-9)
    held = allocated(slow, fast, at_rest=1.0)
    alone = allocated(slow)
    both = np.abs([held, alone])[:, :24][:, thrusts]
    assert both[1].max() > 5 * most
    assert (both[0] <= np.maximum(most, both[1]) * (1 + 1e-4)).all()
    # Pushed along z and back by the thrusters of all bases alike: torques of the bases add no force.
    assert np.sign(P @ resting)[2] == np.sign(P @ moving)[2] == 1.0


def test_limits_above_zero():
    with pytest.raises(ParameterError, match="limits"):
        MeanAxesAllocation(DYNAMICS, 0.0 * LIMITS, DESIGN)


def test_weak_drives_are_no_limp_ones():
    """A torque of a sixth of the limit is had from drives of half their strength, and none of dead ones."""
    wanted = np.linalg.solve(G, 0.05 * np.eye(RIGID)[6])
    weak, dead = np.ones(len(LIMITS)), np.ones(len(LIMITS))
    weak[24:31], dead[24:31] = 0.5, 0.0
    full = allocated(wanted)
    assert_near(allocated(wanted, effectiveness=weak), full, 1e-6)
    assert_array_equal(allocated(wanted, effectiveness=dead)[24:31], 0.0)


def test_limp_arms_swing_and_all_know_it():
    """What is asked of the joints of a dead robot changes no command; the rest is met as its arm swings."""
    alive = np.ones(len(LIMITS))
    alive[6:12] = alive[31:38] = 0.0
    limp = (np.arange(RIGID) >= 13) & (np.arange(RIGID) < 20)
    wanted = acceleration(y=2e-3)
    kept = allocated(wanted, effectiveness=alive)
    asked = allocated(wanted + 0.1 * limp, effectiveness=alive)
    assert_array_equal(kept[alive == 0.0], 0.0)
    assert_near(asked, kept, 1e-9)
    errors = np.linalg.solve(G, P @ kept) - wanted
    assert_near(errors[~limp], 0.0, 0.01 * 2e-3)
    assert np.abs(errors[limp]).max() > 2e-3
