"""Mirror images, and modes kept on file."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from reproduction.trusses import frame_modes, mirrored, truss_modes

from trussflow.models import TrussModes
from trussflow.models.truss.truss_terms import truss_terms

ROUND_OFF = 1e-12  # of sums over 128 points; elements are up to 170
CANCELS = 1e-10  # what is left where such a sum is zero
ON_LINE = 1e-8  # m; coordinates of mesh points are sums of lengths


def momentum_coefficients(modes):
    """Return P_t above H_t, as the equations of motion use them."""
    still = np.zeros(3)
    terms = truss_terms(modes.data, np.ones(1), still, still, np.zeros(modes.modes))
    return terms.coupling


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_mirror_image_has_mirrored_integrals(modes, axis):
    """Static moment as a vector, angular momentum and rotations as axial vectors."""
    image = mirrored(modes, axis)
    sign = np.ones(3)
    sign[axis] = -1.0
    assert_allclose(image.static_moment, sign * modes.static_moment, rtol=ROUND_OFF)
    inertia = np.diag(sign) @ modes.inertia @ np.diag(sign)
    assert_allclose(image.inertia, inertia, rtol=ROUND_OFF)
    momenta = np.concatenate([sign, -sign])
    expected = momenta[:, None] * momentum_coefficients(modes)
    assert_allclose(
        momentum_coefficients(image), expected, rtol=ROUND_OFF, atol=CANCELS
    )
    assert_array_equal(image.grasp_rotations, -sign[:, None] * modes.grasp_rotations)


def test_the_inner_edge_has_the_same_grasp_points_on_the_other_side_of_the_truss(
    modes, tmp_path
):
    """Seen from the grasp line the truss lies towards +y, not -y; the low longeron is shared."""
    inner = frame_modes("inner edge", tmp_path)
    assert_array_equal(inner.grasp_positions, modes.grasp_positions)
    on_line = (np.abs(inner.positions[:, 1]) < ON_LINE) & (inner.positions[:, 0] < 7.6)
    assert inner.positions[on_line, 0].max() > 7.0
    straight = inner.positions[inner.positions[:, 0] < 5.0]
    assert straight[:, 1].max() == pytest.approx(1.275)
    assert straight[:, 1].min() == pytest.approx(0.0)


def test_modes_are_computed_once(tmp_path, monkeypatch):
    first = frame_modes("reconstructed", tmp_path)
    monkeypatch.setattr("reproduction.trusses.reduced_modes", None)
    again = frame_modes("reconstructed", tmp_path)
    assert_array_equal(first.shapes, again.shapes)
    more = truss_modes(8, tmp_path)
    assert more.modes == 8
    assert_array_equal(more.frequencies[:6], TrussModes.reconstructed().frequencies)
