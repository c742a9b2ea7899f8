"""Modes of any structure against exact frequencies, against all of its flexibility, and against itself."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import assert_near

from trussflow.models import (
    Frame,
    FrameMember,
    ModelError,
    Rigidity,
    RobotArm,
    Structure,
    TrussDynamics,
    reduced_modes,
)
from trussflow.models.dynamics.locked_joints import locked_frequencies
from trussflow.models.truss import reduction
from trussflow.models.truss.frame import meshed
from trussflow.models.truss.stiffness import assembled_stiffness

# Of solutions with a stiffness whose condition takes some digits.
ROUND_OFF = 1e-9
TETRAHEDRON = np.array(
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
)


def beam(elements):
    """Return a beam of unit length, mass and bending stiffness, twice that in the other plane."""
    positions, [chain], [lengths] = meshed(
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), [(0, 1, elements)]
    )
    rod = Rigidity(1e6, np.diag([0.0, 2.0, 1.0]), 1e3)
    masses = np.zeros(len(positions))
    masses[chain] = lengths
    # A little inertia about the axis, or it would not be a body.
    blocks = np.outer(masses, [1.0, 1.0, 1.0, 2e-11, 1e-11, 1e-11]).ravel()
    ends = list(pairwise(chain))
    stiffness = assembled_stiffness(positions, ends, [rod] * elements)
    return Structure.from_matrices(
        np.diag(blocks), stiffness, positions, units=("m", "kg", "s")
    )


def pinned(positions):
    """Return hinged bars between all nodes, of unit stiffness, and unit mass per node."""
    pairs = [(i, j) for i in range(len(positions)) for j in range(i)]
    lengths = [float(np.linalg.norm(positions[i] - positions[j])) for i, j in pairs]
    share = 2.0 / (len(positions) - 1)
    members = [
        FrameMember(
            i + 1, j + 1, 1, Rigidity(length, np.zeros((3, 3)), 0.0), share / length
        )
        for (i, j), length in zip(pairs, lengths, strict=True)
    ]
    return Frame(positions=positions, members=tuple(members)).structure()


@pytest.fixture(scope="module")
def frame():
    """Return a crooked frame without any symmetry."""
    rng = np.random.default_rng(4)
    positions = np.array(
        [
            [0.0, 0, 0],
            [1, 0, 0.2],
            [1.2, 1, 0],
            [0, 1.1, 0.5],
            [0.5, 0.4, 1.3],
            [2.0, 0.3, 1.0],
        ]
    )
    pairs = [
        (1, 2),
        (2, 3),
        (3, 4),
        (4, 1),
        (1, 5),
        (2, 5),
        (3, 5),
        (4, 5),
        (5, 6),
        (2, 6),
    ]
    members = [
        FrameMember(
            a,
            b,
            2,
            Rigidity(1e6, np.diag(rng.uniform(50.0, 90.0, 3)), 40.0),
            rng.uniform(1.0, 2.0),
        )
        for a, b in pairs
    ]
    return Frame(positions=positions, members=tuple(members)).structure()


def test_free_beam_converges_to_euler_and_bernoulli():
    """The first four of a free beam, two in each plane; halving the elements takes a sixteenth."""
    roots = np.array([4.730040744862704, 7.853204624095838])
    exact = np.sort(np.outer([1.0, np.sqrt(2.0)], roots**2).ravel()) / (2.0 * np.pi)
    meshes = np.array([48, 60, 72, 84, 96])
    errors = [
        np.abs(reduced_modes(beam(n), 4, []).frequencies[:4] / exact - 1.0)
        for n in meshes
    ]
    slopes = np.diff(np.log(errors), axis=0) / np.diff(np.log(meshes))[:, None]
    assert np.all(np.abs(slopes + 4.0) < 0.1), slopes
    assert np.max(errors[-1]) < 1e-6


def test_tetrahedron_of_bars_is_the_molecule():
    """Of four equal masses and six springs: k/m twice, 2 k/m three times, 4 k/m (spectroscopy's X4)."""
    modes = reduced_modes(pinned(TETRAHEDRON), 5, [])
    assert modes.stiffness == pytest.approx([1.0, 1.0, 2.0, 2.0, 2.0], rel=ROUND_OFF)


def test_a_rigid_body_is_a_structure_without_modes(frame):
    """Nothing to keep, and no grasp to pull; or grasps where it is clamped only."""
    for grasps, clamped in (([], ()), ([1, 4], (1, 4))):
        body = reduced_modes(frame, 0, grasps, clamped=clamped)
        assert (body.modes, body.grasps) == (0, len(grasps))
        assert body.mass == pytest.approx(frame.rigid_mass[0, 0], rel=ROUND_OFF)


@pytest.mark.parametrize("clamped", [(), (1, 4)])
@pytest.mark.parametrize("number", [0, 7])
@pytest.mark.parametrize("highest", [np.inf, 50.0])
def test_deflection_under_loads_on_the_grasps_is_exact(frame, clamped, number, highest):
    """Of a floating body: what it gives way beyond the rigid motion that the load makes of it.

    The number of modes does not matter, and neither does the condensation above a frequency [Hz].
    """
    grasps = [6, {2, 3, 5}, (1.2, 1.0, 0.0)]
    modes = reduced_modes(
        frame, number, grasps, clamped=clamped, highest_frequency=highest
    )
    shapes = np.hstack([modes.grasp_translations, modes.grasp_rotations]).reshape(
        18, -1
    )
    free = np.flatnonzero(~np.isin(frame.nodes, clamped).repeat(6))
    stiffness, rigid = (
        frame.stiffness.toarray()[np.ix_(free, free)],
        frame.rigid_motions(np.zeros(3))[free],
    )
    mass = frame.mass.toarray()[np.ix_(free, free)]
    if clamped:
        flexibility = np.linalg.inv(stiffness)
    else:
        balanced = np.eye(len(free)) - mass @ rigid @ np.linalg.solve(
            rigid.T @ mass @ rigid, rigid.T
        )
        flexibility = (
            balanced.T @ np.linalg.pinv(stiffness, 1e-12, hermitian=True) @ balanced
        )
    motions = np.vstack([reduction._interface(frame, g).motion for g in grasps])[
        :, free
    ]
    exact = motions @ flexibility @ motions.T
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (
        np.max(np.abs(shapes / modes.stiffness @ shapes.T - exact) / scale)
        < 10 * ROUND_OFF
    )


def test_a_set_of_nodes_moves_as_a_rigid_face_does(frame):
    place = reduction._interface(frame, {1, 2, 3, 4})
    assert_near(place.position, frame.positions[:4].mean(axis=0), 1e-15)
    found = place.motion @ frame.rigid_motions(place.position)
    assert_near(found, np.eye(6), 1e-12)


def test_shapes_of_a_floating_body_carry_no_momentum(frame):
    modes = reduced_modes(frame, 5, [6, 1])
    scale = np.sqrt(modes.mass)
    assert_near(modes.momentum_coefficients, 0.0, ROUND_OFF * scale)
    angular = np.einsum(
        "n,nia->ia",
        modes.masses,
        np.cross(modes.positions[:, :, None], modes.shapes, axis=1),
    )
    assert_near(angular, 0.0, ROUND_OFF * scale)
    assert_near(modes.modal_mass, np.eye(modes.modes), 1e-12)


def test_the_choice_of_the_body_s_frame_is_no_physics(frame):
    """Robots on a body whose frame floats, or is held at some nodes: one and the same system."""
    arms = (RobotArm.literal(),) * 2
    floating, held = (
        locked_frequencies(
            TrussDynamics(
                modes=reduced_modes(frame, 24, [6, 1], clamped=clamped),
                arms=arms,
                elastic_integrals=True,
            )
        )[:5]
        for clamped in ((), (3,))
    )
    assert_allclose(floating, held, rtol=2e-4)


def test_iteration_gives_what_the_dense_solution_gives(frame, monkeypatch):
    dense = reduced_modes(frame, 8, [6])
    monkeypatch.setattr(reduction, "_MAX_DENSE_POINTS", 0)
    found = reduced_modes(frame, 8, [6])
    assert_allclose(found.frequencies, dense.frequencies, rtol=ROUND_OFF)
    assert_near(found.shapes, dense.shapes, 1e-7)


ERROR_CASES = [
    (
        {"grasps": [99]},
        "node 99 does not exist in frame; its 6 nodes have the numbers 1 to 6",
    ),
    (
        {"grasps": [(9.0, 0.0, 0.0)]},
        r"no mesh point at grasp point \[9.0, 0.0, 0.0\] m: the nearest is",
    ),
    ({"grasps": [(0.0, 0.0)]}, r"grasp point has shape \(2,\)"),
    ({"grasps": [{1, 2}]}, r"grasp at nodes \[1, 2\]: they do not define its rotation"),
    (
        {"number_of_modes": -1},
        "cannot compute -1 modes and 6 attachment shapes of frame: its mass has 42 el",
    ),
    (
        {"structure": pinned(TETRAHEDRON), "grasps": [2]},
        r"nodes \[2\]: they do not define its rotation",
    ),
    ({"highest_frequency": 1.0}, "highest_frequency is 1.0 Hz, but mode 2 has"),
]


@pytest.mark.parametrize("options, message", ERROR_CASES)
def test_errors(frame, options, message):
    with pytest.raises(ModelError, match=message):
        reduced_modes(
            **{"structure": frame, "number_of_modes": 2, "grasps": [6], **options}
        )


def test_mechanisms_are_found():
    """A cube of hinged bars without diagonals; two bodies in one file; a rod that spins about itself."""
    cube = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
    bars = [
        (i + 1, j + 1)
        for i in range(8)
        for j in range(i)
        if np.sum(np.abs(cube[i] - cube[j])) == 1.0
    ]
    stiff, hinged = Rigidity(1e3, np.eye(3), 1.0), Rigidity(1e3, np.zeros((3, 3)), 0.0)
    cases = {
        "hinges": [FrameMember(a, b, 1, hinged, 1.0) for a, b in bars],
        "two bodies": [
            FrameMember(a, b, 2, stiff, 1.0) for a, b in ((1, 2), (2, 4), (5, 6))
        ],
        "no twist": [FrameMember(1, 2, 2, stiff._replace(twisting=0.0), 1.0)],
    }
    for name, members in cases.items():
        body = Frame(positions=cube, members=tuple(members), source=name).structure()
        with pytest.raises(
            ModelError, match=f"{name} is a mechanism, has unconnected parts, or no"
        ):
            reduced_modes(body, 1, [])
