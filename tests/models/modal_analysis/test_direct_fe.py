"""The whole finite-element truss with the robots as rigid masses."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from trussflow.models import ModelError, RobotArm, TrussDynamics
from trussflow.models.geometry.spatial import SpatialInertia
from trussflow.models.modal_analysis import (
    RigidRobot,
    all_modes_limit,
    direct_modes,
    locked_modes,
    modal_assurance,
    rigid_robots,
    truss_alone_modes,
)
from trussflow.models.truss.frame_analysis import eigenmodes
from trussflow.models.truss.stiffness import stiffness_matrix
from trussflow.models.truss.truss_fe import TrussFrame

# Pynite gives massless freedoms a tiny mass, which moves frequencies by about 1e-7.
SAME_MODEL = 1e-6
# Of eigenvalues, whose condition takes some digits.
ROUND_OFF = 1e-9
over_supports = pytest.mark.parametrize("support", ["free", "clamped"])


@pytest.fixture(scope="module")
def bodies(robots, angles, grasps):
    return rigid_robots(robots, angles, grasps)


def test_stiffness_leaves_rigid_motions_free(small):
    """Symmetric, semidefinite, with the six rigid motions as its null space and no other."""
    stiffness = stiffness_matrix(small).toarray()
    positions, _ = small.point_masses()
    scale = np.max(np.abs(stiffness))
    assert np.abs(stiffness - stiffness.T).max() < 1e-14 * scale
    turns = np.cross(np.eye(3), positions[:, None, :]).transpose(0, 2, 1)
    carried = np.broadcast_to(np.eye(3), turns.shape)
    motions = np.block([[carried, turns], [np.zeros_like(carried), carried]]).reshape(-1, 6)
    assert np.max(np.abs(stiffness @ motions)) < 1e-12 * scale
    values = np.linalg.eigvalsh(stiffness)
    assert np.max(np.abs(values[:6])) < 1e-13 * scale
    assert values[6] > 1e-10 * scale


def test_clamped_truss_alone_has_pynite_s_frequencies(small, points):
    expected = small.modes(12, points).frequencies
    for solve in (direct_modes, all_modes_limit):
        found = solve(small, (), "clamped", 12)
        assert_allclose(found.frequencies, expected, rtol=SAME_MODEL)


@over_supports
def test_a_point_mass_is_one_more_point_mass_to_pynite(small, support):
    """A robot without extent or inertia, against Pynite's own mass matrix and modes."""

    class Heavier(TrussFrame):
        def point_masses(self):
            positions, masses = TrussFrame.point_masses(self)
            masses[9] += 20.0
            return positions, masses

    heavier = Heavier(**asdict(small))
    point = RigidRobot(9, SpatialInertia(20.0, np.zeros(3), np.zeros((3, 3))))
    found = direct_modes(small, (point,), support, 8)
    same = direct_modes(heavier, (), support, 8)
    assert_allclose(found.frequencies, same.frequencies, rtol=ROUND_OFF)
    if support == "clamped":
        expected = np.sort(eigenmodes(heavier, 8)[0])
        assert_allclose(found.frequencies, expected, rtol=SAME_MODEL)


def test_free_modes_agree_with_a_dense_solver(small, bodies):
    """Flexible face: plain dense matrices of all freedoms, with tiny masses in the rotations."""
    _, masses = small.point_masses()
    stiffness = stiffness_matrix(small).toarray()
    mass = np.kron(np.diag(masses), np.diag([1.0, 1.0, 1.0, 1e-7, 1e-7, 1e-7]))
    for node, body in bodies:
        cross = np.cross(np.eye(3), body.static_moment)
        at = slice(6 * node, 6 * node + 6)
        mass[at, at] += np.block([[body.mass * np.eye(3), cross.T], [cross, body.inertia]])
    inverse, _ = eigh(mass, stiffness + mass)
    dense = np.sqrt(np.abs(1.0 / inverse[::-1][:14] - 1.0)) / (2 * np.pi)
    found = direct_modes(small, bodies, "free", 8, flexible_face=True)
    assert_allclose(found.frequencies, dense[6:], rtol=SAME_MODEL)


@pytest.mark.parametrize("flexible_face", [False, True])
def test_rigid_body_modes_are_zero(small, bodies, *, flexible_face):
    found = direct_modes(small, bodies, "free", 4, flexible_face=flexible_face)
    assert found.rigid_body_frequencies.shape == (6,)
    # Round-off is in the squares.
    assert np.max(found.rigid_body_frequencies) ** 2 < 1e-9 * found.frequencies[0] ** 2


@over_supports
def test_each_constraint_raises_every_frequency(small, bodies, support):
    """Rayleigh: flexible face, rigid face, rotations of the truss alone; clamped above free."""
    direct = direct_modes(small, bodies, support, 10).frequencies
    limit = all_modes_limit(small, bodies, support, 10).frequencies
    assert np.all(limit >= direct * (1.0 - ROUND_OFF))
    assert np.max(limit / direct) > 1.001
    if support == "free":
        flexible = direct_modes(small, bodies, "free", 10, flexible_face=True).frequencies
        assert np.all(direct >= flexible * (1.0 - ROUND_OFF))
        assert np.max(direct / flexible) > 1.001


@over_supports
def test_the_modal_model_with_all_modes_reaches_its_limit(small, points, robots, angles, bodies, support):
    """83 of 84 modes; so T_i, R_i and the robots' inertia mean the same in both models."""
    modes = small.modes(83, points)
    system = TrussDynamics(modes=modes, arms=robots, elastic_integrals=True)
    found = locked_modes(system, support, angles)
    limit = all_modes_limit(small, bodies, support, 8)
    assert_allclose(found.frequencies[:8], limit.frequencies, rtol=SAME_MODEL)
    assert_allclose(np.diag(modal_assurance(found, limit, modes.masses)), 1.0, rtol=0, atol=1e-6)
    alone = truss_alone_modes(modes, support).frequencies[:8]
    expected = direct_modes(small, (), support, 8).frequencies
    assert_allclose(alone, expected, rtol=SAME_MODEL)


@pytest.mark.campaign
@over_supports
def test_the_mesh_is_fine_enough(support, modes):
    """Halving the elements moves no frequency of the paper's truss with robots by 0.05 %."""
    frame = TrussFrame.reconstructed()
    finer = replace(frame, elements_per_longeron=8, elements_per_edge=4)
    arm = RobotArm.jaco()
    found = []
    for mesh in (frame, finer):
        nodes = mesh.mesh_points(modes.grasp_positions)
        bodies = rigid_robots([arm] * 4, np.tile(arm.rest_angles, 4), nodes)
        found.append(direct_modes(mesh, bodies, support, 6).frequencies)
    assert_allclose(found[0], found[1], rtol=5e-4)


POINT = SpatialInertia(1.0, np.zeros(3), np.zeros((3, 3)))


@pytest.mark.parametrize("solve", [direct_modes, all_modes_limit])
@pytest.mark.parametrize(
    ("support", "count", "message"),
    [
        ("pinned", 3, "no support 'pinned'; choose from: free, clamped"),
        ("free", 0, "cannot compute 0 modes of this mesh; ch"),
        ("free", 84, "cannot compute 84 modes of this mesh; ch"),
    ],
)
def test_modes_that_there_are_not(small, solve, support, count, message):
    with pytest.raises(ModelError, match=message):
        solve(small, (), support, count)


@pytest.mark.parametrize("node", [-1, 32])
def test_mesh_points_that_there_are_not(small, node):
    with pytest.raises(ModelError, match=f"no mesh point {node} for a robot; the mesh has po"):
        direct_modes(small, (RigidRobot(node, POINT),), "free", 3)


def test_a_clamped_face_is_not_flexible(small):
    with pytest.raises(ModelError, match="a clamped face is held and cannot be flexible"):
        direct_modes(small, (), "clamped", 3, flexible_face=True)


@pytest.mark.parametrize(("nodes", "joints"), [([4], 14), ([4, 9], 7)])
def test_robots_without_place_or_angles(robots, angles, nodes, joints):
    with pytest.raises(ModelError, match="2 robots with 14 joints are given, but"):
        rigid_robots(robots, angles[:joints], nodes)
