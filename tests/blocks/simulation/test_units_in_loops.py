"""Algebraic loops in large, small and mixed units, nearly singular and singular."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import ports

from trussflow.blocks import Diagram, Function, simulate
from trussflow.blocks.errors import DivergenceError


def solution(function, n, backend, start=0.0):
    """Return n signals that are this function of themselves."""
    diagram = Diagram("vector", loops="solve")
    block = diagram.add(law=Function(function, **ports(y=n, z=n)))
    block.z >> block.y
    diagram.guess(block.z, np.full(n, start))
    return simulate(diagram, 0.1, step=0.1, backend=backend)["law.z"].values[-1]


@pytest.mark.parametrize("n, bend", [(8, 0.0), (20, 0.0), (8, 1e-30)])
def test_gains_of_nearly_one_are_not_singular(backend, n, bend):
    found = solution(lambda y: 0.99 * y + 1.0 + bend * y**3, n, backend)
    assert_allclose(found, 100.0, rtol=1e-13)


@pytest.mark.parametrize("k", [1e4, 1e12])
@pytest.mark.parametrize("bend", [0.0, 1e-60])
def test_units_do_not_matter(backend, k, bend):
    """With a = k b + 0.3 and b = 0.5 a / k + 0.7 / k a is 2 and b is 1.7 / k."""
    gains, right = np.array([[0.0, k], [0.5 / k, 0.0]]), np.array([0.3, 0.7 / k])
    found = solution(lambda y: gains @ y + right + bend * y**3, 2, backend)
    assert_allclose(found, [2.0, 1.7 / k], rtol=1e-14)


@pytest.mark.parametrize("bend", [0.0, 1e-60])
def test_a_singular_matrix_of_large_gains(backend, bend):
    gains = np.array([[0.0, 1e6, 1.0], [1e6, 0.0, -2.0], [1e6 - 1.0, 1e6 - 1.0, 0.0]])
    assert np.linalg.matrix_rank(gains - np.eye(3)) == 2
    with pytest.raises(DivergenceError, match="cannot solve the algebraic loop"):
        solution(
            lambda y: gains @ y + np.array([1.0, 2.0, 7.0]) + bend * y**3, 3, backend
        )


@pytest.mark.parametrize("unit", [1e-13, 1e13])
def test_small_signals_are_solved_as_large_ones_are(backend, unit):
    """For y = y - atan(5 (y - 3)) y is 3, in any unit, and for y = y - 1 - y^2 there is none."""
    found = solution(
        lambda y: y - unit * np.arctan(5.0 * (y / unit - 3.0)), 1, backend, 2.9 * unit
    )
    assert_allclose(found, 3.0 * unit, rtol=1e-14)
    with pytest.raises(DivergenceError, match="Newton's method stops at a residual of"):
        solution(lambda y: y - unit * (1.0 + (y / unit) ** 2), 1, backend, 2.0 * unit)
