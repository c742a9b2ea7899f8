"""Natural modes of the modal model with locked joints."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.models import ModelError
from trussflow.models.geometry.spatial import inertia_matrix, moved_inertia
from trussflow.models.modal_analysis import (
    locked_mass_matrix,
    locked_modes,
    modal_assurance,
    rigid_robots,
    truss_alone_modes,
)

# Of eigenvalues, and of shapes and momenta with digits lost in the file of modes.
ROUND_OFF = 1e-9
over_supports = pytest.mark.parametrize("support", ["free", "clamped"])


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
    assert_allclose(found.frequencies, modes.frequencies, rtol=ROUND_OFF)
    assert_allclose(modal_assurance(found, found, modes.masses), np.eye(6), rtol=0, atol=ROUND_OFF)
    signs = np.sign(np.sum(found.displacements * modes.shapes, axis=(0, 1)))
    assert_allclose(found.displacements, signs * modes.shapes, rtol=0, atol=ROUND_OFF)


def test_free_truss_alone_has_modes_without_momentum(modes):
    """Modal mass one, and no linear or angular momentum about any point."""
    found = truss_alone_modes(modes, "free")
    shapes, masses = found.displacements, modes.masses
    modal_mass = np.einsum("n,nia,nib->ab", masses, shapes, shapes)
    assert_allclose(modal_mass, np.eye(6), rtol=0, atol=ROUND_OFF)
    momentum = np.einsum("n,nia->ia", masses, shapes)
    lever = modes.positions[:, :, None]
    angular = np.einsum("n,nia->ia", masses, np.cross(lever, shapes, axis=1))
    assert np.max(np.abs(momentum)) < ROUND_OFF * np.sqrt(modes.mass)
    assert np.max(np.abs(angular)) < ROUND_OFF * np.sqrt(np.trace(modes.inertia))


@over_supports
def test_pose_does_not_matter(consistent, angles, support):
    """Neither position nor attitude, nor whole turns of a joint."""
    q = consistent.rest
    q[:6] = [3.0, -20.0, 8.0, 1.1, -0.7, 2.4]
    q[6:34] = angles
    kept = np.r_[0:6, 34:40]
    expected = consistent.mass_matrix(q)[np.ix_(kept, kept)]
    turned = angles + 2 * np.pi * np.arange(-14, 14)
    assert_allclose(locked_mass_matrix(consistent, turned), expected, rtol=ROUND_OFF, atol=1e-8)
    first, second = (locked_modes(consistent, support, a).frequencies for a in (angles, turned))
    assert_allclose(first, second, rtol=ROUND_OFF)


def test_rest_angles_are_the_default(consistent):
    rest = np.concatenate([arm.rest_angles for arm in consistent.arms])
    assert_array_equal(locked_mass_matrix(consistent), locked_mass_matrix(consistent, rest))


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
    assert_allclose(found, expected, rtol=1e-11, atol=1e-10)


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
