"""Metrics are the largest values over the run, late ones over its end."""

import numpy as np
import xarray as xr
from flight.metrics import LATE_WINDOW, METRICS, heading, run_metrics
from numpy.testing import assert_allclose

from trussflow.models.reporting.metrics import tracking_metrics


def run():
    time = np.linspace(0.0, 100.0, 501)
    late = time >= 100.0 - LATE_WINDOW
    error = np.zeros((501, 34))
    error[100, :3] = [3e-3, 4e-3, 0.0]
    error[460, :3] = [0.0, 0.0, 3e-4]
    error[496, :3] = [0.0, 6e-5, -8e-5]
    error[100, 4] = -2e-3
    error[100, 20] = 0.03
    force = np.where(late[:, None, None], 0.1, -3.0) * np.ones((501, 4, 3))
    ports = {
        "trajectory.position": np.ones((501, 34)),
        "truss.task_position": 1.0 + error,
        "truss.base_force": force,
        "truss.base_torque": 0.1 * force,
        "truss.joint_torque": np.full((501, 28), -0.2),
        "truss.grasp_displacement": np.full((501, 4, 3), 1e-3),
        "actuators.used.y": np.outer(time, [1.0, 2.0, 3.0, 4.0]),
        "controller.monitor.effectiveness": np.ones((501, 52)),
        "faults.base_effect": np.ones((501, 4)),
        "faults.valves": np.zeros((501, 52)),
    }
    return xr.Dataset(
        {
            k: (("time", *(f"{k}_{i}" for i in range(v.ndim - 1))), v)
            for k, v in ports.items()
        },
        {"time": time},
    )


def test_metrics_of_known_curves():
    found = run_metrics(run())
    assert set(found) < set(METRICS)
    expected = {
        "position": 5e-3,
        "attitude": 2e-3,
        "joints": 0.03,
        "force": 3.0,
        "base torque": 0.3,
    }
    expected |= {
        "joint torque": 0.2,
        "late position": 1e-4,
        "late attitude": 0.0,
        "late joints": 0.0,
    }
    expected |= {
        "late grasp 4": 1e-3 * 3**0.5,
        "late force": 0.1,
        "propellant": 1000.0,
        "isolated after": np.nan,
    }
    for name, value in (expected | {"false alarms": 0.0}).items():
        assert_allclose(found[name], value, rtol=1e-9, atol=1e-12)


def test_each_error_as_norm_and_component_over_the_run_late_and_at_its_end():
    error = np.array([[3.0, -4.0], [0.6, 0.8], [-0.5, 1.2]])
    found = tracking_metrics(np.array([0.0, 90.0, 100.0]), {"position": error})
    expected = {"peak": (5.0, 4.0), "late": (1.3, 1.2), "final": (1.3, 1.2)}
    for part, (norm, component) in expected.items():
        assert_allclose(found[f"{part} position (norm)"], norm, rtol=1e-15)
        assert_allclose(found[f"{part} position (component)"], component, rtol=1e-15)
    assert (
        tracking_metrics(np.array([0.0, 100.0]), {"joints": np.zeros((2, 0))})[
            "peak joints (norm)"
        ]
        == 0.0
    )


def test_headings_have_kind_and_unit():
    expected = {
        "position": "position (norm) [mm]",
        "attitude, worst": "attitude (component) [mrad]: worst",
        "propellant": "propellant [g]",
        "seed": "seed",
    }
    assert [heading(name) for name in expected] == list(expected.values())


def test_an_alarm_at_any_time_counts():
    alarmed = run()
    alarmed["controller.monitor.effectiveness"][300:400, 6:12] = 0.0
    assert run_metrics(alarmed)["false alarms"] == 1.0
