"""Measures of signals whose measures are known."""

import numpy as np
import pytest
import xarray as xr
from reproduction.measures import envelope, measured, ripple, theorem_measures

TIME = np.linspace(0.0, 8.0, 1601)
STEADY = np.ones(len(TIME) - 1)


def test_ripple_is_the_root_mean_square_of_the_fast_part():
    """A drift and a slow oscillation do not count; switching at every instant counts in full."""
    switching = 0.3 * (-1.0) ** np.arange(len(TIME))
    assert ripple(TIME, np.stack([TIME, 2 - TIME], axis=1)) == pytest.approx(
        0.0, abs=1e-12
    )
    assert ripple(
        TIME, np.stack([np.sin(0.5 * TIME), switching], axis=1)
    ) == pytest.approx(0.3, rel=0.03)
    fast = np.sin(2 * np.pi * 20 * TIME)
    # sqrt(1/2 + 1/2)
    assert ripple(TIME, np.stack([fast, fast], axis=1)) == pytest.approx(1.0, rel=0.05)


def test_envelope_has_the_maxima_of_the_absolute_value():
    instants, maxima = envelope(TIME, -2.0 * np.sin(np.pi * TIME))
    assert instants == pytest.approx(np.arange(8) + 0.5)
    assert maxima == pytest.approx(2.0)


def run():
    """Return a run in which each signal has one element, at one instant, of known size."""
    n, late = len(TIME), int(0.9 * len(TIME))
    signals = {name: np.zeros((n, 34)) for name in TASK}
    signals |= {
        f"{part}_error{end}": np.zeros((n, size))
        for part, size in PARTS
        for end in ("", "_rate")
    }
    signals |= {"attitude": np.zeros((n, 3)), "joint_rate": np.zeros((n, 28))}
    signals |= {
        name: np.zeros((n, 4, 3))
        for name in ("grasp_displacement", "base_force", "base_torque")
    }
    signals |= {"joint_torque": np.zeros((n, 28)), "modal_coordinate": np.zeros((n, 6))}
    signals["position_error"][[100, late], 0] = [3.0, -1.0]
    signals["attitude_error"][100, 1], signals["joint_error"][100, 21] = -2.0, 0.5
    signals["generalized_force"][100:, 2] = 4.0
    signals["base_force"][0, 0] = [3.0, 4.0, 0.0]
    signals["base_force"][1, 3] = [0.0, 0.0, -15.0]
    signals["base_torque"][5, 0, 1], signals["joint_torque"][7, 21] = 3.0, -2.0
    signals["grasp_displacement"][9, 2, 1] = -0.1
    signals["disturbance"] += TIME[:, None]
    data = {
        name: (("time", *(f"{name}_{i}" for i in range(1, v.ndim))), v)
        for name, v in signals.items()
    }
    attrs = {"parameters": '{"observer.gain": [4.0, 4.0], "controller.sigma": 0.3}'}
    return xr.Dataset(data, {"time": TIME}, attrs)


TASK = ("generalized_force", "disturbance", "disturbance_estimate", "sliding_variable")
PARTS = (("position", 3), ("attitude", 3), ("joint", 28))


def test_measures_of_a_run():
    found = measured(run())
    expected = {
        "peak position error": 3.0,
        "late position error": 1.0,
        "peak attitude error": 2.0,
        "peak angle of C41": 0.5,
        "largest jump of force per peak": 1.0,
        "share of Robot 1": 0.25,
        "share of Robot 4": 0.75,
        "peak elastic displacement at grasp 3": 0.1,
        "largest torque": 3.0,
        "time of the largest torque": TIME[5],
        "largest torque of Robot 4": 2.0,
        "time of the largest torque of Robot 4": TIME[7],
        "L": 4.0,
        "sigma": 0.3,
        "xi": np.sqrt(34),
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def theorems(lyapunov, sigma=0.5, error=0.2 + 0.0 * TIME):
    """Return the measures for a chosen V and a steady rate of the disturbance; L = 4, J = 1."""
    return theorem_measures(
        TIME, error, lyapunov, STEADY, L=4.0, sigma=sigma, jacobian=1.0
    )


def test_bounds_of_the_theorems():
    found = theorems(np.zeros(len(TIME)))
    expected = {
        "bound of Theorem 1": 0.25,
        "settled estimation error": 0.2,
        "slack of Theorem 1": 1.25,
        "least sigma": 0.25,
        "rho": 0.5,  # the lesser of 0.5 and 4 - 1 / 0.5
        "ultimate bound of V": 1.0 / (2 * 0.5 * 4),
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert theorems(np.zeros(len(TIME)), sigma=0.2)["ultimate bound of V"] == np.inf


def test_solutions_of_the_limiting_equations_take_all_of_their_bounds():
    """Eqs. 51 and 61 hold with equality if those before them do."""
    found = theorems(
        0.25 * (1.0 - np.exp(-0.5 * TIME)),
        error=0.25 * np.sqrt(1.0 - np.exp(-4.0 * TIME)),
    )
    for equation in (51, 61):
        part = found[f"largest part of the bound of Eq. {equation}"]
        assert part == pytest.approx(1.0, rel=1e-9)


def test_v_that_falls_as_it_must_and_v_that_does_not():
    """Outside its bound of 1/4 V falls at least at the rate rho; a rise there is counted."""
    slow = theorems(0.25 + np.exp(-0.5 * TIME))
    assert slow["time of V above its bound"] == 1.0
    assert slow["instants at which V rises though it must fall"] == 0
    assert slow["largest part of the bound on the slope"] == pytest.approx(
        1.0, abs=1e-4
    )
    rising = theorems(1.0 + 0.1 * TIME)
    assert rising["instants at which V rises though it must fall"] == len(TIME) - 1
    assert rising["largest part of the bound on the slope"] > 1
