"""Describing functions, growth rates and stability limits of known cases."""

import numpy as np
import pytest
from reproduction.instability import DAMPINGS, fitted_rate
from reproduction.slow_mode import SLOW_BAND, limit_cycle
from study_tools.stability import harmonic_gain, rightmost, stable_damping
from systems import assert_near

TIME = np.linspace(0.0, 10.0, 2001)
ROUND_OFF = 1e-12  # of an eigenvector of length one, for an eigenvalue of 20


@pytest.mark.parametrize("exponent", [0.5, 0.9, 1.0, 3.0])
def test_harmonic_gain_is_the_first_harmonic(exponent):
    phase = (np.arange(200_000) + 0.5) * 2 * np.pi / 200_000
    x = 0.3 * np.sin(phase)
    first = 2 * np.mean(np.abs(x) ** exponent * np.sign(x) * np.sin(phase)) / 0.3
    assert harmonic_gain(np.array(0.3), exponent) == pytest.approx(first, rel=1e-6)


@pytest.mark.parametrize("rate", [-0.7, 0.0, 3.0])
def test_fitted_rate_of_a_growing_oscillation(rate):
    angle = 2 * np.pi * 2.0 * TIME
    values = np.exp(rate * TIME)[:, None] * np.stack(
        [np.sin(angle), 3 * np.cos(angle)], axis=1
    )
    assert fitted_rate(TIME, values, 0.5) == pytest.approx(rate, abs=2e-3)


def test_poles_are_picked_by_frequency_and_growth():
    """Blocks with poles 0.5, -0.1 ± 2j, -0.2 ± 20j: the first is no oscillation."""
    A = np.zeros((5, 5))
    A[0, 0] = 0.5
    A[1:3, 1:3] = [[-0.1, 2.0], [-2.0, -0.1]]
    A[3:, 3:] = [[-0.05, 20.0], [-20.0, -0.05]]
    pole, shape = rightmost(A)
    assert pole == pytest.approx(-0.05 + 20j)
    assert_near(A @ shape, pole * shape, ROUND_OFF)
    assert rightmost(A, *SLOW_BAND)[0] == pytest.approx(-0.1 + 2j)


@pytest.mark.parametrize(
    "unstable, damping",
    [
        ([0, 0, 0, 0, 0, 0], 0.0),
        ([1, 0, 1, 0, 0, 0], 0.02),
        ([1, 1, 1, 1, 1, 1], np.inf),
    ],
)
def test_stable_damping_is_above_all_unstable_ones(unstable, damping):
    assert stable_damping(np.array(unstable) - 0.5, DAMPINGS) == damping


def test_limit_cycle_is_at_the_amplitude_without_growth():
    assert limit_cycle(np.array([2.0, 1.0, -1.0, -2.0, -3.0, -4.0])) == pytest.approx(
        np.sqrt(0.1 * 0.3)
    )
    assert np.isnan(limit_cycle(-np.ones(6)))
