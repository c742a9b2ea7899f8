"""What the first lines of README and report say: the published loop needs 1 ms and exact states.

Sensors and actuators are exact here; only the computer takes time, and the modal states come to the
controller exactly and at once. The published plant is flown by the published law; the consistent one, on
which that law is unstable, by its mode-neutral form.
"""

import numpy as np
import pytest

from trussflow.blocks import DivergenceError, Simulator
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import Mission, transport_diagram


def simulator(hold, delay, plant="consistent"):
    truss = getattr(SpaceTruss, plant)()
    diagram = transport_diagram(Mission.of_case(1), truss, hardware=Hardware.exact(hold, delay))
    return Simulator(diagram, step=1e-3, log=["truss.task_position", "trajectory.position"], log_step=0.01)


@pytest.mark.slow
def test_it_flies_with_a_hold_of_1_ms():
    result = simulator(1e-3, 0.0).run(4.0, progress=False)
    error = result["truss.task_position"].values - result["trajectory.position"].values
    assert np.abs(error[:, :6]).max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(("hold", "delay"), [(2e-3, 0.0), (1e-3, 1e-3)])
def test_it_is_lost_with_2_ms_of_hold_or_1_ms_of_delay(hold, delay):
    with pytest.raises(DivergenceError) as caught:
        simulator(hold, delay).run(4.0, progress=False)
    assert "stopped being finite" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hold", "delay", "most"), [(1e-3, 0.0, 1e-3), (2e-3, 0.0, np.inf), (1e-3, 1e-3, np.inf)]
)
def test_joints_of_the_published_plant_run_off(hold, delay, most):
    result = simulator(hold, delay, "published").run(4.0, progress=False)
    joints = np.abs(result["truss.task_position"].values - result["trajectory.position"].values)[:, 6:].max()
    assert (joints < most) if most < 1.0 else (joints > 0.1)
