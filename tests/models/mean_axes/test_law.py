"""Detection of a path at rest by the mean-axes law."""

import numpy as np
import pytest
from systems import respond

from trussflow.models import MeanAxesDesign, MeanAxesLaw, SpaceTruss

DYNAMICS = SpaceTruss.consistent().dynamics
DESIGN = MeanAxesDesign.shipped()
LAW = MeanAxesLaw(DYNAMICS, DESIGN)
NEAR, FAR = 0.9 * DESIGN.resting_error, 1.1 * DESIGN.resting_error


def at_rest(error=0.0, **changed):
    """Return the signal `at_rest` at a position error, at rest in all other inputs but the changed ones."""
    rest = DYNAMICS.rest[: DYNAMICS.rigid_coordinates]
    joints = rest[-DYNAMICS.joints :]
    return respond(
        LAW,
        reference_position=rest,
        mean_position=rest + error,
        joint_angles=joints,
        **changed,
    )["at_rest"]


def along(k, value, length=DYNAMICS.rigid_coordinates):
    return np.where(np.arange(length) == k, value, 0.0)


@pytest.mark.parametrize("k", range(6))
def test_at_rest_is_close_in_position_and_attitude(k):
    assert at_rest(along(k, NEAR)) == 1.0
    assert at_rest(along(k, -FAR)) == 0.0


def test_arms_may_be_elsewhere_and_the_truss_may_move():
    assert (
        at_rest(along(8, 0.1), mean_speeds=along(0, 1.0, DYNAMICS.rigid_freedoms))
        == 1.0
    )


@pytest.mark.parametrize("moving", ["reference_velocity", "reference_acceleration"])
def test_a_path_that_moves_does_not_rest(moving):
    assert at_rest(**{moving: along(3, 1e-9, DYNAMICS.rigid_freedoms)}) == 0.0
