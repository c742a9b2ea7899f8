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
            "position_error": (
                ("time", "axis"),
                np.outer([3.0, 0.0, 0.0, -1.0], np.ones(3)),
            ),
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


def figures(data):
    """Return the values of the figures of merit by name."""
    return {f.name: f.value for f in summarize(data, Mission.of_case(1))}


def test_peak_and_final_values_are_the_largest_components_of_either_sign():
    found = figures(result(0.25))
    assert found["peak position error"] == 3.0
    assert found["final position error"] == 1.0
    assert found["peak base torque"] == 0.25
    assert [found[f"peak base force, Robot {i}"] for i in "1234"] == [
        2.0,
        2.0,
        0.0,
        4.0,
    ]


def test_the_estimation_error_is_the_norm_of_all_channels_of_an_observer():
    name, data = "peak disturbance estimation error (norm)", result(0.1, estimate=0.1)
    assert figures(data)[name] == pytest.approx(np.sqrt(6.0) * 0.1)
    assert name not in figures(data.assign_attrs(observer=0))
