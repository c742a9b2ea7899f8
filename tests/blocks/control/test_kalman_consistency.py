"""Extended filters err as much as they say: over many seeds. Linear ones are compared with exact ones elsewhere.

Bar-Shalom, Li, Kirubarajan (2001), section 5.4: bounds of chi-square, here of 99.9 %, as the seeds are fixed.
"""

import campaign
import numpy as np
from scipy.stats import chi2

from trussflow.blocks.control import ExtendedKalmanFilter, NonlinearProcess

RUNS = 40 * campaign.SIZE
EVERY, FINE = 0.2, 20
NOISE, DENSITY = 1e-4, np.array([0.0, 1e-6, 1e-9])
START, SPREAD = np.array([60.0, 3.0, 0.05]), np.array([1e-2, 1e-4, 1e-5])


def rates(_, x, __):
    """Height [km], speed [km/s] and drag coefficient [1/km] of a body that enters the atmosphere."""
    drag = x[2] * np.exp(-x[0] / 7.0) * x[1] ** 2
    return np.stack([-x[1], 9.81e-3 - drag, 0.0 * x[2]])


def radar(_, x, __):
    """Distance from a radar 30 km aside [km]."""
    return np.stack([np.sqrt(900.0 + x[0] ** 2)])


def measured(generator):
    """Return states and measurements of a run, integrated in fine steps."""
    h, x = EVERY / FINE, START + np.sqrt(SPREAD) * generator.normal(size=3)
    states, measurements = [], []
    for _ in range(60):
        states.append(x)
        noise = np.sqrt(NOISE) * generator.normal(size=1)
        measurements.append(radar(0.0, x, None) + noise)
        for _ in range(FINE):
            middle = x + h / 2 * rates(0.0, x, None)
            noise = np.sqrt(h * DENSITY) * generator.normal(size=3)
            x = x + h * rates(0.0, middle, None) + noise
    return np.array(states), measurements


def normalized(errors, covariances):
    """Return e^T P^-1 e of each sample."""
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    return np.sum(errors * solved, axis=-1)


def assert_chi_square(values, freedom):
    low, high = chi2.ppf([0.0005, 0.9995], freedom)
    assert low < np.sum(values) < high


def test_extended_filter_is_consistent(follow):
    process = NonlinearProcess(
        rates,
        radar,
        states=3,
        measurements=1,
        density=DENSITY,
        noise=NOISE,
        every=EVERY,
    )
    block = ExtendedKalmanFilter(
        process, initial_estimate=START, initial_covariance=SPREAD
    )
    errors, innovations = [], []
    for run in range(RUNS):
        states, measurements = measured(np.random.default_rng([11, run]))
        found = follow(block, measurements)
        errors.append(normalized(found["estimate"] - states, found["covariance"]))
        innovations.append(
            normalized(found["innovation"], found["innovation_covariance"])
        )
    # Errors go together in time, not over runs: as many bands as samples far from each other.
    for each in np.transpose(errors)[::15]:
        assert_chi_square(each, 3 * RUNS)
    assert_chi_square(innovations, np.size(innovations))
