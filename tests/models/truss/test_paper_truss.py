"""The finite-element truss against the paper, and against other finite-element codes."""

import json
from pathlib import Path

import numpy as np
import pytest
from pynite_modes import pynite_modes
from systems import assert_near, relative_error

from trussflow.models import ModelError, reduced_modes
from trussflow.models.truss.paper_truss import (
    CLAMPED_FACE,
    frame_parameters,
    paper_frame,
    paper_structure,
    printed_grasps,
)

REFERENCE = json.loads(
    (Path(__file__).parents[1] / "data" / "truss_reference.json").read_text()
)

# Pynite gives massless freedoms a tiny mass, which moves shapes by about 1e-7.
SAME_MODEL = 1e-6
# The iterative eigensolver of Pynite starts from a random vector.
SOLVER_REPEATABILITY = 1e-9


def modes_of(count, grasps):
    return reduced_modes(
        paper_structure(), count, list(grasps), clamped=CLAMPED_FACE, attachments=False
    )


@pytest.fixture(scope="module")
def fresh():
    return modes_of(6, printed_grasps())


def test_frequencies_are_those_of_table_1(fresh, modes):
    """All six within 0.15 %, with no fitted number; the common factor of -0.1 % is unexplained."""
    error = fresh.frequencies / modes.frequencies - 1.0
    assert_near(error, 0.0, 1.5e-3)
    assert np.ptp(error) < 7e-4


def test_mass_is_that_of_table_1_at_the_density_of_aluminium(fresh):
    assert fresh.mass == pytest.approx(499.7333, rel=1e-12)
    frame = paper_frame()
    ends = np.array([member[:2] for member in frame.members]) - 1
    length = np.sum(np.linalg.norm(np.diff(frame.positions[ends], axis=1), axis=2))
    assert length == pytest.approx(94.35, rel=1e-12)
    density = fresh.mass / (np.pi * frame_parameters()["rod_radius"] ** 2 * length)
    assert density == pytest.approx(2700.0, rel=1e-3)


@pytest.mark.parametrize(
    "name, key",
    [
        ("static_moment", "static_moment_kg_m"),
        ("inertia", "inertia_kg_m2"),
        ("momentum_coefficients", "momentum_coefficients"),
        ("grasp_translations", "grasp_translations"),
        ("grasp_rotations", "grasp_rotations"),
        ("frequencies", "frequencies_hz"),
    ],
)
def test_integrals_are_those_of_another_code(fresh, name, key):
    """Signs included: both follow the largest translation of the last grasp point."""
    assert relative_error(getattr(fresh, name), np.array(REFERENCE[key])) < SAME_MODEL


def test_shipped_modes_are_those_of_pynite_and_of_the_frame(fresh, modes):
    _, translations, rotations = pynite_modes(paper_frame(), 6)
    signs = np.sign(np.sum(translations * modes.shapes, axis=(0, 1)))
    nodes = [
        np.argmin(np.linalg.norm(modes.positions - p, axis=1)) for p in printed_grasps()
    ]
    found = {
        "positions": fresh.positions,
        "masses": fresh.masses,
        "shapes": translations * signs,
        "grasp_translations": translations[nodes] * signs,
        "grasp_rotations": rotations[nodes] * signs,
    }
    for name, values in found.items():
        assert_near(
            values, getattr(modes, name), SOLVER_REPEATABILITY, err_msg=str(name)
        )
        assert_near(
            getattr(fresh, name), getattr(modes, name), SAME_MODEL, err_msg=str(name)
        )


def test_grasp_points_must_be_mesh_points():
    with pytest.raises(
        ModelError, match=r"no mesh point at grasp point \[1.0, 0.0, 0.0\] m"
    ):
        modes_of(6, [[1.0, 0.0, 0.0]])
