"""When the law tells that the path rests and is close."""

import numpy as np
import pytest

from trussflow.blocks import Constant, Diagram, simulate
from trussflow.models import MeanAxesDesign, MeanAxesLaw, SpaceTruss

DYNAMICS = SpaceTruss.consistent().dynamics
DESIGN = MeanAxesDesign.shipped()
NEAR, FAR = 0.9 * DESIGN.resting_error, 1.1 * DESIGN.resting_error


def at_rest(**changed):
    """Return what is told at rest where the path is, except for what is changed."""
    diagram = Diagram("d")
    law = diagram.add(law=MeanAxesLaw(DYNAMICS, DESIGN))
    rest = DYNAMICS.rest[: DYNAMICS.rigid_coordinates]
    given = {"reference_position": rest, "mean_position": rest, "joint_angles": rest[-DYNAMICS.joints :]}
    for port in law.inputs():
        value = changed.get(port.name, 0.0) + np.asarray(given.get(port.name, np.zeros(port.shape)))
        diagram.add(**{f"of_{port.name}": Constant(value)}).y >> port
    run = simulate(diagram, 0.02, step=0.02, log=[law.at_rest], backend="interpreted", progress=False)
    return float(run["law.at_rest"].values[-1])


def along(k, value, length=DYNAMICS.rigid_coordinates):
    return np.where(np.arange(length) == k, value, 0.0)


@pytest.mark.parametrize("k", range(6))
def test_at_rest_is_close_in_position_and_attitude(k):
    assert at_rest(mean_position=along(k, NEAR)) == 1.0
    assert at_rest(mean_position=along(k, -FAR)) == 0.0


def test_arms_may_be_elsewhere_and_the_truss_may_move():
    assert at_rest(mean_position=along(8, 0.1), mean_speeds=along(0, 1.0, DYNAMICS.rigid_freedoms)) == 1.0


@pytest.mark.parametrize("moving", ["reference_velocity", "reference_acceleration"])
def test_a_path_that_moves_does_not_rest(moving):
    assert at_rest(**{moving: along(3, 1e-9, DYNAMICS.rigid_freedoms)}) == 0.0
