"""Modes with attachment shapes: what they share with the modes alone, and what only they can do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pynite_modes import pynite_modes
from systems import assert_near

from trussflow.models import ModelError, reduced_modes
from trussflow.models.truss.paper_truss import (
    CLAMPED_FACE,
    accurate_modes,
    paper_frame,
    paper_structure,
    printed_frequencies,
    printed_grasps,
)

# Pynite gives massless freedoms a tiny mass, which moves shapes by about 1e-7.
SAME_MODEL = 1e-6
CONDENSED_AT = (np.inf, 100.0, 25.0)


def component_modes(number, grasps, **options):
    return reduced_modes(
        paper_structure(), number, list(grasps), clamped=CLAMPED_FACE, **options
    )


def test_the_modes_are_those_of_another_code():
    """The first h shapes are the modes, and the frequencies of the others lie above them."""
    found = component_modes(20, printed_grasps())
    frequencies, translations, _ = pynite_modes(paper_frame(), 38)
    alone = found.truncated(20)
    assert_near(alone.frequencies / frequencies[:20], 1.0, SAME_MODEL)
    signs = np.sign(np.sum(alone.shapes * translations[:, :, :20], axis=(0, 1)))
    assert_near(alone.shapes * signs, translations[:, :, :20], SAME_MODEL)
    assert np.all(np.diff(found.frequencies) > 0.0)
    # Courant: each frequency in a subspace is above the one of the same number in the whole.
    assert np.all(found.frequencies > frequencies * (1.0 - SAME_MODEL))


@pytest.mark.parametrize("highest", CONDENSED_AT)
def test_shapes_are_orthonormal_and_clamped(highest):
    modes = component_modes(20, printed_grasps(), highest_frequency=highest)
    assert modes.modes == 20 + 18
    assert_near(modes.modal_mass, np.eye(38), 1e-10)
    assert modes.frequencies[-1] == pytest.approx(min(highest, 440.86), abs=0.01)
    assert not np.any(modes.shapes[: len(CLAMPED_FACE)])
    assert not np.any(modes.grasp_translations[0])


def test_the_accurate_truss_extends_the_reconstructed_one(modes):
    """The same mass, static moment and inertia; its first six modes with the printed frequencies."""
    accurate = accurate_modes()
    for name in ("mass", "static_moment", "inertia"):
        assert_array_equal(
            getattr(accurate, name), getattr(modes, name), err_msg=str(name)
        )
    assert_array_equal(accurate.frequencies[:6], printed_frequencies())
    first = accurate.truncated(6)
    for name in ("shapes", "grasp_positions", "grasp_translations", "grasp_rotations"):
        assert_near(
            getattr(first, name), getattr(modes, name), SAME_MODEL, err_msg=str(name)
        )


def test_attachments_where_a_robot_can_pull():
    """Six per grasp point; none where the truss is clamped, and none twice."""
    root, _, _, tip = printed_grasps()
    for points, count in (([root], 0), ([tip], 6), ([tip, root, tip], 6)):
        assert component_modes(3, np.array(points)).modes == 3 + count


@pytest.mark.parametrize(
    "make, options, message",
    [
        (
            accurate_modes,
            {"number_of_modes": 5},
            "cannot keep 5 modes: the accurate truss has at least the 6",
        ),
        (
            accurate_modes,
            {"highest_frequency": 4.0},
            "highest_frequency is 4.0 Hz, but mode 20 has 18.12 Hz",
        ),
        (accurate_modes, {"highest_frequency": np.nan}, "highest_frequency is nan Hz"),
        (
            accurate_modes,
            {"number_of_modes": 354},
            "cannot compute 354 modes and 18 attachment shapes",
        ),
        (
            accurate_modes,
            {"number_of_modes": 350},
            "cannot add attachment shapes to 350 modes",
        ),
    ],
)
def test_errors(make, options, message):
    with pytest.raises(ModelError, match=message):
        make(**options)
