"""Filters err as much as they say, and their innovations are white: over many seeds.

Bar-Shalom, Li, Kirubarajan (2001), section 5.4: bounds of chi-square, here of 99.9 %, as the seeds are fixed.
"""

import os
from collections.abc import Callable
from typing import Any

import control
import numpy as np
import pytest
from scipy.stats import binom, chi2

from trussflow.blocks import ExtendedKalmanFilter, GaussMarkov, NonlinearProcess, kalman_filter
from trussflow.blocks.framework.types import Vector

Follow = Callable[..., dict[str, Vector]]
RUNS = int(os.environ.get("TRUSSFLOW_CONSISTENCY_RUNS", "40"))
LAGS = 30


def within(values, freedom, share=0.999):
    """Tell whether a sum of squares is within the band of chi-square."""
    low, high = (chi2.ppf((1 + side * share) / 2, freedom) for side in (-1, 1))
    return bool(low < np.sum(values) < high)


def normalized(errors, covariances):
    """Return e^T P^-1 e of each sample."""
    whole: Vector = np.einsum("...i,...i", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])
    return whole


def check(errors, P, innovations, S):
    """Check what the runs of a filter tell: arrays (runs, samples, ...)."""
    runs, samples, n = errors.shape
    nees, nis = normalized(errors, P), normalized(innovations, S)
    # Errors go together in time, not over runs: as many bands as samples far from each other.
    for k in np.linspace(0, samples - 1, 5).astype(int):
        assert within(nees[:, k], runs * n), (k, nees[:, k].mean(), n)
    assert within(nis, nis.size * innovations.shape[-1]), (nis.mean(), innovations.shape[-1])
    # White: products of whitened innovations at a lag have mean 0 and variance 1, so that 95 of 100 sums are
    # within 1.96 standard deviations; how many are so out of all lags and runs is binomial.
    white = np.linalg.solve(np.linalg.cholesky(S), innovations[..., None])[..., 0]
    correlations = np.array(
        [
            np.sum(white[:, lag:] * white[:, :-lag], axis=(1, 2)) / np.sqrt(white[0, lag:].size)
            for lag in range(1, LAGS + 1)
        ]
    )
    inside = np.sum(np.abs(correlations) < 1.96)
    low, high = (binom.ppf(p, correlations.size, 0.95) for p in (0.0005, 0.9995))
    assert low <= inside <= high, inside / correlations.size
    assert within(np.sum(correlations, axis=1) ** 2 / runs, LAGS)


SPREADS = ("covariance", "innovation", "innovation_covariance")


def linear(kind, first, delay=0.0):
    """Return a filter for two masses on springs: force on the one, wind on the other."""
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [-30, 20, -0.5, 0.3], [20, -20, 0.3, -0.3]]
    B = [[0, 0], [0, 0], [0.5, 0], [0, 1]]
    return kalman_filter(
        control.ss(A, B, np.eye(2, 4), 0, inputs=["force", "wind"]),
        inputs="force",
        every=0.05,
        measurement_noise=[1e-4, 1e-5],
        process_noise={"force": 1e-3, "wind": 2e-3},
        disturbances={"wind": GaussMarkov(0.4, 2.0)},
        measurement_delay=delay,
        kind=kind,
        initial_covariance=first,
    )


@pytest.mark.parametrize("kind", ["steady", "varying"])
def test_linear_filter_is_consistent(kind, follow, draw):
    first, samples, collected = np.diag([1e-4, 1e-4, 1e-2, 1e-2, 0.16]), 60, []
    if kind == "steady":
        plain = linear("steady", None)
        first = plain.process.A @ plain.covariance @ plain.process.A.T + plain.process.covariance
    block = linear(kind, None if kind == "steady" else first, delay=0.1)
    late = block.behind
    for seed in range(RUNS):
        g = np.random.default_rng([7, seed])
        u = np.concatenate([np.zeros((late, 1)), g.normal(size=(samples, 1))])
        x, y = draw(block, g, samples + late, u, first)
        found = follow(block, y[:samples], u[late:])
        if kind == "steady":
            for name in ("covariance", "innovation_covariance"):
                found[name] = np.tile(getattr(block, name), (samples, 1, 1))
        collected.append((found["estimate"] - x[late:], *(found[name] for name in SPREADS)))
    check(*map(np.array, zip(*collected, strict=True)))


def pendulum(_, x, __):
    return np.stack([x[1], -9.81 * np.sin(x[0]) - 0.2 * x[1]])


def falling(_, x, __):
    """Height [km], speed [km/s] and drag coefficient [1/km] of a body that enters the atmosphere."""
    return np.stack([-x[1], 9.81e-3 - x[2] * np.exp(-x[0] / 7.0) * x[1] ** 2, 0.0 * x[2]])


def radar(_, x, __):
    """Distance from a radar 30 km aside [km]."""
    return np.stack([np.sqrt(900.0 + x[0] ** 2)])


CASES: dict[str, tuple[Any, ...]] = {
    "pendulum": (
        pendulum,
        lambda _, x, __: np.stack([np.sin(x[0])]),
        [1.0, 0.0],
        [1e-3, 1e-3],
        [0, 1e-3],
        1e-4,
        0.05,
    ),
    "falling body": (falling, radar, [60.0, 3.0, 0.05], [1e-2, 1e-4, 1e-5], [0, 1e-6, 1e-9], 1e-4, 0.2),
}


@pytest.mark.parametrize("case", CASES)
def test_extended_filter_is_consistent(case, follow):
    rates, outputs, start, spread, density, noise, every = CASES[case]
    n, samples, fine = len(start), 60, 20
    process = NonlinearProcess(
        rates, outputs, states=n, measurements=1, density=density, noise=noise, every=every
    )
    block = ExtendedKalmanFilter(process, initial_estimate=start, initial_covariance=spread)
    g, h, u = np.random.default_rng(11), every / fine, np.zeros(0)
    x = np.array(start)[:, None] + np.sqrt(spread)[:, None] * g.normal(size=(n, RUNS))
    states, measured = [], []
    for _ in range(samples):
        states.append(x)
        measured.append(outputs(0.0, x, u) + np.sqrt(noise) * g.normal(size=(1, RUNS)))
        for _ in range(fine):
            middle = x + h / 2 * rates(0.0, x, u)
            x = (
                x
                + h * rates(0.0, middle, u)
                + np.sqrt(h * np.array(density))[:, None] * g.normal(size=(n, RUNS))
            )
    collected = []
    for run in range(RUNS):
        found = follow(block, np.array(measured)[:, :, run])
        collected.append(
            (found["estimate"] - np.array(states)[:, :, run], *(found[name] for name in SPREADS))
        )
    check(*map(np.array, zip(*collected, strict=True)))


def test_the_check_sees_a_filter_that_believes_too_much(follow, draw):
    """A tenth more noise than the filter believes is seen: the bands are no rubber."""
    first = np.diag([1e-4, 1e-4, 1e-2, 1e-2, 0.16])
    block, collected = linear("varying", first), []
    for seed in range(40):
        g = np.random.default_rng([8, seed])
        u = g.normal(size=(60, 1))
        x, y = draw(block, g, 60, u, first)
        found = follow(block, y + np.sqrt(0.21) * g.normal(size=y.shape) * [1e-2, 10**-2.5], u)
        collected.append((found["estimate"] - x, *(found[name] for name in SPREADS)))
    with pytest.raises(AssertionError):
        check(*map(np.array, zip(*collected, strict=True)))
