"""The accurate plant: its frequencies against all finite elements, and its limit of fixed steps."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.models import RobotArm, SpaceTruss, TrussDynamics, reduced_modes
from trussflow.models.dynamics.locked_joints import locked_frequencies, locked_inertia
from trussflow.models.plant.space_truss import arm_by_name
from trussflow.models.truss.natural_frequencies import natural_frequencies
from trussflow.models.truss.paper_truss import (
    CLAMPED_FACE,
    paper_structure,
    printed_grasps,
)
from trussflow.models.truss.reduction import nearest

STEP = 1e-3  # s
RK4_LIMIT = 2.0 * np.sqrt(2.0)  # of angular frequency times step, undamped
over_arms = pytest.mark.parametrize("arm", ["literal", "jaco"])


def errors(truss, arm, angles):
    """Return the errors of the first ten free frequencies with the arms locked, of the FE's [1]."""
    structure = paper_structure()
    robot, postures = arm_by_name(arm), np.split(angles, 4)
    nodes = [nearest(structure.positions, grasp) for grasp in printed_grasps()]
    bodies = {
        n + 1: locked_inertia(robot, a) for n, a in zip(nodes, postures, strict=True)
    }
    exact = natural_frequencies(structure, 10, bodies, rigid=CLAMPED_FACE)
    return locked_frequencies(truss.dynamics, angles)[:10] / exact - 1.0


@over_arms
@pytest.mark.parametrize("bent", [False, True])
def test_ten_free_frequencies_are_those_of_all_finite_elements(arm, bent):
    """Within 0.12 %, of which the printed frequencies of the clamped truss are 0.1 %."""
    truss = SpaceTruss.accurate(arm=arm)
    angles = truss.dynamics.rest[6 : truss.rigid]
    if bent:
        angles = np.random.default_rng(1).uniform(-np.pi, np.pi, len(angles))
    assert_near(errors(truss, arm, angles), 0.0, 2e-3 if bent else 1.2e-3)


@over_arms
def test_condensed_shapes_leave_fixed_steps_a_margin(arm, rng):
    """The fastest vibration with the joints free, in any posture: 155 Hz, and 440 Hz uncondensed."""
    for highest, limit in ((100.0, 155.5), (np.inf, 440.0)):
        dynamics = SpaceTruss.accurate(arm=arm, highest_frequency=highest).dynamics
        first, frequencies = dynamics.rigid_coordinates, []
        root = np.sqrt(dynamics.modes.stiffness)
        for spread in (0.0, *(np.pi,) * 5):
            q = dynamics.rest
            q[6:first] += rng.uniform(-spread, spread, first - 6)
            flexible = np.linalg.inv(dynamics.evaluate(q).mass_matrix)[first:, first:]
            squares = np.linalg.eigvalsh(root[:, None] * flexible * root)
            frequencies.append(np.sqrt(squares[-1]) / (2 * np.pi))
        assert 0.7 * limit < max(frequencies) < limit
        if highest == 100.0:
            assert 2 * np.pi * max(frequencies) * STEP < 0.35 * RK4_LIMIT


def test_damping_is_that_of_the_consistent_plant():
    assert_array_equal(
        SpaceTruss.accurate().parameters["damping_ratio"], np.full(38, 0.005)
    )
    assert not np.any(SpaceTruss.accurate(damping=0.0).parameters["damping_ratio"])


def drifts(free_motion, truss, step):
    """Return the drifts of the free, undamped plant in 0.1 s, deformed and tumbling [1]."""
    rng = np.random.default_rng(3)
    q = truss.dynamics.rest
    q[3 : truss.rigid] += 0.3 * rng.standard_normal(truss.rigid - 3)
    v = np.zeros(truss.n)
    q[truss.rigid : truss.rigid + 6] = rng.standard_normal(6) / 20
    v[: truss.rigid + 6] = rng.standard_normal(truss.rigid + 6) / 30
    return free_motion(truss, 0.1, q, v, step=step).drifts


def test_a_robot_on_condensed_shapes_conserves_energy_and_momentum(free_motion):
    """RK4 at 1 ms. The energy drifts as RK4 damps the fastest vibrations."""
    modes = reduced_modes(
        paper_structure(),
        8,
        [printed_grasps()[1]],
        clamped=CLAMPED_FACE,
        highest_frequency=100.0,
    )
    dynamics = TrussDynamics(
        modes=modes, arms=(RobotArm.jaco(),), elastic_integrals=True
    )
    coarse, fine = (
        drifts(free_motion, SpaceTruss(dynamics), step) for step in (STEP, STEP / 2)
    )
    assert np.all(coarse < [1e-7, 1e-10, 1e-10])
    assert np.all(fine < coarse / [1, 16, 16])
