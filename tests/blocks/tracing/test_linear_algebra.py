"""Positive definite systems: NumPy and traced solutions agree, sparse ones included."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near, series

from trussflow.blocks.errors import SimulationWarning
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Output
from trussflow.blocks.simulation.simulator import Simulator, simulate
from trussflow.blocks.tracing.kernels import symbol, to_expression, tracing
from trussflow.blocks.tracing.linear_algebra import (
    solve_positive_definite,
    weighted_gramian,
)
from trussflow.blocks.tracing.program import lower

ROUND_OFF = 1e-11  # times the condition of the matrices, below a hundred


def arrow(border, blocks):
    """Return 1 where a body with arms has entries in its mass matrix."""
    n = border + sum(blocks)
    pattern = np.zeros((n, n))
    pattern[:border] = pattern[:, :border] = 1.0
    start = border
    for size in blocks:
        pattern[start : start + size, start : start + size] = 1.0
        start += size
    return pattern


PATTERNS = {
    "one": np.ones((1, 1)),
    "dense": np.ones((5, 5)),
    "diagonal": np.eye(4),
    "equal arms": arrow(3, (2, 2, 2, 2)),
    "two arms": arrow(2, (3, 3)),
    "unequal arms": arrow(3, (2, 4, 1)),
    "single joints": arrow(2, (1, 1, 1, 1)),
    "no border": arrow(0, (2, 2, 2)),
    "arms first": arrow(3, (2, 2))[::-1, ::-1],
    "wide border": arrow(6, (2, 2, 2, 2)),
    "band": (np.abs(np.subtract.outer(np.arange(6), np.arange(6))) <= 1).astype(float),
}


def matrix_of(pattern):
    """Return a positive definite matrix with that pattern, and random numbers."""
    random = np.random.default_rng(4).uniform(-1.0, 1.0, pattern.shape)
    symmetric = pattern * (random + random.T)
    return symmetric + (1.0 + np.abs(symmetric).sum(axis=1).max()) * np.eye(
        len(pattern)
    )


class Solver(Block):
    y = Output("shape")
    m = Parameter(0.0, ("n", "n"))
    b = Parameter(0.0, "shape")

    def __init__(self, pattern, shape, **parameters):
        self.pattern, self.n, self.shape = pattern, len(pattern), shape
        super().__init__(**parameters)

    def output(self, t, x, u, p):
        rows = [  # structural zeros, as equations of motion have them
            np.stack(
                [
                    p.m[i, j] if self.pattern[i, j] else 0.0 * p.m[0, 0]
                    for j in range(self.n)
                ]
            )
            for i in range(self.n)
        ]
        return {"y": solve_positive_definite(np.stack(rows), p.b)}


def test_solution_equals_numpy_from_the_lower_triangle_alone(backend):
    """Rounding may leave a mass matrix not quite symmetric; all backends read the same half."""
    diagram, expected = Diagram("d"), {}
    for number, ((name, pattern), columns) in enumerate(
        product(PATTERNS.items(), [(), (1,), (3,)])
    ):
        shape = (len(pattern), *columns)
        m, b = matrix_of(pattern), np.random.default_rng(6).standard_normal(shape)
        diagram.add(
            f"solver{number}", Solver(pattern, shape, m=m + np.triu(pattern, 1), b=b)
        )
        expected[f"solver{number}.y"] = name, np.linalg.solve(m, b)
    found = simulate(diagram, 1.0, step=1.0, backend=backend)
    for signal, (name, solution) in expected.items():
        assert_near(found[signal][0], solution, ROUND_OFF, err_msg=name)


@pytest.mark.parametrize("side", ["matrix", "vector"])
def test_only_one_side_may_be_traced(side):
    m, b = matrix_of(PATTERNS["dense"]), np.arange(5.0)
    values = {"matrix": m, "vector": b}
    traced = symbol("s", values[side].shape)
    with tracing() as trace:
        found = solve_positive_definite(*(values | {side: traced}).values())
    program = lower("f", [to_expression(traced)], to_expression(found), trace)
    assert_near(
        program.function(values[side].ravel()).full().ravel(),
        np.linalg.solve(m, b),
        ROUND_OFF,
    )


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize(
    "border, blocks", [(0, (4,)), (1, (2, 2)), (3, (2, 2, 2)), (0, (2, 2))]
)
def test_traced_code_solves_what_is_indefinite_and_does_not_hide_what_is_singular(
    border, blocks, backend
):
    pattern = arrow(border, blocks)
    n = len(pattern)
    m, b = matrix_of(pattern), np.arange(1.0, n + 1)
    diagram = series(solver=Solver(pattern, (n,), m=m, b=b))
    simulator = Simulator(diagram, step=1.0, backend=backend)

    def solution(matrix):
        return simulator.run(1.0, parameters={"solver.m": matrix})["solver.y"].values[0]

    m[border, border] *= -1.0  # the first block fails to be positive definite
    assert_near(solution(m), np.linalg.solve(m, b), ROUND_OFF)
    m[border : border + 2, :] = m[:, border : border + 2] = 0.0
    with pytest.warns(
        SimulationWarning, match="'solver.y' stopped being finite at t = 0 s"
    ):
        assert np.isnan(solution(m)).any()


def test_indefinite_numbers_are_refused():
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        solve_positive_definite(np.diag([1.0, -1.0]), np.ones(2))


@pytest.mark.parametrize("groups", [1, 3, 4])
def test_weighted_gramian_equals_numpy(groups, rng):
    """Blocks of columns over shared rows and own ones, single entries beside them, and a zero."""
    filled = np.zeros((3 + 4 * groups, 6 * groups + 4 * groups), dtype=bool)
    for g in range(groups):
        rows = [0, 1, 2, *range(3 + 4 * g, 7 + 4 * g)]
        filled[np.ix_(rows, range(6 * g, 6 * g + 6))] = True
    filled[3:, 6 * groups :] = np.eye(4 * groups, dtype=bool)
    filled[:, -1] = False  # an actuator that does nothing
    matrix = np.where(filled, rng.standard_normal(filled.shape), 0.0)
    weights = rng.uniform(0.5, 2.0, filled.shape[1])
    entries, w = symbol("a", (filled.sum(),)), symbol("w", weights.shape)
    numbers = iter(range(filled.sum()))
    rows_of_symbols = [
        np.stack([entries[next(numbers)] if f else np.zeros(()) for f in row])
        for row in filled
    ]
    with tracing() as trace:
        found = weighted_gramian(np.stack(rows_of_symbols), w)
    assert len(trace) == (groups > 1)
    program = lower(
        "f", [to_expression(entries), to_expression(w)], to_expression(found), trace
    )
    expected = (matrix * weights) @ matrix.T
    values = program.function(matrix[filled], weights).full().reshape(expected.shape)
    # order of sums
    assert_near(values, expected, 1e-12 * np.abs(expected).max())
    assert_array_equal(weighted_gramian(matrix, weights), expected)
