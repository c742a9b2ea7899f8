"""Linear models against responses estimated on the nonlinear simulation, at ten frequencies."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Diagram, estimated_response, frequency_response, linearize
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

OMEGA = np.array([3.0, 6.0, 10.0, 14.0, 16.2, 20.0, 25.0, 32.0, 45.0, 62.0])
FORCE = 1e-6
"""Amplitude [N]; the joints are free, and drift on: of so little inertia that 1 N would turn them round."""


@pytest.mark.campaign
def test_plant_responds_as_its_linear_model():
    """Base force of Robot 4 to modal coordinates and grasp displacements, within 1 %."""
    diagram = Diagram("plant")
    truss = diagram.add(truss=SpaceTruss.consistent())
    diagram.expose(actuation=truss.actuation)
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


@pytest.mark.campaign
def test_loop_responds_as_its_describing_functions():
    """Reference to position in z, 1 cm: within 2 % in gain and 2 degrees in phase."""
    mission = replace(Mission.of_case(1), position=np.zeros(3))
    diagram = transport_diagram(mission, SpaceTruss.consistent())
    ends = "controller.reference_position[2]", "truss.task_position[2]"
    omega = np.array([2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0])
    settings = {
        "amplitude": 0.01,
        "step": 1e-3,
        "cycles": 3,
        "tolerance": 3e-3,
        "realizations": 1,
    }
    # one sine at a time
    found = [estimated_response(diagram, *ends, omega=[w], **settings) for w in omega]
    moved = np.concatenate([one.omega for one in found])
    expected = frequency_response(diagram, *ends, omega=moved, amplitude=0.01)
    ratio = np.ravel([one.complex for one in found]) / np.ravel(expected.complex)
    assert np.abs(np.abs(ratio) - 1).max() < 0.02
    assert np.degrees(np.abs(np.angle(ratio))).max() < 2.0
