"""Natural frequencies of finite elements with rigid bodies, and of the modal model with locked joints."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pynite_modes import pynite_modes
from scipy.linalg import eigh

from trussflow.models import ModelError, RobotArm, TrussDynamics, reduced_modes
from trussflow.models.dynamics.locked_joints import locked_frequencies, locked_inertia
from trussflow.models.truss.natural_frequencies import natural_frequencies
from trussflow.models.truss.paper_truss import paper_frame, paper_structure

# Pynite gives massless freedoms a tiny mass, which moves frequencies by about 1e-7.
SAME_MODEL = 1e-6
# Of eigenvalues, whose condition takes some digits.
ROUND_OFF = 1e-9
SMALL = {"first_arm_modules": 1, "second_arm_modules": 1, "elements_per_longeron": 2}
FACE, GRASPS = (1, 2, 3, 4), (5, 10)
ANGLES = np.array(
    [[0.3, 1.0, -0.5, 1.2, 0.4, -0.9, 0.2], [-0.7, 0.4, 1.1, -0.3, 0.8, 0.5, -1.2]]
)
SUPPORTS = {"free": {"rigid": FACE}, "clamped": {"clamped": FACE}}
over_supports = pytest.mark.parametrize("support", SUPPORTS)


@pytest.fixture(scope="module")
def small():
    """Return a truss of one module each way: 32 mesh points, 84 modes."""
    return paper_structure(**SMALL)


@pytest.fixture(scope="module")
def arms():
    return RobotArm.jaco(), RobotArm.literal()


@pytest.fixture(scope="module")
def bodies(arms):
    """Return two robots in bent postures at two corners, one of them at the far end."""
    return {
        node: locked_inertia(arm, a)
        for node, arm, a in zip(GRASPS, arms, ANGLES, strict=True)
    }


def test_clamped_truss_has_the_frequencies_of_pynite(small):
    """Alone, and with a body without extent, which Pynite gets as one more point mass."""
    mass = {10: np.diag([20.0, 20.0, 20.0, 0.0, 0.0, 0.0])}
    for point_masses, bodies in (((), None), ([(9, 20.0)], mass)):
        found = natural_frequencies(small, 8, bodies, clamped=FACE)
        assert_allclose(
            found,
            pynite_modes(paper_frame(**SMALL), 8, point_masses)[0],
            rtol=SAME_MODEL,
        )


def test_free_frequencies_agree_with_a_dense_solver(small, bodies):
    """Nothing rigid: plain dense matrices of all freedoms, with tiny masses in the rotations."""
    structure = small
    mass = structure.mass.toarray() + np.diag(
        np.tile([0, 0, 0, 1e-7, 1e-7, 1e-7], len(structure.nodes))
    )
    for node, body in bodies.items():
        rows = slice(6 * node - 6, 6 * node)
        mass[rows, rows] += body
    inverse = eigh(mass, structure.stiffness.toarray() + mass, eigvals_only=True)[::-1]
    dense = np.sqrt(1.0 / inverse[6:14] - 1.0) / (2 * np.pi)
    assert_allclose(natural_frequencies(structure, 8, bodies), dense, rtol=SAME_MODEL)


@over_supports
def test_modal_models_are_above_all_finite_elements_and_fall(
    small, arms, bodies, support
):
    """Rayleigh: constraints raise every frequency. Attachment shapes make the model exact, modes do not."""
    structure, clamped = small, support == "clamped"
    exact = natural_frequencies(structure, 6, bodies, **SUPPORTS[support])
    places = structure.positions[[node - 1 for node in GRASPS]]

    def errors(modes):
        dynamics = TrussDynamics(modes=modes, arms=arms, elastic_integrals=True)
        return (
            locked_frequencies(dynamics, np.ravel(ANGLES), clamped=clamped)[:6] / exact
            - 1.0
        )

    def modes(count, *, attachments=False):
        return reduced_modes(
            small, count, list(places), clamped=FACE, attachments=attachments
        )

    few, many = errors(modes(12)), errors(modes(83))
    shapes = errors(modes(60, attachments=True))
    assert np.all(few >= many - ROUND_OFF)
    assert np.all(many > -SAME_MODEL)
    assert many.max() > 1e-3
    assert -SAME_MODEL < shapes.min() <= shapes.max() < 1e-5
    if not clamped:
        assert np.all(
            natural_frequencies(structure, 6, bodies) < exact * (1.0 + ROUND_OFF)
        )


@pytest.mark.campaign
@over_supports
def test_the_mesh_is_fine_enough(support):
    """Halving the elements moves no frequency of the paper's truss with robots by 0.05 %."""
    arm, finer = RobotArm.jaco(), {"elements_per_longeron": 8, "elements_per_edge": 4}
    body = locked_inertia(arm, arm.rest_angles)
    corners = range(20, 24)
    found = [
        natural_frequencies(
            paper_structure(**mesh),
            6,
            dict.fromkeys(corners, body),
            **SUPPORTS[support],
        )
        for mesh in ({}, finer)
    ]
    assert_allclose(found[0], found[1], rtol=5e-4)


def test_locked_frequencies_depend_on_the_posture_of_the_robots_alone(consistent, rng):
    angles = rng.uniform(-2.0, 2.0, 28)
    first, turned = (
        locked_frequencies(consistent, a) for a in (angles, angles + 2 * np.pi)
    )
    assert_allclose(first, turned, rtol=ROUND_OFF)
    rest = np.concatenate([arm.rest_angles for arm in consistent.arms])
    assert_allclose(
        locked_frequencies(consistent),
        locked_frequencies(consistent, rest),
        rtol=ROUND_OFF,
    )
    rigid = consistent.without_modes()
    with pytest.raises(ModelError, match="a truss without modes is rigid"):
        locked_frequencies(rigid)
    for wrong in (
        lambda: locked_frequencies(consistent, angles[:3]),
        lambda: locked_inertia(consistent.arms[0], [0]),
    ):
        with pytest.raises(ModelError, match="joint_angles has shape"):
            wrong()


@pytest.mark.parametrize(
    "count, options, message",
    [
        (0, {}, "cannot compute 0 natural frequencies of .*; choose 1 to 89"),
        (90, {}, "cannot compute 90 natural frequencies"),
        (84, {"clamped": FACE}, "choose 1 to 83"),
        (3, {"bodies": {33: np.eye(6)}}, "node 33 does not exist in .* 1 to 32"),
        (3, {"clamped": [0]}, "node 0 does not exist"),
    ],
)
def test_frequencies_that_there_are_not(small, count, options, message):
    with pytest.raises(ModelError, match=message):
        natural_frequencies(small, count, **options)
