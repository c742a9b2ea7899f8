"""Varied trusses: invariants under a load, under scaling, and under wrong shapes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near

from trussflow.models import ModelError
from trussflow.models.truss.paper_truss import accurate_modes
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, misjudged, scaled

TRUSS = accurate_modes()
SIX = TrussModes.reconstructed()
TIP = TRUSS.positions[np.argmax(np.linalg.norm(TRUSS.positions, axis=1))]


def compliance(modes):
    """Return how far all grasps move and turn under unit loads on them."""
    motion = np.hstack([modes.grasp_translations, modes.grasp_rotations]).reshape(
        -1, modes.modes
    )
    return motion / modes.stiffness @ motion.T


def test_a_load_is_mass_and_no_stiffness():
    heavy = loaded(TRUSS, TIP, 20.0)
    assert heavy.mass - TRUSS.mass == pytest.approx(20.0, rel=1e-12)
    assert_near(heavy.static_moment - TRUSS.static_moment, 20.0 * TIP, 1e-9)
    given = compliance(TRUSS)
    assert_near(compliance(heavy), given, 1e-10 * np.abs(given).max())
    # Each frequency falls, and none below the next lower one of the truss without (interlacing).
    assert (heavy.frequencies <= TRUSS.frequencies * (1 + 1e-12)).all()
    assert heavy.frequencies[0] < 0.99 * TRUSS.frequencies[0]
    assert (heavy.frequencies[3:] >= TRUSS.frequencies[:-3] * (1 - 1e-12)).all()


def test_a_load_on_a_single_degree_of_freedom():
    """One mode with the load on it: its mass grows from 1 by m phi**2, its frequency falls by the root."""
    one = TRUSS.truncated(1)
    node = np.argmin(np.linalg.norm(one.positions - TIP, axis=1))
    grown = 1.0 + 7.0 * np.sum(one.shapes[node] ** 2)
    heavy = loaded(one, TIP, 7.0)
    assert_allclose(heavy.frequencies, one.frequencies / np.sqrt(grown), rtol=1e-12)


def test_scaled():
    other = scaled(TRUSS, mass=1.1, frequency=0.9)
    assert other.mass == pytest.approx(1.1 * TRUSS.mass, rel=1e-12)
    assert_allclose(other.frequencies, 0.9 * TRUSS.frequencies, rtol=1e-12)
    given = compliance(TRUSS) / (1.1 * 0.9**2)
    assert_near(compliance(other), given, 1e-12 * np.abs(given).max())


def test_misjudged():
    factors = np.ones(TRUSS.modes)
    factors[4] = 1.5
    other = misjudged(TRUSS, factors)
    assert_array_equal(
        other.grasp_rotations[..., 4], 1.5 * TRUSS.grasp_rotations[..., 4]
    )
    assert_array_equal(
        other.grasp_translations[..., :4], TRUSS.grasp_translations[..., :4]
    )
    assert_array_equal(other.shapes, TRUSS.shapes)


@pytest.mark.parametrize(
    "make, message",
    [
        (
            lambda: scaled(TRUSS, mass=0.0),
            "scaled truss: mass is 0; it must be above 0",
        ),
        (
            lambda: scaled(TRUSS, frequency=np.nan),
            "scaled truss: frequency is not finite: nan",
        ),
        (
            lambda: loaded(TRUSS, TIP, -1.0),
            "loaded truss: mass is -1; it must be at least 0",
        ),
        (
            lambda: scaled(TRUSS, mass="2"),
            "scaled truss: mass must be numeric, not '2'",
        ),
        (lambda: loaded(TRUSS, TIP[:2], 1.0), "point has shape"),
        (lambda: misjudged(TRUSS, [1.0]), "factors has shape"),
        (
            lambda: loaded(
                replace(SIX, damping_ratios=np.linspace(0.0, 0.01, 6)), TIP, 1.0
            ),
            "different damping ratios",
        ),
    ],
)
def test_errors(make, message):
    with pytest.raises(ModelError, match=message):
        make()
