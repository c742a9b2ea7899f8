"""The summary: figures of merit of a made-up result."""

import numpy as np
import pytest
import xarray as xr

from trussflow.models.transport import Mission, summarize

TIME = np.array([0.0, 30.0, 60.0, 80.0])  # s


def result(torque, *, estimate=0.0):
    """Return four robots that push alike, and a disturbance that grows by 1 a second."""
    vector, robots, joints = np.zeros((4, 3)), np.zeros((4, 4, 3)), np.zeros((4, 28))
    shares = np.array([2.0, 2.0, 0.0, 4.0])[:, None]
    disturbance = np.zeros((4, 6))
    disturbance[:, 0] = TIME
    return xr.Dataset(
        {
            "position_error": (("time", "axis"), np.outer([3.0, 0.0, 0.0, -1.0], np.ones(3))),
            "attitude_error": (("time", "angle"), vector),
            "joint_error": (("time", "joint"), joints),
            "base_force": (("time", "robot", "axis"), robots - shares),
            "base_torque": (("time", "robot", "axis"), robots - torque),
            "joint_torque": (("time", "joint"), joints),
            "grasp_displacement": (("time", "robot", "axis"), robots),
            "disturbance": (("time", "speed"), disturbance),
            "disturbance_estimate": (("time", "speed"), disturbance + estimate),
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


def test_peaks_of_forces_and_torques_are_components():
    found = figures(1, result(0.25))
    assert found["peak base torque"].value == 0.25
    assert [found[f"peak base force, Robot {i}"].value for i in "1234"] == [2.0, 2.0, 0.0, 4.0]


def test_the_estimation_error_is_the_norm_of_all_channels():
    found = figures(1, result(0.1, estimate=0.1))["peak disturbance estimation error (norm)"]
    assert found.value == pytest.approx(np.sqrt(6.0) * 0.1)


def test_nothing_is_said_of_an_observer_that_is_not_there():
    data = result(0.1).assign_attrs(observer=0)
    assert not any("disturbance" in name for name in figures(1, data))
