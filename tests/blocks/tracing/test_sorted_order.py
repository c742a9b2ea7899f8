"""Sorted order and components of random graphs follow from which node reaches which."""

from itertools import pairwise

import numpy as np
import pytest

from trussflow.blocks.tracing.sorted_order import components, cycles, in_order


@pytest.mark.parametrize("seed", range(30))
def test_order_components_and_cycles_of_random_graphs(seed):
    depends = np.random.default_rng(seed).random((7, 7)) < 0.03 * (1 + seed % 6)
    graph = {i: np.flatnonzero(row).tolist() for i, row in enumerate(depends)}
    reaches = depends | np.eye(7, dtype=bool)
    for k in range(7):
        reaches |= np.outer(reaches[:, k], reaches[k])
    both = reaches & reaches.T
    parts = [*components(graph)]
    assert {frozenset(part) for part in parts} == {
        frozenset(np.flatnonzero(row)) for row in both
    }
    place = {node: k for k, part in enumerate(parts) for node in part}
    assert all(place[j] <= place[i] for i in graph for j in graph[i])
    circular = set().union(*cycles(graph))
    assert circular == {*np.flatnonzero((depends & both).any(axis=1))}
    order, cycle = in_order(graph)
    assert sorted(order) == [i for i in graph if not circular]
    assert all(order.index(j) < order.index(i) for i in order for j in graph[i])
    assert bool(cycle) == bool(circular)
    assert all(
        first in graph[second] for first, second in pairwise([*cycle, *cycle[1:2]])
    )
