"""Structures from matrices: units, axes, freedoms, point masses, files, and errors."""

import numpy as np
import pytest
from scipy.io import mmwrite
from scipy.linalg import block_diag
from scipy.sparse import coo_array, csc_array, csr_array, save_npz
from systems import relative_error

from trussflow.models import (
    Frame,
    FrameMass,
    FrameMember,
    ModelError,
    Rigidity,
    Structure,
    reduced_modes,
)
from trussflow.models.geometry.rotation import cross_matrix, fixed_rotation
from trussflow.models.geometry.spatial import (
    SpatialInertia,
    inertia_matrix,
    moved_inertia,
)

# Of sums over a few nodes.
ROUND_OFF = 1e-12
SI = ("m", "kg", "s")
POSITIONS = np.array(
    [[0.0, 0.1, 0.0], [1.0, 0.0, 0.3], [1.2, 1.0, 0.0], [0.1, 0.8, 1.0]]
)
MEMBERS = tuple(
    FrameMember(
        i + 1, j + 1, 1, Rigidity(1e6, np.diag([60.0, 70.0, 80.0]), 40.0), 1.0 + 0.1 * i
    )
    for i in range(4)
    for j in range(i)
)
BODY = FrameMass(2, 3.0, np.array([0.1, 0.2, -0.1]), np.diag([0.3, 0.4, 0.5]))


FRAME = Frame(positions=POSITIONS, members=MEMBERS, masses=(BODY,)).structure()


def test_rigid_mass_is_that_of_rods_and_bodies():
    """Half of a rod at each end, and the body moved by its offset."""
    expected = np.zeros((6, 6))
    for a, b, _, _, density in MEMBERS:
        ends = POSITIONS[[a - 1, b - 1]]
        half = SpatialInertia(
            density * np.linalg.norm(ends[1] - ends[0]) / 2.0,
            np.zeros(3),
            np.zeros((3, 3)),
        )
        expected += sum(
            inertia_matrix(moved_inertia(half, np.eye(3), end)) for end in ends
        )
    body = SpatialInertia(BODY.mass, np.zeros(3), BODY.inertia)
    expected += inertia_matrix(
        moved_inertia(body, np.eye(3), POSITIONS[1] + BODY.offset)
    )
    assert relative_error(FRAME.rigid_mass, expected) < ROUND_OFF
    centre = np.array([expected[1, 5], expected[2, 3], expected[0, 4]]) / expected[0, 0]
    assert relative_error(FRAME.centre, centre) < ROUND_OFF


def test_points_have_the_mass_of_the_matrix():
    """Entry by entry: nodes with mass, with a body beside them, and with nothing."""
    carried = FRAME.carried.toarray()
    told = (carried.T * np.repeat(FRAME.point_masses, 3)) @ carried
    assert relative_error(told, FRAME.mass) < ROUND_OFF
    modes = reduced_modes(FRAME, 2, [])
    assert relative_error(modes.mass, FRAME.rigid_mass[0, 0]) < ROUND_OFF
    assert relative_error(modes.inertia, FRAME.rigid_mass[3:, 3:]) < ROUND_OFF
    assert (
        relative_error(modes.static_moment, FRAME.rigid_mass[0, 0] * FRAME.centre)
        < ROUND_OFF
    )


def test_mass_that_couples_nodes_keeps_mass_centre_and_inertia():
    """Points along the members, each moved by both ends, turning included."""
    mass = np.zeros((24, 24))
    for a, b, *_ in MEMBERS:
        for share in (0.3, 0.8):
            point = POSITIONS[[a - 1, b - 1]].T @ [1.0 - share, share]
            shape = np.zeros((3, 4, 6))
            for node, weight in ((a - 1, 1.0 - share), (b - 1, share)):
                shape[:, node] = weight * np.hstack(
                    [np.eye(3), cross_matrix(POSITIONS[node] - point)]
                )
            mass += shape.reshape(3, 24).T @ shape.reshape(3, 24)
    coupled = Structure.from_matrices(mass, FRAME.stiffness, POSITIONS, units=SI)
    modes = reduced_modes(coupled, 2, [])
    assert relative_error(modes.inertia, coupled.rigid_mass[3:, 3:]) < ROUND_OFF
    assert (
        relative_error(modes.static_moment, coupled.rigid_mass[0, 0] * coupled.centre)
        < ROUND_OFF
    )
    assert "mass that couples nodes was lumped to them" in coupled.assumptions[-1]
    assert not any("couples" in a for a in FRAME.assumptions)


def test_units():
    """Millimetres and tonnes; feet, pounds and minutes: the same body."""
    for units, length, kilogram, second in (
        (("mm", "t", "s"), 1e-3, 1e3, 1.0),
        (("ft", "lb", "min"), 0.3048, 0.45359237, 60.0),
    ):
        scale = np.tile([1.0, 1.0, 1.0, 1 / length, 1 / length, 1 / length], 4)
        mass = FRAME.mass.toarray() * np.outer(scale, scale) / kilogram
        stiffness = (
            FRAME.stiffness.toarray() * np.outer(scale, scale) / kilogram * second**2
        )
        found = Structure.from_matrices(
            mass, stiffness, POSITIONS / length, units=units
        )
        for name in ("mass", "stiffness", "positions"):
            assert (
                relative_error(getattr(found, name), getattr(FRAME, name)) < ROUND_OFF
            ), (units, name)
        assert found.assumptions == (
            f"lengths are in {units[0]}, masses in {units[1]}, times in {units[2]}, as the user stated",
        )


def test_axes_of_the_nodes():
    """Freedoms along axes of their own at each node: the same body."""
    turns = [
        fixed_rotation(np.array(a))
        for a in ([0.3, 1.0, 2.0], [0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [2.0, -1.0, 3.0])
    ]
    turned = block_diag(*[turn for turn in turns for _ in range(2)])
    mass, stiffness = (
        turned.T @ m.toarray() @ turned for m in (FRAME.mass, FRAME.stiffness)
    )
    found = Structure.from_matrices(
        mass, stiffness, POSITIONS, units=SI, axes=np.array(turns)
    )
    assert relative_error(found.stiffness, FRAME.stiffness) < ROUND_OFF
    assert relative_error(found.mass, FRAME.mass) < ROUND_OFF


def test_three_freedoms_per_node():
    """Bars on hinges: no rotations in the matrices, and none in the six-freedom form either."""
    bars = tuple(
        m._replace(rigidity=Rigidity(1e6, np.zeros((3, 3)), 0.0)) for m in MEMBERS
    )
    hinged = Frame(positions=POSITIONS, members=bars).structure()
    moving = np.arange(24).reshape(-1, 6)[:, :3].ravel()
    mass, stiffness = (
        m.toarray()[np.ix_(moving, moving)] for m in (hinged.mass, hinged.stiffness)
    )
    found = Structure.from_matrices(
        mass, stiffness, POSITIONS, units=SI, nodes=[7, 3, 8, 9]
    )
    modes = reduced_modes(found, 4, [])
    assert (
        relative_error(modes.frequencies, reduced_modes(hinged, 4, []).frequencies)
        < 1e-9
    )
    assert found.nodes == (7, 3, 8, 9)


@pytest.mark.parametrize("kind", ["mtx", "npz", "npy"])
def test_files(tmp_path, kind):
    files = {name: tmp_path / f"{name}.{kind}" for name in ("mass", "stiffness")}
    for name, path in files.items():
        matrix = getattr(FRAME, name)
        if kind == "mtx":
            mmwrite(path, matrix, symmetry="symmetric")
        elif kind == "npz":
            save_npz(path, csc_array(matrix))
        else:
            np.save(path, matrix.toarray())
    found = Structure.from_matrices(
        files["mass"], files["stiffness"], POSITIONS, units=SI
    )
    assert relative_error(found.stiffness, FRAME.stiffness) < ROUND_OFF
    assert relative_error(found.mass, FRAME.mass) < ROUND_OFF


def changed(matrix, row, column, value):
    """Return a matrix with one element changed."""
    other = matrix.toarray()
    other[row, column] = value
    return other


K, M = FRAME.stiffness, FRAME.mass
GROUNDED_STIFFNESS = K.toarray() + np.diag(np.eye(24)[7] * 1e5)
LOOSE_STIFFNESS = K.toarray() * np.outer(np.arange(24) < 18, np.arange(24) < 18)

ERROR_CASES = [
    ({"units": "SI"}, "units are 'SI'; they must be three, of length, mass and time"),
    ({"units": ("mm", "t")}, r"units are \('mm', 't'\); .*: there are not three texts"),
    (
        {"units": ("kg", "m", "s")},
        "they must be three, of length, mass and time, .*unit 'kg'",
    ),
    ({"units": ("m", "kgs", "s")}, "unknown unit 'kgs'"),
    (
        {"mass": np.zeros((20, 20))},
        r"has shape \(20, 20\); with three or six .* \(12, 12\) or \(24, 24\)",
    ),
    ({"mass": np.zeros((24, 12))}, r"the mass matrix has shape \(24, 12\)"),
    ({"mass": np.ones(24)}, "must be a matrix of real numbers, not 1-dimensional"),
    (
        {"stiffness": K.toarray() * 1j},
        "must be a matrix of real numbers, not 2-dimensional complex",
    ),
    ({"stiffness": [["a"]]}, "the stiffness matrix must be a matrix of"),
    (
        {"stiffness": changed(K, 3, 3, np.nan)},
        "the stiffness matrix has elements that are not finite",
    ),
    ({"mass": csr_array((24, 24))}, "the mass matrix is zero"),
    (
        {"stiffness": np.triu(K.toarray())},
        r"stiffness matrix is not symmetric: at \(node .*one triangle",
    ),
    ({"mass": changed(M, 6, 6, -1.0)}, "the mass matrix is negative at node 2, x: -1"),
    (
        {"stiffness": GROUNDED_STIFFNESS},
        "it is not free: a rigid motion .* causes .* at node 2, y; remove supp",
    ),
    (
        {"positions": POSITIONS[:, :2]},
        r"positions has shape \(4, 2\); it must be \('any', 3\)",
    ),
    (
        {"axes": np.diag([1.0, 1.0, -1.0])},
        "axes is not a rotation matrix: R.T R differs from I by 0, and the determinant is -1",
    ),
    ({"nodes": [1, 2, 3, 2]}, "node number 2 is used twice"),
    ({"nodes": [1, 2, 3]}, r"positions has shape \(4, 3\); it must be \(3, 3\)"),
    (
        {"stiffness": LOOSE_STIFFNESS},
        "node 4, x has mass but no stiffness; the structure is a mechanism",
    ),
    ({"mass": changed(M, 0, 0, 9.0)}, "point masses cannot represent its mass"),
    (
        {"mass": "mass.xyz"},
        "no reader of structure: the mass matrix for files '.xyz'; choose from: .mtx, ",
    ),
    ({"mass": "nowhere.mtx"}, "the mass matrix cannot be read from 'nowhere.mtx'"),
]


@pytest.mark.parametrize("given, message", ERROR_CASES)
def test_errors(given, message):
    body = {"mass": M, "stiffness": K, "positions": POSITIONS, "units": SI}
    with pytest.raises(ModelError, match=message):
        Structure.from_matrices(**{**body, **given})


def test_stiffness_that_gives_energy_is_refused():
    """Symmetric, without forces on rigid motions, positive on the diagonal; and yet not a body."""
    values, vectors = np.linalg.eigh(K.toarray())
    softest = vectors[:, 6]
    worse = K.toarray() - 1.1 * values[6] * np.outer(softest, softest)
    with pytest.raises(
        ModelError, match="the stiffness matrix is not positive semidefinite"
    ):
        Structure.from_matrices(M, coo_array(worse), POSITIONS, units=SI)
