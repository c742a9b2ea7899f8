"""Reduced models of the flexibility."""

import control
import numpy as np
import pytest

from trussflow.blocks import linearize
from trussflow.models import ModelError, SpaceTruss
from trussflow.models.modal_analysis import (
    balanced_truncation,
    elastic_part,
    modal_truncation,
    peak_gain,
    response,
)
from trussflow.models.modal_analysis.reduction import elastic_modes

OMEGA = np.geomspace(0.5, 500.0, 400)
over_reducers = pytest.mark.parametrize("reduce", [modal_truncation, balanced_truncation])


@pytest.fixture(scope="module")
def full():
    return elastic_part(SpaceTruss.consistent(), slice(18, 21))


def test_elastic_part_is_all_that_a_grasp_sees(full):
    """Twelve states respond as all eighty do."""
    whole = linearize(SpaceTruss.consistent(), ["actuation[18:21]"], ["grasp_displacement"])
    assert (whole.nstates, full.nstates) == (80, 12)
    expected = response(whole, OMEGA)
    assert np.abs(response(full, OMEGA) - expected).max() < 1e-8 * np.abs(expected).max()


def test_modes_add_up_to_the_model(full):
    parts = elastic_modes(full)
    assert len(parts) == 6
    total = sum(response(part, OMEGA) for part in parts)
    assert np.abs(total - response(full, OMEGA)).max() < 1e-9 * peak_gain(full)


@over_reducers
@pytest.mark.parametrize("order", [2, 4, 6, 10])
def test_error_is_what_it_is_and_below_its_bound(reduce, order, full):
    found = reduce(full, order)
    assert found.model.nstates == found.order == order
    assert np.all(np.linalg.eigvals(found.model.A).real < 0)
    gains = response(full, OMEGA) - response(found.model, OMEGA)
    on_grid = np.linalg.norm(gains, 2, axis=(1, 2)).max()
    assert on_grid <= found.error * (1 + 1e-6)
    assert on_grid > 0.5 * found.error  # the grid is close enough to see most of it
    assert found.error <= found.bound * (1 + 1e-6)


def test_static_correction_is_exact_without_motion(full):
    found = modal_truncation(full, 4)
    static = full(0.0, squeeze=False)
    assert np.abs(found.model(0.0, squeeze=False) - static).max() < 1e-9 * np.abs(static).max()


def test_balanced_error_is_not_below_the_next_singular_value(full):
    """No model of that order can do better (Glover 1984)."""
    values = control.hankel_singular_values(full)
    assert balanced_truncation(full, 6).error >= values[6] * (1 - 1e-6)
    assert modal_truncation(full, 6).error >= values[6] * (1 - 1e-6)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda full: modal_truncation(full, 0), "of 12 states to 0; choose 1 to 11"),
        (lambda full: balanced_truncation(full, 12), "of 12 states to 12; choose 1 to 11"),
        (lambda full: modal_truncation(full, 3), "choose an even number"),
        (lambda _: elastic_modes(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]])), "has real poles"),
        (
            lambda _: elastic_part(SpaceTruss.consistent(), outputs=("task_position",)),
            "elastic part of task_position: the rigid motion",
        ),
    ],
)
def test_refused(full, build, message):
    with pytest.raises(ModelError, match=message):
        build(full)
