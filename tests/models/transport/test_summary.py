"""The summary: figures of merit of a made-up result, beside the words of the source."""

import numpy as np
import pytest
import xarray as xr

from trussflow.models.transport import Mission, summarize

TIME = np.array([0.0, 30.0, 60.0, 80.0])  # s


def result(torque, *, force=1.0, estimate=0.0):
    """Return four robots that push alike, and a disturbance that grows by 1 a second."""
    vector, robots, joints = np.zeros((4, 3)), np.zeros((4, 4, 3)), np.zeros((4, 4, 7))
    shares = np.array([2.0, 2.0, 0.0, 4.0])[:, None]
    disturbance = np.zeros((4, 6))
    disturbance[:, 0] = TIME
    return xr.Dataset(
        {
            "position_error": (("time", "axis"), np.outer([3.0, 0.0, 0.0, -1.0], np.ones(3))),
            "attitude_error": (("time", "angle"), vector),
            "joint_error": (("time", "robot", "joint"), joints),
            "base_force": (("time", "robot", "axis"), robots - force * shares),
            "base_torque": (("time", "robot", "axis"), robots - torque),
            "joint_torque": (("time", "robot", "joint"), joints),
            "grasp_displacement": (("time", "robot", "axis"), robots),
            "disturbance": (("time", "coordinate"), disturbance),
            "disturbance_estimate": (("time", "coordinate"), disturbance + estimate),
        },
        coords={"time": TIME},
        attrs={"observer": 1, "status": "complete"},
    )


def figures(case, data):
    """Return the figures of merit by name."""
    return {f.name: f for f in summarize(data, Mission.of_case(case))}


def test_peak_and_final_errors_count_either_sign():
    found = figures(1, result(0.1))
    assert found["peak position error"].value == 3.0
    assert found["final position error"].value == 1.0


@pytest.mark.parametrize(
    ("case", "torque", "verdict"), [(1, 0.25, "holds"), (1, 0.275, "exceeded by 10%"), (2, 0.8, "holds")]
)
def test_torque_against_the_bound_of_the_source(case, torque, verdict):
    assert figures(case, result(torque))["peak base torque"].verdict == verdict


def test_force_shares_are_claimed_for_case_1_only():
    robot = "peak base force, Robot "
    first, second = figures(1, result(0.1)), figures(2, result(0.1))
    assert [first[robot + i].verdict for i in "1234"] == ["", "", "0% of the sum", "50% of the sum"]
    assert not any(second[robot + i].claim or second[robot + i].verdict for i in "1234")
    assert figures(1, result(0.1, force=0.0))[robot + "4"].verdict == ""


@pytest.mark.parametrize(("estimate", "verdict"), [(0.1, "holds"), (0.11, "fails")])
def test_theorem_1(estimate, verdict):
    """With xi = 1 and L = 4 the error may be 0.25; here it is sqrt(6) times `estimate`."""
    found = figures(1, result(0.1, estimate=estimate))["peak disturbance estimation error (norm)"]
    assert (found.claim, found.verdict) == ("at most xi/L = 2.5e-01", verdict)


def test_nothing_is_said_of_an_observer_that_is_not_there():
    data = result(0.1).assign_attrs(observer=0)
    assert not any("disturbance" in name for name in figures(1, data))


@pytest.mark.parametrize("status", ["diverged", "interrupted"])
def test_a_failed_run_is_not_compared(status):
    found = figures(1, result(0.1).assign_attrs(status=status))
    assert not any(f.claim or f.verdict for f in found.values())


def test_a_part_of_a_mission_is_not_compared():
    found = figures(1, result(0.1).isel(time=slice(0, 2)))
    assert not any(f.claim or f.verdict for f in found.values())
