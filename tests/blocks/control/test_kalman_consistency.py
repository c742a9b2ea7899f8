"""Filters err as much as they say, and their innovations are white: over many seeds.

Bar-Shalom, Li, Kirubarajan (2001), section 5.4: bounds of chi-square, here of 99.9 %, as the seeds are fixed.
"""

import campaign
import numpy as np
import pytest
from scipy.stats import binom, chi2

from trussflow.blocks import GaussMarkov, StateSpace, kalman_filter
from trussflow.blocks.control import ExtendedKalmanFilter, NonlinearProcess

RUNS = 40 * campaign.SIZE
LAGS = 30


def within(values, freedom, share=0.999):
    """Tell whether a sum of squares is within the band of chi-square."""
    low, high = (chi2.ppf((1 + side * share) / 2, freedom) for side in (-1, 1))
    return low < np.sum(values) < high


def normalized(errors, covariances):
    """Return e^T P^-1 e of each sample."""
    return np.einsum(
        "...i,...i", errors, np.linalg.solve(covariances, errors[..., None])[..., 0]
    )


def check(runs):
    """Check several runs of a filter: errors, their covariance, innovations and their covariance."""
    errors, P, innovations, S = map(np.array, zip(*runs, strict=True))
    count, samples, n = errors.shape
    nees, nis = normalized(errors, P), normalized(innovations, S)
    # Errors go together in time, not over runs: as many bands as samples far from each other.
    for k in np.linspace(0, samples - 1, 5).astype(int):
        assert within(nees[:, k], count * n)
    assert within(nis, nis.size * innovations.shape[-1])
    # White: products of whitened innovations at a lag have mean 0 and variance 1, so that 95 of 100 sums are
    # within 1.96 standard deviations; how many are so out of all lags and runs is binomial.
    white = np.linalg.solve(np.linalg.cholesky(S), innovations[..., None])[..., 0]
    correlations = np.array(
        [
            np.sum(white[:, lag:] * white[:, :-lag], axis=(1, 2))
            / np.sqrt(white[0, lag:].size)
            for lag in range(1, LAGS + 1)
        ]
    )
    inside = np.sum(np.abs(correlations) < 1.96)
    low, high = (binom.ppf(p, correlations.size, 0.95) for p in (0.0005, 0.9995))
    assert low <= inside <= high
    assert within(np.sum(correlations, axis=1) ** 2 / count, LAGS)


def errors_of(found, states):
    return found["estimate"] - states, *(
        found[name] for name in ("covariance", "innovation", "innovation_covariance")
    )


FIRST = np.diag([1e-4, 1e-4, 1e-2, 1e-2, 0.16])


def linear(kind, first=None, delay=0.0):
    """Return a filter for two masses on springs: force on the one, wind on the other."""
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [-30, 20, -0.5, 0.3], [20, -20, 0.3, -0.3]]
    B = [[0, 0], [0, 0], [0.5, 0], [0, 1]]
    return kalman_filter(
        StateSpace(A, B, np.eye(2, 4)),
        inputs="u[0]",
        every=0.05,
        measurement_noise=[1e-4, 1e-5],
        process_noise={"u[0]": 1e-3, "u[1]": 2e-3},
        disturbances={"u[1]": GaussMarkov(0.4, 2.0)},
        measurement_delay=delay,
        kind=kind,
        initial_covariance=first,
    )


@pytest.mark.parametrize("kind", ["steady", "varying"])
def test_linear_filter_is_consistent(kind, follow, draw):
    first, samples, runs = FIRST, 60, []
    if kind == "steady":
        plain = linear("steady")
        first = (
            plain.process.A @ plain.covariance @ plain.process.A.T
            + plain.process.covariance
        )
    block = linear(kind, None if kind == "steady" else first, delay=0.1)
    late = block.behind
    for seed in range(RUNS):
        g = np.random.default_rng([7, seed])
        u = np.concatenate([np.zeros((late, 1)), g.normal(size=(samples, 1))])
        x, y = draw(block, g, u, first)
        found = follow(block, y[:samples], u[late:])
        if kind == "steady":
            for name in ("covariance", "innovation_covariance"):
                found[name] = np.tile(getattr(block, name), (samples, 1, 1))
        runs.append(errors_of(found, x[late:]))
    check(runs)


def pendulum(_, x, __):
    return np.stack([x[1], -9.81 * np.sin(x[0]) - 0.2 * x[1]])


def sideways(_, x, __):
    return np.stack([np.sin(x[0])])


def falling(_, x, __):
    """Height [km], speed [km/s] and drag coefficient [1/km] of a body that enters the atmosphere."""
    return np.stack(
        [-x[1], 9.81e-3 - x[2] * np.exp(-x[0] / 7.0) * x[1] ** 2, 0.0 * x[2]]
    )


def radar(_, x, __):
    """Distance from a radar 30 km aside [km]."""
    return np.stack([np.sqrt(900.0 + x[0] ** 2)])


@pytest.mark.parametrize(
    "rates, outputs, start, spread, density, every",
    [
        (pendulum, sideways, [1.0, 0.0], [1e-3, 1e-3], [0, 1e-3], 0.05),
        (falling, radar, [60.0, 3.0, 0.05], [1e-2, 1e-4, 1e-5], [0, 1e-6, 1e-9], 0.2),
    ],
    ids=["pendulum", "falling body"],
)
def test_extended_filter_is_consistent(
    rates, outputs, start, spread, density, every, follow
):
    n, noise, fine = len(start), 1e-4, 20
    process = NonlinearProcess(
        rates,
        outputs,
        states=n,
        measurements=1,
        density=density,
        noise=noise,
        every=every,
    )
    block = ExtendedKalmanFilter(
        process, initial_estimate=start, initial_covariance=spread
    )
    g, h = np.random.default_rng(11), every / fine
    diffusion = np.sqrt(h * np.array(density))[:, None]
    x = np.array(start)[:, None] + np.sqrt(spread)[:, None] * g.normal(size=(n, RUNS))
    states, measured = [], []
    for _ in range(60):
        states.append(x)
        measured.append(
            outputs(0.0, x, None) + np.sqrt(noise) * g.normal(size=(1, RUNS))
        )
        for _ in range(fine):
            middle = x + h / 2 * rates(0.0, x, None)
            x = x + h * rates(0.0, middle, None) + diffusion * g.normal(size=(n, RUNS))
    check(
        [
            errors_of(
                follow(block, np.array(measured)[:, :, run]),
                np.array(states)[:, :, run],
            )
            for run in range(RUNS)
        ]
    )


def test_a_tenth_more_noise_than_designed_for_is_inconsistent(follow, draw):
    block, runs = linear("varying", FIRST), []
    for seed in range(40):
        g = np.random.default_rng([8, seed])
        u = g.normal(size=(60, 1))
        x, y = draw(block, g, u, FIRST)
        found = follow(
            block, y + np.sqrt(0.21) * g.normal(size=y.shape) * [1e-2, 10**-2.5], u
        )
        runs.append(errors_of(found, x))
    with pytest.raises(AssertionError):
        check(runs)
