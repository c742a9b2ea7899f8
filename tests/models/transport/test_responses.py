"""Linear models against responses estimated on the nonlinear simulation, at ten frequencies."""

import numpy as np
import pytest
from systems import series

from trussflow.blocks import estimated_response, linearize
from trussflow.models import SpaceTruss

OMEGA = np.array([3.0, 6.0, 10.0, 14.0, 16.2, 20.0, 25.0, 32.0, 45.0, 62.0])
FORCE = 1e-6
"""Amplitude [N]; the joints are free, and drift on: of so little inertia that 1 N would turn them round."""


@pytest.mark.campaign
def test_plant_responds_as_its_linear_model():
    """Base force of Robot 4 to modal coordinates and grasp displacements, within 1 %."""
    diagram = series(truss=SpaceTruss.consistent())
    diagram.expose(actuation=diagram.truss.actuation)
    force, outputs = (
        "truss.actuation[20]",
        ["truss.modal_coordinate", "truss.grasp_displacement"],
    )
    model = linearize(diagram, [force], outputs)
    found = estimated_response(
        diagram,
        force,
        outputs,
        omega=OMEGA,
        amplitude=FORCE,
        step=2e-3,
        cycles=3,
        realizations=1,
    )
    expected = model(1j * found.omega, squeeze=False)
    moving = np.abs(expected).max(axis=2) > 0  # the root does not move
    error = np.abs(found.complex - expected)[moving]
    assert moving.sum() == 15
    assert (error < 0.01 * np.abs(expected)[moving]).all()
