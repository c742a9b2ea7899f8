"""Monte Carlo samples are within their bounds, and give the truss that they describe."""

import numpy as np
import pytest
from flight.samples import (
    MAX_DAMPING,
    MAX_DEVIATION,
    MAX_PAYLOAD,
    MIN_DAMPING,
    deviations,
    tip,
    varied_truss,
)
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.models.plant.tunable_truss import TunableTruss


@pytest.fixture(scope="module")
def nominal():
    return TunableTruss.accurate().dynamics.modes


def test_samples_fill_their_bounds_and_do_not_exceed_them():
    samples = [deviations(seed, 6) for seed in range(400)]
    for name, low, high in (
        ("mass", -MAX_DEVIATION, MAX_DEVIATION),
        ("frequency", -MAX_DEVIATION, MAX_DEVIATION),
        ("payload", 0.0, MAX_PAYLOAD),
        ("damping", np.log(MIN_DAMPING), np.log(MAX_DAMPING)),
    ):
        values = [np.log(s[name]) if name == "damping" else s[name] for s in samples]
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < max(values) <= high
    spread = np.std([s["shapes"] for s in samples])
    # uniform standard deviation: 0.58
    assert 0.4 * MAX_DEVIATION < spread < 0.75 * MAX_DEVIATION


def test_a_seed_gives_one_sample_and_another_seed_another():
    first, again, other = (deviations(seed, 6)["mass"] for seed in (7, 7, 8))
    assert first == again != other


def test_the_truss_has_the_mass_and_the_damping_of_the_sample(nominal):
    sample = deviations(3, nominal.modes)
    truss = varied_truss(nominal, **sample)
    expected = (1.0 + sample["mass"]) * nominal.data.mass + sample["payload"]
    assert_allclose(truss.data.mass, expected, rtol=1e-12)
    assert_array_equal(truss.damping_ratios, sample["damping"])


def test_without_payload_frequencies_and_grasp_shapes_scale(nominal):
    shapes = np.full(nominal.modes, 0.5)
    truss = varied_truss(
        nominal, mass=0.21, frequency=-0.1, shapes=shapes, damping=0.01, payload=0.0
    )
    assert_allclose(truss.frequencies, 0.9 * nominal.frequencies, rtol=1e-12)
    ratio = np.abs(truss.grasp_translations) / np.maximum(
        np.abs(nominal.grasp_translations), 1e-12
    )
    large = np.abs(nominal.grasp_translations) > 1e-6
    # 1.21 the mass: shapes by 1 / 1.1
    assert_allclose(ratio[large], 1.5 / 1.1, rtol=1e-9)


def test_the_tip_is_the_point_farthest_from_the_origin(nominal):
    assert (
        np.linalg.norm(tip(nominal)) == np.linalg.norm(nominal.positions, axis=1).max()
    )
