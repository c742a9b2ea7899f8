"""Noise is white, has the moments asked for, and is the same in every run."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks import BlockError, Drift, Noise, ParameterError
from trussflow.blocks.library.noise import uniform

Respond = Callable[..., xr.Dataset]
# Round-off of logarithm and cosine, which NumPy and the C library compute differently.
BETWEEN_BACKENDS = 1e-13


def samples(respond, block, duration, **settings):
    options = {"step": 0.01, "log_step": 0.01} | settings
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
    extremes = [0, 1, 4294944442, pow(810728, -1, 4294967087), pow(1370589, -1, 4294944443)]
    for a, b, c in itertools.product(extremes, repeat=3):
        states = np.array([[a], [b], [c]], dtype=float)
        _, p, q = uniform(states, states)
        assert p[2, 0] == (1403580 * b - 810728 * a) % 4294967087
        assert q[2, 0] == (527612 * c - 1370589 * a) % 4294944443
    for _ in range(2000):
        _, first, second = uniform(first, second)
        x = [*x[1:], (1403580 * x[1] - 810728 * x[0]) % 4294967087]
        y = [*y[1:], (527612 * y[2] - 1370589 * y[0]) % 4294944443]
        assert first[:, 0].tolist() == x
        assert second[:, 0].tolist() == y


def test_numbers_are_white_and_normal(respond):
    deviation, mean = np.array([2.0, 0.5]), np.array([1.0, -1.0])
    block = Noise(deviation, 0.01, seed=3, mean=mean)
    y = samples(respond, block, 1000.0, backend="compiled")
    z = (y - mean) / deviation
    count = len(z)
    assert count == 100_000
    four_sigma = 4 / np.sqrt(count)
    np.testing.assert_allclose(z.mean(axis=0), 0.0, rtol=0, atol=four_sigma)
    np.testing.assert_allclose(z.var(axis=0), 1.0, rtol=0, atol=four_sigma * np.sqrt(2))
    np.testing.assert_allclose((z**4).mean(axis=0), 3.0, rtol=0, atol=four_sigma * np.sqrt(96))
    # No memory: neither the numbers nor their squares depend on those before.
    np.testing.assert_allclose((z[1:] * z[:-1]).mean(axis=0), 0.0, rtol=0, atol=four_sigma)
    squares = (z[1:] ** 2 * z[:-1] ** 2).mean(axis=0)
    np.testing.assert_allclose(squares, 1.0, rtol=0, atol=four_sigma * np.sqrt(8))
    assert abs((z[:, 0] * z[:, 1]).mean()) < four_sigma  # elements are independent


def test_numbers_depend_on_seed_and_instant_only(respond):
    def noise(seed):
        return Noise([1.0, 1.0], 0.02, seed=seed)

    reference = samples(respond, noise(7), 0.4, backend="numpy", log_step=0.02)
    for settings in (
        {"backend": "interpreted"},
        {"backend": "compiled"},
        {"backend": "numpy", "step": 0.005, "solver": "euler"},
        {"backend": "numpy", "solver": "RK45"},
    ):
        y = samples(respond, noise(7), 0.4, **({"log_step": 0.02} | settings))
        np.testing.assert_allclose(y, reference, rtol=0, atol=BETWEEN_BACKENDS)
    other = samples(respond, noise(8), 0.4, backend="numpy", log_step=0.02)
    assert np.abs(other - reference).min() > 1e-6


def allan_deviation(rate, samples, step):
    """Return the overlapping Allan deviation of rates, over all channels [IEEE Std 952, annex C]."""
    angle = np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(rate, axis=0)]) * step
    second = angle[2 * samples :] - 2 * angle[samples:-samples] + angle[: -2 * samples]
    return float(np.sqrt(np.mean(second**2) / 2) / (samples * step))


def test_drift_is_a_random_walk(respond):
    """Its standard deviation is K √t; its Allan deviation K √(t/3), that of white noise N/√t."""
    step, walk = 0.1, 0.3
    drift = samples(respond, Drift(walk, step, seed=5, shape=400), 100.0, step=step, log_step=step)
    white = samples(respond, Noise(np.ones(400), step, seed=6), 100.0, step=step, log_step=step)
    times = np.arange(1, 1000) * step
    deviation = drift[1:].std(axis=1) / np.sqrt(times)
    np.testing.assert_allclose(deviation, walk, rtol=4 / np.sqrt(800), atol=0)
    averaged = np.array([10, 20, 40, 80])
    for rate, slope, at_one in ((drift, 0.5, walk / np.sqrt(3)), (white, -0.5, np.sqrt(step))):
        deviations = [allan_deviation(rate, m, step) for m in averaged]
        found, level = np.polyfit(np.log(averaged * step), np.log(deviations), 1)
        assert found == pytest.approx(slope, abs=0.05)
        assert np.exp(level) == pytest.approx(at_one, rel=0.05)


def test_drift_with_a_correlation_time_settles(respond):
    """From its stationary distribution on: variance K² τ/2 at all times, correlation e^(-t/τ)."""
    walk, time = 0.3, 2.0
    settled = walk * np.sqrt(time / 2)
    block = Drift(walk, 0.1, seed=5, shape=2000, correlation_time=time, initial_deviation=settled)
    y = samples(respond, block, 10.0, step=0.1, log_step=0.1)
    np.testing.assert_allclose(y.std(axis=1), settled, rtol=4 / np.sqrt(4000), atol=0)
    correlation = np.mean(y[:-20] * y[20:]) / settled**2
    assert correlation == pytest.approx(np.exp(-1), abs=0.02)


def test_drift_is_the_same_in_every_run(respond):
    def drift(seed):
        return Drift(1.0, 0.1, seed=seed, shape=3, initial_deviation=1.0)

    reference = samples(respond, drift(7), 2.0, backend="numpy", log_step=0.1)
    again = samples(respond, drift(8), 2.0, log_step=0.1, parameters={"block.seed": 7})
    np.testing.assert_allclose(again, reference, rtol=0, atol=BETWEEN_BACKENDS)
    assert np.abs(samples(respond, drift(8), 2.0, log_step=0.1) - reference).min() > 1e-6


def test_seed_can_change_from_run_to_run(respond):
    wanted = samples(respond, Noise(1.0, 0.1, seed=8), 0.5, log_step=0.1)
    options = {"parameters": {"block.seed": 8}, "log_step": 0.1}
    found = samples(respond, Noise(1.0, 0.1, seed=7), 0.5, **options)
    np.testing.assert_array_equal(found, wanted)


def test_noise_is_held_between_samples(respond):
    y = samples(respond, Noise(1.0, 0.05, seed=1), 1.0)
    changes = np.flatnonzero(np.diff(y)) + 1
    np.testing.assert_array_equal(changes, np.arange(5, 100, 5))


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: Noise(-1.0, 0.1, seed=1), ParameterError, "'standard_deviation' of Noise is -1"),
        (lambda: Noise(1.0, 0.1, seed=-1), ParameterError, "'seed' of Noise is -1"),
        (
            lambda: Noise(1.0, 0.1, seed=1.5),  # type: ignore[arg-type]
            ParameterError,
            "'seed' of Noise is 1.5; it must be a whole number",
        ),
        (lambda: Noise(1.0, 0.0, seed=1), BlockError, "cannot sample 'Noise' every 0.0 s"),
        (lambda: Drift(-1.0, 0.1, seed=1), ParameterError, "'standard_deviation' of Drift is -"),
        (
            lambda: Drift(1.0, 0.1, seed=1, correlation_time=0),
            BlockError,
            "'correlation_time' of Drift is 0; it must be above 0",
        ),
    ],
)
def test_nonsense_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()
