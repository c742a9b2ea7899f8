"""Systems that the tests of the physics share: the paper's, and random ones."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.models import Joint, RobotArm, TrussDynamics, TrussModes
from trussflow.models.geometry.rotation import fixed_rotation

# Joints of each robot (R turns, P slides), and number of modes.
ARRANGEMENTS = {
    "no robots": ((), 3),
    "three modules": (("", "", ""), 2),
    "two arms": (("RRRRRRR", "RPR"), 3),
    "slider": (("PPP",), 0),
    "eight robots": (("RRRRRRR", "", "PPP", "R", "RR", "RRRPRR", "P", "RRRRRR"), 2),
}


@pytest.fixture(params=ARRANGEMENTS.values(), ids=ARRANGEMENTS)
def arrangement(request):
    return request.param


@pytest.fixture(scope="session")
def published(modes):
    return TrussDynamics(
        modes=modes, arms=(RobotArm.literal(),) * 4, elastic_integrals=False
    )


@pytest.fixture(scope="session")
def consistent(modes):
    return TrussDynamics(
        modes=modes, arms=(RobotArm.jaco(),) * 4, elastic_integrals=True
    )


@pytest.fixture
def random_system(rng):
    """Return a maker of random trusses with random arms: no symmetry, no zeros, no equal arms."""

    def make(joints, modes, *, elastic_integrals):
        return TrussDynamics(
            modes=random_modes(rng, modes, len(joints)),
            arms=tuple(random_arm(rng, n) for n in joints),
            elastic_integrals=elastic_integrals,
        )

    return make


def random_modes(rng, modes, grasps):
    """Return a random truss of 15 point masses with strongly deformed, orthonormal modes."""
    masses = rng.uniform(1.0, 3.0, 15)
    shapes = rng.standard_normal((15, 3, modes))
    overlap = np.einsum("n,nia,nib->ab", masses, shapes, shapes)
    shapes = shapes @ np.linalg.inv(np.linalg.cholesky(overlap)).T
    return TrussModes(
        positions=rng.standard_normal((15, 3)),
        masses=masses,
        shapes=shapes,
        frequencies=rng.uniform(0.1, 0.5, modes),
        damping_ratios=np.zeros(modes),
        grasp_positions=rng.standard_normal((grasps, 3)),
        grasp_translations=0.2 * rng.standard_normal((grasps, 3, modes)),
        grasp_rotations=0.2 * rng.standard_normal((grasps, 3, modes)),
        source="random numbers",
    )


def random_arm(rng, kinds):
    """Return an arm of random links, each with the inertia of a cloud of points.

    Its joints are a number of those that turn, or a letter for each: R turns, P slides.
    """
    letters = kinds if isinstance(kinds, str) else "R" * kinds
    joints = len(letters)
    rotations = np.array(
        [fixed_rotation(a) for a in rng.uniform(-3, 3, (joints + 2, 3))]
    )
    masses, moments, inertias = [], [], []
    for _ in range(joints + 2):
        points = 0.3 * rng.standard_normal((8, 3))
        masses.append(8.0)
        moments.append(points.sum(axis=0))
        inertias.append(np.sum(points**2) * np.eye(3) - points.T @ points)
    # The base's inertia is about its centroid.
    centre = moments[-1] / masses[-1]
    central = inertias[-1] - masses[-1] * (
        centre @ centre * np.eye(3) - np.outer(centre, centre)
    )
    return RobotArm(
        name="random",
        hand_rotation=rotations[0],
        joint_origins=0.5 * rng.standard_normal((joints, 3)),
        joint_rotations=rotations[1:-1],
        masses=np.array(masses[:-1]),
        static_moments=np.array(moments[:-1]),
        inertias=np.array(inertias[:-1]),
        base_origin=0.5 * rng.standard_normal(3),
        base_rotation=rotations[-1],
        base_centroid=0.5 * rng.standard_normal(3),
        base_mass=masses[-1],
        base_inertia=central,
        rest_angles=np.zeros(joints),
        joint_data=tuple(
            Joint(f"joint {j}", letter == "P") for j, letter in enumerate(letters)
        ),
    )


@pytest.fixture
def random_state(rng):
    """Return a maker of tumbling, deformed states: angles up to ±1.2 rad, rates of order 1."""

    def make(system):
        return rng.uniform(-1.2, 1.2, system.coordinates), rng.standard_normal(
            system.freedoms
        )

    return make


@pytest.fixture(scope="session")
def without_grasp_rotation(modes):
    return replace(modes, grasp_rotations=np.zeros_like(modes.grasp_rotations))
