"""The loop of the mean axes flies where the source's loop does not: sampled, late, noisy, quantized."""

from dataclasses import replace

import numpy as np
import pytest

from trussflow.blocks import Simulator
from trussflow.models import Hardware, ModelError, SpaceTruss
from trussflow.models.transport import Mission, mean_axes_transport


@pytest.mark.campaign
def test_flight_behind_hardware():
    """Twelve seconds of Case 1, the steepest of its acceleration among them.

    20 ms of hold and 20 ms of delay, noise of 1e-4 on all that is measured, and thrust in steps of 0.1 N: the
    source's law is metres off within a second, and without the torques that hold the arms they buckle.
    """
    hardware = Hardware.flight()
    truss = hardware.mounted(SpaceTruss.consistent())
    diagram = mean_axes_transport(Mission.of_case(1), truss, hardware=hardware, seed=1)
    ports = [
        truss.task_position,
        diagram.blocks["trajectory"].port("position"),
        truss.base_torque,
    ]
    result = Simulator(diagram, step=1e-3, log=ports, log_step=0.02).run(12.0)
    error = np.abs(
        result["truss.task_position"].values - result["trajectory.position"].values
    )
    assert error[:, :6].max() < 3e-4
    assert error[:, 6:].max() < 2e-3
    assert np.abs(result["truss.base_torque"]).max() < 0.2


def test_hardware_that_does_not_fit():
    mission = Mission.of_case(1)
    flight = Hardware.flight(control="torque")
    for hardware in (replace(flight, sample_time=0.01), replace(flight, delay=0.0)):
        with pytest.raises(
            ModelError, match="the sample times must be equal, and the delay not less"
        ):
            mean_axes_transport(mission, SpaceTruss.consistent(), hardware=hardware)


def test_a_plant_without_its_drives():
    message = r"the plant has not the reflected inertia of the drives; use hardware.mounted\(truss\)"
    with pytest.raises(ModelError, match=message):
        mean_axes_transport(
            Mission.of_case(1), SpaceTruss.consistent(), hardware=Hardware.flight()
        )
