"""The whole finite-element truss with the robots as rigid masses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from trussflow.models import ModelError, RobotArm, TrussDynamics
from trussflow.models.geometry.spatial import SpatialInertia
from trussflow.models.modal_analysis import (
    RigidRobot,
    Support,
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
SUPPORTS: tuple[Support, ...] = ("free", "clamped")
over_supports = pytest.mark.parametrize("support", SUPPORTS)


@pytest.fixture(scope="module")
def bodies(robots, angles, grasps):
    return rigid_robots(robots, angles, grasps)


def scaled(bodies, factor):
    """Return rigid robots of another density."""
    return tuple(
        RigidRobot(node, SpatialInertia(*(factor * value for value in inertia))) for node, inertia in bodies
    )


def test_stiffness_leaves_rigid_motions_free(small):
    """Symmetric, semidefinite, with the six rigid motions as its null space and no other."""
    stiffness = stiffness_matrix(small).toarray()
    positions, _ = small.point_masses()
    scale = np.max(np.abs(stiffness))
    assert np.max(np.abs(stiffness - stiffness.T)) < 1e-14 * scale
    turns = np.cross(np.eye(3), positions[:, None, :]).transpose(0, 2, 1)
    carried = np.broadcast_to(np.eye(3), turns.shape)
    motions = np.block([[carried, turns], [np.zeros_like(carried), carried]]).reshape(-1, 6)
    assert np.max(np.abs(stiffness @ motions)) < 1e-12 * scale
    values = np.linalg.eigvalsh(stiffness)
    assert np.max(np.abs(values[:6])) < 1e-13 * scale
    assert values[6] > 1e-10 * scale


@pytest.mark.parametrize("arm", [RobotArm.jaco(), RobotArm.literal()], ids=["jaco", "literal"])
def test_composite_inertia_is_that_of_the_bodies(arm, angles):
    """Hand, links and base placed one after the other, each moved by the parallel-axis rule."""
    rotation, place = arm.hand_rotation, np.zeros(3)
    bodies = [(arm.masses[0], arm.static_moments[0], arm.inertias[0], rotation, place)]
    for j in range(arm.joints):
        place = place + rotation @ arm.joint_origins[j]
        turn = Rotation.from_rotvec([0.0, 0.0, angles[j]]).as_matrix()
        rotation = rotation @ arm.joint_rotations[j] @ turn
        link = (arm.masses[j + 1], arm.static_moments[j + 1], arm.inertias[j + 1])
        bodies.append((*link, rotation, place))
    place = place + rotation @ (arm.base_origin + arm.base_rotation @ arm.base_centroid)
    base = (arm.base_mass, np.zeros(3), arm.base_inertia)
    bodies.append((*base, rotation @ arm.base_rotation, place))

    ((node, found),) = rigid_robots([arm], angles[:7], [5])
    moment, second = np.zeros(3), np.zeros((3, 3))
    for m, s, inertia, turn, origin in bodies:
        # The integral of r r^T, from which the inertia follows, is easy to move.
        own = turn @ (np.trace(inertia) / 2 * np.eye(3) - inertia) @ turn.T
        mixed = np.outer(turn @ s, origin)
        second += own + mixed + mixed.T + m * np.outer(origin, origin)
        moment += turn @ s + m * origin
    assert node == 5
    assert found.mass == pytest.approx(arm.mass, rel=1e-14)
    assert np.allclose(found.static_moment, moment, rtol=0, atol=1e-12)
    assert np.allclose(found.inertia, np.trace(second) * np.eye(3) - second, rtol=0, atol=1e-12)


def test_clamped_truss_alone_has_pynite_s_frequencies(small, points):
    expected = small.modes(12, points).frequencies
    for solve in (direct_modes, all_modes_limit):
        found = solve(small, (), "clamped", 12)
        assert np.allclose(found.frequencies, expected, rtol=SAME_MODEL, atol=0), solve.__name__


@over_supports
def test_a_point_mass_is_one_more_point_mass_to_pynite(small, support):
    """A robot without extent or inertia, against Pynite's own mass matrix and modes."""

    class Heavier(TrussFrame):
        def point_masses(self):
            positions, masses = TrussFrame.point_masses(self)
            masses[9] += 20.0
            return positions, masses

    names = small.__dataclass_fields__
    heavier = Heavier(**{name: getattr(small, name) for name in names})
    point = RigidRobot(9, SpatialInertia(20.0, np.zeros(3), np.zeros((3, 3))))
    found = direct_modes(small, (point,), support, 8)
    same = direct_modes(heavier, (), support, 8)
    assert np.allclose(found.frequencies, same.frequencies, rtol=ROUND_OFF, atol=0)
    if support == "clamped":
        expected = np.sort(eigenmodes(heavier, 8)[0])
        assert np.allclose(found.frequencies, expected, rtol=SAME_MODEL, atol=0)


def test_free_modes_agree_with_a_dense_solver(small, bodies):
    """Flexible face: plain dense matrices of all freedoms, with tiny masses in the rotations."""
    positions, masses = small.point_masses()
    stiffness = stiffness_matrix(small).toarray()
    mass = np.kron(np.diag(masses), np.diag([1.0, 1.0, 1.0, 1e-7, 1e-7, 1e-7]))
    for node, body in bodies:
        cross = np.cross(np.eye(3), body.static_moment)
        at = slice(6 * node, 6 * node + 6)
        mass[at, at] += np.block([[body.mass * np.eye(3), cross.T], [cross, body.inertia]])
    inverse, _ = eigh(mass, stiffness + mass)
    dense = np.sqrt(np.abs(1.0 / inverse[::-1][:14] - 1.0)) / (2 * np.pi)
    found = direct_modes(small, bodies, "free", 8, flexible_face=True)
    assert np.allclose(found.frequencies, dense[6:], rtol=SAME_MODEL, atol=0)
    assert len(positions) == len(found.displacements)


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
def test_robots_without_mass_leave_the_truss_alone(small, bodies, support):
    alone = direct_modes(small, (), support, 8).frequencies
    light = direct_modes(small, scaled(bodies, 1e-9), support, 8).frequencies
    assert np.allclose(light, alone, rtol=1e-7, atol=0)
    limit = all_modes_limit(small, (), support, 8).frequencies
    assert np.allclose(limit, alone, rtol=ROUND_OFF, atol=0)


@over_supports
def test_heavier_robots_lower_every_frequency(small, bodies, support):
    light, heavy = (direct_modes(small, scaled(bodies, k), support, 8) for k in (1.0, 1.2))
    assert np.all(heavy.frequencies < light.frequencies)


def test_an_immense_body_on_the_root_face_clamps_it(small, bodies):
    """What is missing from the clamped frequencies falls as one over its mass."""
    clamped = direct_modes(small, bodies, "clamped", 3).frequencies
    missing = []
    for mass in (1e6, 1e8):
        anchor = RigidRobot(0, SpatialInertia(mass, np.zeros(3), mass * np.eye(3)))
        held = direct_modes(small, (*bodies, anchor), "free", 3).frequencies
        missing.append(held / clamped - 1.0)
    assert np.all(np.abs(missing[1]) < 1e-4)
    assert np.allclose(missing[0] / missing[1], 100.0, rtol=0.01, atol=0)


@over_supports
def test_the_modal_model_with_all_modes_reaches_its_limit(small, points, robots, angles, bodies, support):
    """83 of 84 modes; so T_i, R_i and the robots' inertia mean the same in both models."""
    modes = small.modes(83, points)
    system = TrussDynamics(modes=modes, arms=robots, elastic_integrals=True)
    found = locked_modes(system, support, angles)
    limit = all_modes_limit(small, bodies, support, 8)
    assert np.allclose(found.frequencies[:8], limit.frequencies, rtol=SAME_MODEL, atol=0)
    assert np.allclose(np.diag(modal_assurance(found, limit, modes.masses)), 1.0, rtol=0, atol=1e-6)
    alone = truss_alone_modes(modes, support).frequencies[:8]
    expected = direct_modes(small, (), support, 8).frequencies
    assert np.allclose(alone, expected, rtol=SAME_MODEL, atol=0)


@pytest.mark.slow
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
    assert np.allclose(found[0], found[1], rtol=5e-4, atol=0)


def test_refused(small, robots, angles):
    pinned: Any = "pinned"
    for solve in (direct_modes, all_modes_limit):
        with pytest.raises(ModelError, match="no support 'pinned'; choose from: free, clamped"):
            solve(small, (), pinned, 3)
        for count in (0, 84):
            with pytest.raises(ModelError, match=f"cannot compute {count} modes of this mesh; ch"):
                solve(small, (), "free", count)
    with pytest.raises(ModelError, match="a clamped face is held and cannot be flexible"):
        direct_modes(small, (), "clamped", 3, flexible_face=True)
    point = SpatialInertia(1.0, np.zeros(3), np.zeros((3, 3)))
    for node in (-1, 32):
        with pytest.raises(ModelError, match=f"no mesh point {node} for a robot; the mesh has po"):
            direct_modes(small, (RigidRobot(node, point),), "free", 3)
    for nodes, joints in (([4], angles), ([4, 9], angles[:7])):
        with pytest.raises(ModelError, match="2 robots with 14 joints are given, but"):
            rigid_robots(robots, joints, nodes)
