"""Describing functions, growth rates and the theorems' bookkeeping, against known cases."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from reproduction.instability import fitted_rate, rightmost
from reproduction.slow_mode import harmonic_gain, slowest
from reproduction.theorems import Check

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
    values = np.exp(rate * TIME)[:, None] * np.stack([np.sin(angle), 3 * np.cos(angle)], axis=1)
    assert fitted_rate(TIME, values, 0.5) == pytest.approx(rate, abs=2e-3)


def test_poles_are_picked_by_frequency_and_growth():
    """Blocks with poles 0.5, -0.1 ± 2j, -0.2 ± 20j: the first is no oscillation."""
    A = np.zeros((5, 5))
    A[0, 0] = 0.5
    A[1:3, 1:3] = [[-0.1, 2.0], [-2.0, -0.1]]
    A[3:, 3:] = [[-0.05, 20.0], [-20.0, -0.05]]
    pole, shape = rightmost(A)
    assert pole == pytest.approx(-0.05 + 20j)
    assert_allclose(A @ shape, pole * shape, rtol=0, atol=ROUND_OFF)
    assert slowest(A) == pytest.approx(-0.1 + 2j)


def check(lyapunov, rate=1.0, sigma=0.5):
    """Return a run with a chosen V and a steady rate of the disturbance; L = 4, J = 1."""
    return Check(
        time=TIME,
        estimation_error=np.full(len(TIME), 0.2),
        lyapunov=lyapunov,
        disturbance_rate=np.full(len(TIME) - 1, rate),
        bandwidth=4.0,
        sigma=sigma,
        jacobian=1.0,
    )


def test_bounds_of_the_theorems():
    found = check(np.zeros(len(TIME)))
    assert found.error_bound == 0.25
    assert found.settled_error == 0.2
    assert found.least_sigma == 0.25
    assert found.rho == 0.5  # the lesser of 0.5 and 4 - 1 / 0.5
    assert found.ultimate_bound == pytest.approx(1.0 / (2 * 0.5 * 4))
    assert check(np.zeros(len(TIME)), sigma=0.2).ultimate_bound == np.inf


def test_v_that_falls_as_it_must_and_v_that_does_not():
    """Outside its bound of 1/4 V falls at the rate rho at least; a rise there is counted."""
    slow = check(0.25 + np.exp(-0.5 * TIME))
    assert slow.above.all()
    assert slow.rises == 0
    assert slow.largest_part == pytest.approx(1.0, abs=1e-4)
    rising = check(1.0 + 0.1 * TIME)
    assert rising.rises == len(TIME) - 1
    assert rising.largest_part > 1
