"""A structure as plain matrices of another program, Pynite, in each format, as a mission."""

import io
from zipfile import ZipFile

import campaign
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.io import mmwrite
from scipy.sparse import csr_array
from systems import assert_near

from trussflow.models import ModelError
from trussflow.models.transport import MissionFile

FeModel = pytest.importorskip("Pynite", reason="Pynite makes the matrices").FEModel3D

# A tetrahedron of rods with a mast at its top.
POSITIONS = np.array(
    [[0, 0, 0], [2, 0, 0], [1, 2, 0], [1, 0.7, 1.5], [1, 0.7, 4.0]], dtype=float
)
ENDS = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3), (3, 4)]
FILES = "mass", "stiffness", "positions"
MASSES = [20.0, 20.0, 30.0, 10.0, 15.0]  # kg
MISSION = """title = "tetrahedron"
[structure]
model = "matrices"
FILES
units = ["m", "kg", "s"]
grasps = [1, 3]
modes = 6
attachments = "off"
damping = "0.5 %"
[robots]
arm = "jaco"
[path]
position = "[0, 0, 0.05] m"
attitude = "[0, 0, 0] deg"
duration = "10 s"
[controller]
law = "mean axes"
[hardware]
kind = "flight"
[simulation]
duration = "2 s"
step = "1 ms"
"""


@pytest.fixture(scope="module")
def matrices():
    """Return Pynite's matrices of mass and stiffness of the free frame, in metres, kilograms and seconds."""
    model = FeModel()
    model.add_material("rod", 7e10, 2.6e10, 0.33, 0.0)
    model.add_section("rod", 4e-4, 4e-8, 4e-8, 8e-8)
    names = [f"N{k}" for k in range(len(POSITIONS))]
    for name, place, mass in zip(names, POSITIONS, MASSES, strict=True):
        model.add_node(name, *place)
        model.add_node_load(name, "FY", -mass, case="mass")
    for k, (a, b) in enumerate(ENDS):
        model.add_member(f"M{k}", names[a], names[b], "rod", "rod")
    model.add_load_combo("mass", {"mass": 1.0})
    # Supports leave the matrices as they are, but without them Pynite refuses to begin.
    for name in names[:3]:
        model.def_support(name, *[True] * 6)
    model.analyze_linear(check_stability=False)
    return {
        "mass": csr_array(model.M("mass")),
        "stiffness": csr_array(model.Ke("mass", check_stability=False)),
    }


def written(folder, kind, matrices):
    """Return the names of the files of a kind: one archive, or a file for each matrix."""
    if kind == "npz":
        dense = {name: matrix.toarray() for name, matrix in matrices.items()}
        np.savez(folder / "body.npz", **dense, positions=POSITIONS)
        return dict.fromkeys(FILES, "body.npz")
    for name, matrix in {**matrices, "positions": POSITIONS}.items():
        mmwrite(folder / f"{name}.mtx", matrix)
    return {name: f"{name}.mtx" for name in FILES}


def mission(folder, files):
    path = folder / "mission.toml"
    said = "\n".join(f'{key} = "{name}"' for key, name in files.items())
    path.write_text(MISSION.replace("FILES", said), encoding="utf-8")
    return path


def frequencies(matrices):
    """Return those of the free body [Hz], the rotations that have no mass condensed."""
    mass, stiffness = (matrices[name].toarray() for name in ("mass", "stiffness"))
    heavy = np.diagonal(mass) > 0.0
    flexibility = np.linalg.solve(
        stiffness[np.ix_(~heavy, ~heavy)], stiffness[np.ix_(~heavy, heavy)]
    )
    held = (
        stiffness[np.ix_(heavy, heavy)] - stiffness[np.ix_(heavy, ~heavy)] @ flexibility
    )
    roots = 1.0 / np.sqrt(np.diagonal(mass)[heavy])
    found = np.sort(np.linalg.eigvalsh(held * np.outer(roots, roots)))
    return np.sqrt(found[6:]) / (2.0 * np.pi)


@pytest.mark.parametrize("kind", ["mtx", "npz"])
def test_matrices_of_another_program_are_a_mission(tmp_path, kind, matrices):
    flown = MissionFile.read(mission(tmp_path, written(tmp_path, kind, matrices)))
    modes = flown.truss.dynamics.modes
    assert modes.masses.sum() == pytest.approx(sum(MASSES), rel=1e-12)
    assert_allclose(modes.frequencies, frequencies(matrices)[:6], rtol=1e-9)
    assert_near(modes.grasp_positions, POSITIONS[[0, 2]], 1e-12)
    assert len(flown.rods) == len(ENDS)


@pytest.mark.parametrize("duration", [0.1, campaign.only(2.0)])
def test_such_a_mission_runs(tmp_path, matrices, duration):
    flown = MissionFile.read(mission(tmp_path, written(tmp_path, "npz", matrices)))
    run = flown.simulator(flown.diagram()).run(duration)
    assert (
        max(np.abs(run[f"{name}_error"]).max() for name in ("position", "attitude"))
        < 1.5e-4
    )


@pytest.mark.parametrize(
    "key, name, message",
    [
        ("mass", "M.mtx", "mission.toml, structure: 'mass' is refused: "),
        ("mass", "other.npz", "array in other.npz: 'mass'; choose from: M"),
        ("mass", None, "has no 'mass'"),
        (
            "stiffness",
            "broken.npz",
            "mission.toml, structure: 'stiffness' is refused: ",
        ),
        (
            "mass",
            "huge.npz",
            "the mass matrix cannot be read from .*it needs more memory than there is",
        ),
        (
            "mass",
            "huge.npy",
            "the mass matrix cannot be read from .*mmap length is greater than file size",
        ),
        (
            "mass",
            "huge.mtx",
            "too short for the 10,000,000,000 entries that it declares",
        ),
        (
            "positions",
            "wide.mtx",
            r"positions has shape \(1000000000, 1000000000\), more than 10,000,000 el",
        ),
        ("positions", "two.npy", r"positions has shape \(5, 2\)"),
        ("positions", "nodes.csv", "for files '.csv'; choose from: .mtx, .npz, .npy"),
    ],
)
def test_what_cannot_be_a_structure_is_said(tmp_path, matrices, key, name, message):
    np.savez(tmp_path / "other.npz", M=np.eye(3))
    (tmp_path / "broken.npz").write_bytes(b"PK broken")
    head = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**8, 10**8)}
    np.lib.format.write_array_header_1_0(head, shape)
    (tmp_path / "huge.npy").write_bytes(head.getvalue())
    with ZipFile(tmp_path / "huge.npz", "w") as archive:
        archive.writestr("mass.npy", head.getvalue())
    (tmp_path / "huge.mtx").write_text(
        "%%MatrixMarket matrix array real general\n100000 100000\n1\n"
    )
    sizes = "1000000000 1000000000 1\n1 1 1.0\n"
    (tmp_path / "wide.mtx").write_text(
        f"%%MatrixMarket matrix coordinate real general\n{sizes}"
    )
    np.save(tmp_path / "two.npy", POSITIONS[:, :2])
    files = written(tmp_path, "mtx", matrices) | {key: name}
    if name is None:
        del files[key]
    with pytest.raises(ModelError, match=message):
        MissionFile.read(mission(tmp_path, files))
