"""Mean axes and free modes take the system at rest apart."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag
from systems import assert_near

from trussflow.models import ModelError, SpaceTruss
from trussflow.models.mean_axes.free_modes import FreeModes


@pytest.mark.parametrize("arm", ["literal", "jaco"])
def test_mean_axes_and_free_modes_are_uncoupled(arm):
    """In (y, eta) mass and stiffness are block diagonal, so no vibration moves the mean axes."""
    dynamics = SpaceTruss.consistent(arm=arm).dynamics
    m, h = dynamics.rigid_coordinates, dynamics.modes.modes
    free = FreeModes.of(dynamics, h)
    terms = dynamics.evaluate(dynamics.rest, np.zeros(dynamics.coordinates))
    carried = np.linalg.solve(free.inertia, terms.mass_matrix[:m, m:])
    shapes = np.linalg.lstsq(carried, free.root_motion, rcond=None)[0]
    # (x, tau) of (y, eta)
    whole = np.block([[np.eye(m), -free.root_motion], [np.zeros((h, m)), shapes]])

    stiffness = block_diag(np.zeros((m, m)), np.diag(dynamics.modes.stiffness))
    uncoupled = block_diag(free.inertia, np.eye(h))
    assert_near(whole.T @ terms.mass_matrix @ whole, uncoupled, 1e-8)
    squares = np.diag(np.concatenate([np.zeros(m), free.frequencies**2]))
    assert_near(whole.T @ stiffness @ whole, squares, 1e-9 * squares.max())
    rates = block_diag(
        np.zeros((m, m)),
        np.diag(
            4.0 * np.pi * dynamics.modes.damping_ratios * dynamics.modes.frequencies
        ),
    )
    own = np.diag(whole.T @ rates @ whole)[m:]
    assert_allclose(own, 2.0 * free.damping_ratios * free.frequencies, rtol=1e-8)
    acting = np.concatenate([terms.actuation_matrix[:m], free.influence])
    assert_near(whole.T @ terms.actuation_matrix, acting, 1e-10)


def test_as_many_modes_as_there_are():
    dynamics = SpaceTruss.consistent(modes=2).dynamics
    with pytest.raises(
        ModelError, match="cannot take 3 free modes of a truss of 2; choose 0 to 2"
    ):
        FreeModes.of(dynamics, 3)
