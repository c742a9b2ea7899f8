"""What the first lines of README and report say: the published loop needs 1 ms and exact states.

Sensors and actuators are exact here; only the computer takes time, and the modal states come to the
controller exactly and at once. The published plant is flown by the published law; the consistent one, on
which that law is unstable, by its mode-neutral form.
"""

import campaign
import numpy as np
import pytest
from systems import assert_near

from trussflow.blocks import Simulator
from trussflow.blocks.errors import DivergenceError
from trussflow.models import Hardware, SpaceTruss
from trussflow.models.transport import Mission, transport_diagram


def simulator(hold, delay, plant="consistent"):
    truss = getattr(SpaceTruss, plant)()
    diagram = transport_diagram(
        Mission.of_case(1), truss, hardware=Hardware.exact(hold, delay)
    )
    return Simulator(
        diagram,
        step=1e-3,
        log=["truss.task_position", "trajectory.position"],
        log_step=0.01,
    )


@pytest.mark.parametrize("duration", [0.5, campaign.only(4.0)])
def test_it_runs_with_a_hold_of_1_ms(duration):
    result = simulator(1e-3, 0.0).run(duration)
    error = result["truss.task_position"].values - result["trajectory.position"].values
    assert_near(error[:, :6], 0.0, 1e-4)


@pytest.mark.parametrize("hold, delay", [(2e-3, 0.0), campaign.only(1e-3, 1e-3)])
def test_it_diverges_with_2_ms_of_hold_or_1_ms_of_delay(hold, delay):
    with pytest.raises(DivergenceError, match="stopped being finite"):
        simulator(hold, delay).run(4.0)


@pytest.mark.campaign
@pytest.mark.parametrize(
    "hold, delay, least, most",
    [(1e-3, 0.0, 0.0, 1e-3), (2e-3, 0.0, 0.1, np.inf), (1e-3, 1e-3, 0.1, np.inf)],
)
def test_joints_of_the_published_plant_run_off(hold, delay, least, most):
    result = simulator(hold, delay, "published").run(4.0)
    joints = np.abs(
        result["truss.task_position"].values - result["trajectory.position"].values
    )[:, 6:].max()
    assert least < joints < most
