"""Reduced models of the flexibility."""

from __future__ import annotations

from collections.abc import Callable

import control
import numpy as np
import pytest

from trussflow.blocks import linearize
from trussflow.models import ModelError, SpaceTruss
from trussflow.models.modal_analysis import (
    Reduction,
    balanced_truncation,
    elastic_part,
    modal_truncation,
    peak_gain,
    response,
)
from trussflow.models.modal_analysis.reduction import elastic_modes

OMEGA = np.geomspace(0.5, 500.0, 400)
REDUCERS = (modal_truncation, balanced_truncation)
over_reducers = pytest.mark.parametrize("reduce", REDUCERS)
Reducer = Callable[[control.StateSpace, int], Reduction]


@pytest.fixture(scope="module")
def full():
    return elastic_part(SpaceTruss.consistent(), slice(18, 21))


def largest(gains):
    return float(np.linalg.norm(gains, 2, axis=(1, 2)).max())


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
    on_grid = largest(response(full, OMEGA) - response(found.model, OMEGA))
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


@over_reducers
@pytest.mark.parametrize("order", [0, 12])
def test_orders_that_reduce_nothing(reduce, order, full):
    with pytest.raises(ModelError, match=f"of 12 states to {order}; choose 1 to 11"):
        reduce(full, order)


def test_modes_come_in_pairs(full):
    with pytest.raises(ModelError, match="choose an even number"):
        modal_truncation(full, 3)
    with pytest.raises(ModelError, match="has real poles"):
        elastic_modes(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]]))


def test_outputs_of_the_rigid_motion():
    with pytest.raises(ModelError, match="elastic part of task_position: the rigid motion"):
        elastic_part(SpaceTruss.consistent(), outputs=("task_position",))
