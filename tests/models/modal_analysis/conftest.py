"""What the tests of the modal analysis share: a small truss, two robots in bent postures."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from trussflow.models import RobotArm, SpaceTruss
from trussflow.models.modal_analysis import HeldTruss
from trussflow.models.truss.truss_fe import TrussFrame

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)
ANGLES = np.array([0.3, 1.0, -0.5, 1.2, 0.4, -0.9, 0.2, -0.7, 0.4, 1.1, -0.3, 0.8, 0.5, -1.2])


@pytest.fixture(scope="session")
def small():
    """Return a truss of one module each way: 32 mesh points, 84 modes."""
    return replace(
        TrussFrame.reconstructed(), first_arm_modules=1, second_arm_modules=1, elements_per_longeron=2
    )


@pytest.fixture(scope="session")
def grasps():
    """Return mesh points of the small truss: two corners, one at the far end."""
    return [4, 9]


@pytest.fixture(scope="session")
def points(small, grasps):
    return small.point_masses()[0][grasps]


@pytest.fixture(scope="session")
def robots():
    return (RobotArm.jaco(), RobotArm.literal())


@pytest.fixture(scope="session")
def angles():
    """Return joint angles of the two robots [rad]."""
    return ANGLES


@pytest.fixture(scope="session")
def published_loop():
    """Return the published truss, held at rest."""
    return HeldTruss(SpaceTruss.published())


@pytest.fixture(scope="session")
def neutral_loop():
    """Return the consistent truss, held at rest by feedback without work on the modes."""
    return HeldTruss(SpaceTruss.consistent())
