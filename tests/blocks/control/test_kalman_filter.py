"""Kalman filters of linear systems: against other libraries, least squares, filters without delay."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import quad_vec
from scipy.linalg import expm, solve_discrete_are
from systems import assert_near

from trussflow.blocks.control import ExtendedKalmanFilter, KalmanFilter, LinearProcess
from trussflow.blocks.control.covariances import sampled_covariance

TOLERANCE = 1e-10
SEEDS = range(20)


def plant(seed, n=5, m=2, k=2):
    """Return matrices and covariances of a random process, some of whose modes grow."""
    g = np.random.default_rng(seed)
    A = g.normal(size=(n, n))
    A *= g.uniform(0.5, 1.1) / np.abs(np.linalg.eigvals(A)).max()
    root, noisy = g.normal(size=(n, n)), g.normal(size=(m, m))
    return {
        "A": A,
        "B": g.normal(size=(n, k)),
        "C": g.normal(size=(m, n)),
        "D": g.normal(size=(m, k)),
        "covariance": root @ root.T,
        "noise": noisy @ noisy.T + 0.1 * np.eye(m),
        "every": 0.1,
    }


@pytest.mark.parametrize("seed", SEEDS)
def test_gain_is_that_of_python_control_and_scipy(seed):
    """python-control gives the gain from measurement to next prediction, A K."""
    of = plant(seed)
    A, C, Q, R = (of[name] for name in ("A", "C", "covariance", "noise"))
    block = KalmanFilter(LinearProcess(**of))
    theirs, P, _ = control.dlqe(A, np.eye(len(A)), C, Q, R)
    assert_near(A @ block.gain, theirs, TOLERANCE)
    P = solve_discrete_are(A.T, C.T, Q, R)
    after = np.linalg.inv(np.linalg.inv(P) + C.T @ np.linalg.inv(R) @ C)
    assert_allclose(block.covariance, after, rtol=TOLERANCE, atol=TOLERANCE * P.max())
    assert_allclose(block.innovation_covariance, C @ P @ C.T + R, rtol=TOLERANCE)


@pytest.mark.parametrize("factor", [1e-24, 1e-12, 1e12])
def test_gain_does_not_depend_on_the_unit_of_noise(factor):
    of = plant(4)
    expected = KalmanFilter(LinearProcess(**of)).gain
    scaled = {name: factor * of[name] for name in ("covariance", "noise")}
    gain = KalmanFilter(LinearProcess(**of | scaled)).gain
    assert_near(gain, expected, TOLERANCE)


def covariance(block, found, k):
    """Return the covariance of an estimate: constant in the steady filter."""
    return found["covariance"][k] if "covariance" in found else block.covariance


@pytest.mark.parametrize("behind, ahead", [(0, 0), (2, 0), (0, 3), (2, 1)])
@pytest.mark.parametrize("make", [KalmanFilter, ExtendedKalmanFilter])
def test_delays_shift_the_filter_without(behind, ahead, make, follow):
    """What was measured arrives later, and was commanded earlier: the same numbers, bit by bit."""
    of, g, late = plant(1), np.random.default_rng(1), behind + ahead
    settings = {"initial_covariance": 3.0} if make is ExtendedKalmanFilter else {}
    y, acting = g.normal(size=(40, 2)), g.normal(size=(40, 2))
    prompt = make(LinearProcess(**of), **settings)
    plain = follow(prompt, y, acting)
    told = y - plain["predicted"] @ of["C"].T - acting @ of["D"].T
    assert_near(plain["innovation"], told, TOLERANCE)
    delays = {"measurement_delay": 0.1 * behind, "command_delay": 0.1 * ahead}
    delayed = make(
        LinearProcess(**of), **settings, **delays, initial_command=acting[:late]
    )
    # From where the first measurement arrives: the command given then acts `ahead` samples later.
    ours = follow(delayed, y[: 40 - late], acting[late:])
    for name in ("innovation", "predicted"):
        assert_array_equal(ours[name], plain[name][: 40 - late])
    A, B = of["A"], of["B"]
    for k in (0, 5, 30):
        x, P = plain["estimate"][k], covariance(prompt, plain, k)
        for i in range(k, k + behind):
            x, P = A @ x + B @ acting[i], A @ P @ A.T + of["covariance"]
        assert_array_equal(ours["estimate"][k], x)
        assert_array_equal(covariance(delayed, ours, k), P)
        for i in range(k + behind, k + late):
            x = A @ x + B @ acting[i]
        assert_array_equal(ours["prediction"][k], x)


def test_noise_is_sampled_exactly():
    """Against the integral by quadrature; a stiff system too, whose exponential of -A overflows."""
    density = np.array([[1.0, 0.2, 0.0], [0.2, 2.0, 0.0], [0.0, 0.0, 0.5]])
    for A in (
        np.array([[0.0, 1.0, 0.0], [-4.0, -0.1, 1.0], [0.0, 0.0, -0.01]]),
        np.diag([-1e5, -3.0, 0.0]),
    ):

        def spread(s, A=A):
            return expm(A * s) @ density @ expm(A * s).T

        expected, _ = quad_vec(
            spread, 0.0, 0.3, epsabs=1e-13, points=[1e-5, 1e-4, 1e-3]
        )
        assert_allclose(
            sampled_covariance(A, density, 0.3), expected, rtol=1e-10, atol=1e-13
        )
