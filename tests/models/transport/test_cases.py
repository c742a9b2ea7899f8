"""The main job: both cases of the source end to end, and the plant that is our own."""

from functools import cache

import campaign
import numpy as np
import pytest

from trussflow.blocks import Simulator
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram
from trussflow.models.transport.results import logged

WHOLE = campaign.only(80.0)  # s
whole = pytest.mark.parametrize("flown", [WHOLE], indirect=True)
begun_and_whole = pytest.mark.parametrize("flown", [1.5, WHOLE], indirect=True)


@pytest.fixture(scope="module")
def flown(request):
    """Return a function that simulates a mission once, for the given duration."""

    @cache
    def fly(case, plant="published"):
        truss = getattr(SpaceTruss, plant)()
        diagram = transport_diagram(Mission.of_case(case), truss)
        simulator = Simulator(diagram, step=1e-3, log=logged(diagram), log_step=0.01)
        return simulator.run(request.param)

    return fly


over_cases = pytest.mark.parametrize(
    "case, flown",
    [(1, 1.5), *(campaign.only(case, 80.0) for case in (1, 2))],
    indirect=["flown"],
)


def peak(result, name):
    return np.abs(result[name].values).max()


@begun_and_whole
@pytest.mark.parametrize(
    "case, position, attitude, torque",
    [(1, 1e-5, 2e-5, 0.3), campaign.only(2, 1e-5, 1e-5, 0.85)],
)
def test_published_tracking_and_torque(flown, case, position, attitude, torque):
    """Errors stay small throughout, and base torques near the source's 0.25 and 0.8 N·m."""
    result = flown(case)
    assert peak(result, "position_error") < position
    assert peak(result, "attitude_error") < attitude
    assert peak(result, "base_torque") < torque


@begun_and_whole
def test_force_sharing_in_case_1(flown):
    """Robot 4 works most, Robot 3 hardly at all."""
    result = flown(1)
    force = np.abs(result["base_force"].values).max(axis=(0, 2))
    robots = result["robot"].values.tolist()
    assert robots[int(force.argmax())] == 4
    assert force[robots.index(3)] < 0.1


@over_cases
def test_theorem_1(flown, case):
    """After the start has died away, the estimate is within xi/L of the disturbance."""
    result = flown(case)
    bandwidth = Mission.of_case(case).observer_bandwidth
    d, time = result["disturbance"].values, result["time"].values
    xi = np.linalg.norm(np.diff(d, axis=0) / np.diff(time)[:, None], axis=1).max()
    error = np.linalg.norm(result["disturbance_estimate"].values - d, axis=1)
    assert error[time > 5 / bandwidth].max() <= xi / bandwidth


@over_cases
def test_consistent_plant_tracks_better(flown, case):
    """With actuator work on the modes, allocated so that feedback does none."""
    ours, published = flown(case, "consistent"), flown(case)
    for error in ("position_error", "attitude_error"):
        assert peak(ours, error) < peak(published, error)
    assert peak(ours, "grasp_displacement") < 0.3 * peak(
        published, "grasp_displacement"
    )
    assert peak(ours, "base_torque") < 1.25 * peak(published, "base_torque")


@whole
@pytest.mark.parametrize("case", [1, 2])
def test_consistent_plant_is_stable(flown, case):
    ours = flown(case, "consistent")
    late, moving = ours["time"].values > 70.0, ours["time"].values < 60.0
    rates = np.abs(ours["modal_rate"].values)
    # 0.5 % damping takes minutes, but it does not grow
    assert rates[late].max() < rates[moving].max()
