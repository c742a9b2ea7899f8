"""Noise is white, has the moments asked for, and is the same in every run."""

import itertools
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import assert_near

from trussflow.blocks import Drift, Noise
from trussflow.blocks.library.noise import uniform

# Round-off of logarithm and cosine, which NumPy and the C library compute differently.
BETWEEN_BACKENDS = 1e-13


def samples(respond, block, duration, **settings):
    options = {"log_step": 0.01, "backend": "numpy", "solver": "euler", **settings}
    return respond(block, duration, options)["block.y"].values[:-1]


def test_uniform_numbers_are_those_of_the_published_generator():
    """The first number from states of 12345 is printed in L'Ecuyer's own example."""
    state = np.full((3, 1), 12345.0)
    first, _, _ = uniform(state, state)
    assert first[0] == pytest.approx(0.127011122046577, abs=1e-15)


def test_recurrences_are_exact_in_doubles():
    """Doubles give the same integers as Python's unlimited ones."""
    numbers = np.random.default_rng(1).integers(1, 4294944443, (2, 3, 1))
    first, second = numbers.astype(float)
    x, y = numbers[0, :, 0].tolist(), numbers[1, :, 0].tolist()
    # The last two leave the largest remainders, where a rounded quotient would show.
    extremes = [
        0,
        1,
        4294944442,
        pow(810728, -1, 4294967087),
        pow(1370589, -1, 4294944443),
    ]
    for a, b, c in itertools.product(extremes, repeat=3):
        states = np.array([[a], [b], [c]], dtype=float)
        _, p, q = uniform(states, states)
        assert p[2, 0] == (1403580 * b - 810728 * a) % 4294967087
        assert q[2, 0] == (527612 * c - 1370589 * a) % 4294944443
    for _ in range(500):
        _, first, second = uniform(first, second)
        x = [*x[1:], (1403580 * x[1] - 810728 * x[0]) % 4294967087]
        y = [*y[1:], (527612 * y[2] - 1370589 * y[0]) % 4294944443]
        assert_array_equal([first[:, 0], second[:, 0]], [x, y])


def test_numbers_are_white_and_normal(respond):
    deviation, mean = np.tile([2.0, 0.5], 5), np.tile([1.0, -1.0], 5)
    block = Noise(deviation, 0.01, seed=3, mean=mean)
    y = samples(respond, block, 200.0, backend="interpreted")
    z = ((y - mean) / deviation).reshape(-1, 5, 2)  # 100,000 numbers of either kind
    four_sigma = 4 / np.sqrt(z[..., 0].size)
    assert_near(z.mean(axis=(0, 1)), 0.0, four_sigma)
    assert_near(z.var(axis=(0, 1)), 1.0, four_sigma * np.sqrt(2))
    assert_near((z**4).mean(axis=(0, 1)), 3.0, four_sigma * np.sqrt(96))
    # No memory: neither the numbers nor their squares depend on those before.
    assert_near((z[1:] * z[:-1]).mean(axis=(0, 1)), 0.0, four_sigma)
    squares = (z[1:] ** 2 * z[:-1] ** 2).mean(axis=(0, 1))
    assert_near(squares, 1.0, four_sigma * np.sqrt(8))
    assert abs((z[..., 0] * z[..., 1]).mean()) < four_sigma  # elements are independent


@pytest.mark.parametrize(
    "settings",
    [
        {"backend": "interpreted"},
        {"backend": "compiled"},
        {"step": 0.005, "solver": "rk4"},
        {"solver": "RK45"},
    ],
)
def test_numbers_depend_on_seed_and_instant_only(settings, respond):
    def noise(seed, **settings):
        return samples(
            respond, Noise([1.0, 1.0], 0.02, seed=seed), 0.4, log_step=0.02, **settings
        )

    reference = noise(7)
    assert_near(noise(7, **settings), reference, BETWEEN_BACKENDS)
    assert np.abs(noise(8) - reference).min() > 1e-6


def test_drift_is_a_random_walk(respond):
    """Its standard deviation is K √t, that of its steps K √T."""
    step, walk = 0.1, 0.3
    drift = samples(
        respond, Drift(walk, step, seed=5, shape=400), 100.0, step=step, log_step=step
    )
    times = np.arange(1, 1000) * step
    deviation = drift[1:].std(axis=1) / np.sqrt(times)
    assert_allclose(deviation, walk, rtol=4 / np.sqrt(800))
    steps = np.diff(drift, axis=0)
    assert steps.std() == pytest.approx(walk * np.sqrt(step), rel=0.01)


def test_drift_with_a_correlation_time_settles(respond):
    """From its stationary distribution on: variance K² τ/2 at all times, correlation e^(-t/τ)."""
    walk, time = 0.3, 2.0
    settled = walk * np.sqrt(time / 2)
    block = Drift(
        walk, 0.1, seed=5, shape=2000, correlation_time=time, initial_deviation=settled
    )
    y = samples(respond, block, 10.0, step=0.1, log_step=0.1)
    assert_allclose(y.std(axis=1), settled, rtol=4 / np.sqrt(4000))
    correlation = np.mean(y[:-20] * y[20:]) / settled**2
    assert correlation == pytest.approx(np.exp(-1), abs=0.02)


@pytest.mark.parametrize(
    "block", [Noise, partial(Drift, shape=3, initial_deviation=1.0)]
)
def test_seed_can_change_from_run_to_run(block, respond):
    def numbers(seed, **settings):
        return samples(
            respond, block(1.0, 0.1, seed=seed), 2.0, log_step=0.1, **settings
        )

    reference = numbers(7)
    again = numbers(8, parameters={"block.seed": 7}, backend="interpreted")
    assert_near(again, reference, BETWEEN_BACKENDS)
    assert np.abs(numbers(8) - reference).min() > 1e-6
