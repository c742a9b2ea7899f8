"""Draws are within their bounds, and make the truss that they tell."""

import numpy as np
import pytest
from flight.draws import HEAVIEST_DAMPING, HEAVIEST_PAYLOAD, LIGHTEST_DAMPING, UNCERTAIN, Draw, tip
from numpy.testing import assert_allclose, assert_array_equal

from trussflow.models.plant.tunable_truss import TunableTruss


@pytest.fixture(scope="module")
def nominal():
    return TunableTruss.accurate().dynamics.modes


def test_draws_fill_their_bounds_and_go_no_further():
    draws = [Draw.of_seed(seed, 6) for seed in range(400)]
    for values, low, high in (
        ([d.mass for d in draws], -UNCERTAIN, UNCERTAIN),
        ([d.frequency for d in draws], -UNCERTAIN, UNCERTAIN),
        ([d.payload for d in draws], 0.0, HEAVIEST_PAYLOAD),
        ([np.log(d.damping) for d in draws], np.log(LIGHTEST_DAMPING), np.log(HEAVIEST_DAMPING)),
    ):
        assert low <= min(values) < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < max(values) <= high
    spread = np.std([d.shapes for d in draws])
    assert 0.4 * UNCERTAIN < spread < 0.75 * UNCERTAIN  # of a deviation that is uniform up to it: 0.58


def test_a_seed_is_a_draw_and_another_is_another():
    assert Draw.of_seed(7, 6).mass == Draw.of_seed(7, 6).mass != Draw.of_seed(8, 6).mass


def test_the_truss_has_the_mass_and_the_damping_of_the_draw(nominal):
    draw = Draw.of_seed(3, nominal.modes)
    truss = draw.truss(nominal)
    assert_allclose(truss.data.mass, (1.0 + draw.mass) * nominal.data.mass + draw.payload, rtol=1e-12)
    assert_array_equal(truss.damping_ratios, draw.damping)


def test_without_load_frequencies_change_as_told_and_grasps_move_as_misjudged(nominal):
    draw = Draw(mass=0.21, frequency=-0.1, shapes=np.full(nominal.modes, 0.5), damping=0.01, payload=0.0)
    truss = draw.truss(nominal)
    assert_allclose(truss.frequencies, 0.9 * nominal.frequencies, rtol=1e-12)
    moved = np.abs(truss.grasp_translations) / np.maximum(np.abs(nominal.grasp_translations), 1e-12)
    big = np.abs(nominal.grasp_translations) > 1e-6
    assert_allclose(moved[big], 1.5 / 1.1, rtol=1e-9)  # 1.21 the mass: shapes by 1 / 1.1


def test_the_tip_is_the_point_farthest_from_the_root(nominal):
    assert np.linalg.norm(tip(nominal)) == np.linalg.norm(nominal.positions, axis=1).max()
