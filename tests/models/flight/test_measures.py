"""Measures are the greatest values, late ones of the end."""

import numpy as np
import xarray as xr
from numpy.testing import assert_allclose

from trussflow.models.flight.measures import SETTLED, UNITS, measured


def run():
    time = np.linspace(0.0, 50.0, 501)
    late = time >= 50.0 - SETTLED
    error = np.zeros((501, 34))
    error[100, :3] = [3e-3, 4e-3, 0.0]
    error[450, :3] = [0.0, 6e-5, -8e-5]
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
        "controller.monitor.evidence": np.outer(time, np.arange(8.0)),
        "controller.monitor.effectiveness": np.ones((501, 52)),
    }
    return xr.Dataset(
        {k: (("time", *(f"{k}_{i}" for i in range(v.ndim - 1))), v) for k, v in ports.items()}, {"time": time}
    )


def test_of_known_curves():
    found = measured(run())
    assert list(found) == list(UNITS)
    expected = {"position": 5e-3, "attitude": 2e-3, "joints": 0.03, "force": 3.0, "torque": 0.3}
    expected |= {"joint torque": 0.2, "late position": 1e-4, "late attitude": 0.0, "late joints": 0.0}
    expected |= {"late grasp 4": 1e-3 * 3**0.5, "late force": 0.1, "propellant": 500.0, "evidence": 350.0}
    for name, value in (expected | {"alarms": 0.0}).items():
        assert_allclose(found[name], value, rtol=1e-9, atol=1e-12)


def test_an_alarm_at_any_time_counts():
    alarmed = run()
    alarmed["controller.monitor.effectiveness"][300:, 7] = 0.0
    assert measured(alarmed)["alarms"] == 1.0
