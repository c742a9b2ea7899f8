"""Natural modes of the modal model with locked joints."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trussflow.blocks.framework.types import Vector
from trussflow.models import ModelError, TrussDynamics
from trussflow.models.geometry.spatial import inertia_matrix, moved_inertia
from trussflow.models.modal_analysis import (
    Support,
    locked_mass_matrix,
    locked_modes,
    modal_assurance,
    rigid_robots,
    truss_alone_modes,
)

# Of eigenvalues, and of shapes and momenta with digits lost in the file of modes.
ROUND_OFF = 1e-9
SUPPORTS: tuple[Support, ...] = ("free", "clamped")
over_supports = pytest.mark.parametrize("support", SUPPORTS)

RandomSystem = Callable[..., TrussDynamics]
RandomState = Callable[[TrussDynamics], tuple[Vector, Vector]]


@pytest.fixture
def angles(rng):
    """Return joint angles of the paper's four robots [rad]."""
    return rng.uniform(-2.0, 2.0, 28)


def test_rigid_body_modes_are_zero(consistent, angles):
    modes = locked_modes(consistent, "free", angles)
    assert modes.rigid_body_frequencies.shape == (6,)
    assert np.max(modes.rigid_body_frequencies) < 1e-6 * modes.frequencies[0]
    assert locked_modes(consistent, "clamped", angles).rigid_body_frequencies.shape == (0,)


def test_clamped_truss_alone_has_its_own_modes(modes):
    found = truss_alone_modes(modes, "clamped")
    assert np.allclose(found.frequencies, modes.frequencies, rtol=ROUND_OFF, atol=0)
    assert np.allclose(modal_assurance(found, found, modes.masses), np.eye(6), rtol=0, atol=ROUND_OFF)
    signs = np.sign(np.sum(found.displacements * modes.shapes, axis=(0, 1)))
    assert np.allclose(found.displacements, signs * modes.shapes, rtol=0, atol=ROUND_OFF)


def test_free_truss_alone_has_modes_without_momentum(modes):
    """Modal mass one, and no linear or angular momentum about any point."""
    found = truss_alone_modes(modes, "free")
    shapes, masses = found.displacements, modes.masses
    modal_mass = np.einsum("n,nia,nib->ab", masses, shapes, shapes)
    assert np.allclose(modal_mass, np.eye(6), rtol=0, atol=ROUND_OFF)
    momentum = np.einsum("n,nia->ia", masses, shapes)
    lever = modes.positions[:, :, None]
    angular = np.einsum("n,nia->ia", masses, np.cross(lever, shapes, axis=1))
    assert np.max(np.abs(momentum)) < ROUND_OFF * np.sqrt(modes.mass)
    assert np.max(np.abs(angular)) < ROUND_OFF * np.sqrt(np.trace(modes.inertia))


def test_frequencies_by_eliminating_the_motion_of_the_frame(consistent, angles):
    """A free body keeps its momentum, so the frame moves by -M_rr^-1 M_rf tau."""
    mass = locked_mass_matrix(consistent, angles)
    left = mass[6:, 6:] - mass[6:, :6] @ np.linalg.solve(mass[:6, :6], mass[:6, 6:])
    stiffness = np.diag(consistent.modes.stiffness)
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(left, stiffness)).real)
    found = locked_modes(consistent, "free", angles).frequencies
    assert np.allclose(found, np.sqrt(squares) / (2 * np.pi), rtol=ROUND_OFF, atol=0)


@over_supports
def test_pose_does_not_matter(consistent, angles, support):
    """Neither position nor attitude, nor whole turns of a joint."""
    q = consistent.rest
    q[:6] = [3.0, -20.0, 8.0, 1.1, -0.7, 2.4]
    q[6:34] = angles
    kept = np.r_[0:6, 34:40]
    expected = consistent.mass_matrix(q)[np.ix_(kept, kept)]
    turned = angles + 2 * np.pi * np.arange(-14, 14)
    assert np.allclose(locked_mass_matrix(consistent, turned), expected, rtol=ROUND_OFF, atol=1e-8)
    first, second = (locked_modes(consistent, support, a).frequencies for a in (angles, turned))
    assert np.allclose(first, second, rtol=ROUND_OFF, atol=0)


@over_supports
def test_truss_frame_does_not_matter(consistent, angles, support):
    """The same truss and robots, described in another frame fixed to the root face."""
    turn, origin = Rotation.from_rotvec([0.4, -1.0, 0.8]).as_matrix(), np.array([2.0, -1.0, 0.5])
    modes = consistent.modes
    moved = TrussDynamics(
        modes=replace(
            modes,
            positions=(modes.positions - origin) @ turn.T,
            shapes=turn @ modes.shapes,
            grasp_positions=(modes.grasp_positions - origin) @ turn.T,
            grasp_translations=turn @ modes.grasp_translations,
            grasp_rotations=turn @ modes.grasp_rotations,
        ),
        arms=tuple(replace(a, hand_rotation=turn @ a.hand_rotation) for a in consistent.arms),
        elastic_integrals=True,
    )
    expected = locked_modes(consistent, support, angles)
    found = locked_modes(moved, support, angles)
    assert np.allclose(found.frequencies, expected.frequencies, rtol=ROUND_OFF, atol=0)
    turned = np.abs(turn.T @ found.displacements)
    assert np.allclose(turned, np.abs(expected.displacements), rtol=0, atol=1e-8)


@over_supports
def test_published_and_exact_equations_agree_at_rest(consistent, angles, support):
    published = replace(consistent, elastic_integrals=False)
    first, second = (locked_modes(d, support, angles).frequencies for d in (consistent, published))
    assert np.allclose(first, second, rtol=ROUND_OFF, atol=0)


def test_rest_angles_are_the_default(consistent):
    rest = np.concatenate([arm.rest_angles for arm in consistent.arms])
    assert np.array_equal(locked_mass_matrix(consistent), locked_mass_matrix(consistent, rest))


def test_rigid_rows_hold_the_robots_as_rigid_bodies(random_system, random_state):
    """Mass, static moment and inertia: those of the truss, plus each locked robot moved to O_t."""
    system = random_system((3, 7), 4, elastic_integrals=True)
    angles = random_state(system)[0][6:16]
    truss = system.modes
    cross = np.cross(np.eye(3), truss.static_moment)
    expected = np.block([[truss.mass * np.eye(3), cross.T], [cross, truss.inertia]])
    for robot in rigid_robots(system.arms, angles, [0, 1]):
        place = truss.grasp_positions[robot.node]
        expected = expected + inertia_matrix(moved_inertia(robot.inertia, np.eye(3), place))
    found = locked_mass_matrix(system, angles)[:6, :6]
    assert np.allclose(found, expected, rtol=1e-11, atol=1e-10)


@pytest.mark.parametrize(
    ("support", "angles", "message"),
    [
        ("pinned", None, "no support 'pinned'; choose from: free, clamped"),
        ("free", np.zeros(7), r"joint_angles has shape \(7,\); it must be \(28,\)"),
    ],
)
def test_refused(consistent, support, angles, message):
    with pytest.raises(ModelError, match=message):
        locked_modes(consistent, support, angles)


def test_rigid_truss_is_refused(consistent):
    rigid = replace(consistent, modes=consistent.modes.rigid())
    with pytest.raises(ModelError, match="a truss without modes is rigid"):
        locked_modes(rigid, "free")
