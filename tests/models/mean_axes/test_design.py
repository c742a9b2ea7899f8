"""Designs of the mean-axes loop: what makes no sense is refused, and what noise does to the gain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from systems import assert_near

from trussflow.models import FreeModes, MeanAxesDesign, ModelError, SpaceTruss
from trussflow.models.parameter_files import ParameterTable

DESIGN = MeanAxesDesign.shipped()


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"estimated_modes": 3.5}, "estimated_modes is 3.5; it must be a whole number"),
        ({"sample_time": "long"}, "sample_time must be numeric, not 'long'"),
        ({"sample_time": 0.0}, "sample_time is 0; it must be above 0"),
        ({"bandwidth": np.array([1.0, np.nan, 1.0])}, "bandwidth.* finite"),
        (
            {"bandwidth": np.array([1.0, 2.0])},
            r"bandwidth has shape \(2,\); it must be \(3,\)",
        ),
        ({"modal_noise": np.ones(3)}, r"modal_noise has shape \(3,\); it must be \(\)"),
        ({"modal_damping": -0.1}, "modal_damping is -0.1; it must be at least 0"),
        (
            {"damped_modes": 4},
            "4 modes cannot be damped with 3 estimated and 3 neutral ones; at most 3",
        ),
    ],
)
def test_designs_that_make_no_sense(changes, message):
    with pytest.raises(ModelError, match=message):
        replace(DESIGN, **changes)


def test_units_of_the_shipped_design_are_those_of_the_code():
    """Own files are compared with these units."""
    file = ParameterTable.shipped("mean_axes.toml")
    units = {
        name: entry["unit"]
        for table in ("mean_axes", "estimator", "monitor")
        for name, entry in file.mapping(table).items()
    }
    dimensional = {
        "sample_time": "s",
        "bandwidth": "rad/s",
        "effort": "kg*m^2/s^4",
        "resting_thrust": "N",
        "resting_error": "m",
        "propellant_spread": "kg",
        "unloading_time": "s",
        "acceleration_noise": "m/s^2/Hz^0.5",
        "modal_noise": "kg^0.5*m/s^2/Hz^0.5",
        "disturbance_noise": "m/s^3/Hz^0.5",
        "position_noise": "m",
        "rate_noise": "m/s",
        "unknown_thrust": "N",
        "unknown_torque": "N*m",
    }
    assert {n: u for n, u in units.items() if u != "1"} == dimensional


def test_gain_depends_on_the_ratio_of_noises_alone():
    free = FreeModes.of(SpaceTruss.consistent().dynamics, DESIGN.estimated_modes)
    names = (
        "acceleration_noise",
        "modal_noise",
        "disturbance_noise",
        "position_noise",
        "rate_noise",
    )
    louder = replace(DESIGN, **{name: 10.0 * getattr(DESIGN, name) for name in names})
    gain = DESIGN.estimator_gain(free)
    assert_near(louder.estimator_gain(free), gain, 1e-6 * np.abs(gain).max())
    blind = replace(DESIGN, position_noise=1e-2, rate_noise=1e-2).estimator_gain(free)
    assert np.abs(blind[:68]).max() < 0.5 * np.abs(gain[:68]).max()


def test_estimator_settles():
    """Predicted and corrected at rest, every error decays: eigenvalues inside the unit circle."""
    free = FreeModes.of(SpaceTruss.consistent().dynamics, DESIGN.estimated_modes)
    m, h = len(free.inertia), DESIGN.estimated_modes
    A = np.zeros((3 * m + 2 * h,) * 2)
    A[:m, m : 2 * m] = np.eye(m)
    A[m : 2 * m, 2 * m + 2 * h :] = np.linalg.inv(free.inertia)
    A[2 * m : 2 * m + h, 2 * m + h : 2 * m + 2 * h] = np.eye(h)
    A[2 * m + h : 2 * m + 2 * h, 2 * m : 2 * m + h] = -np.diag(
        free.frequencies[:h] ** 2
    )
    C = np.zeros((2 * m, len(A)))
    C[:, : 2 * m] = np.eye(2 * m)
    C[:m, 2 * m : 2 * m + h] = C[m:, 2 * m + h : 2 * m + 2 * h] = -free.root_motion
    error = expm(A * DESIGN.sample_time) @ (
        np.eye(len(A)) - DESIGN.estimator_gain(free) @ C
    )
    assert np.abs(np.linalg.eigvals(error)).max() < 0.99995
