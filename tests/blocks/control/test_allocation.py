"""Allocation meets the demand with the least weighted effort."""

import casadi as ca
import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import Constant, Diagram, WeightedAllocation, simulate
from trussflow.blocks.errors import SimulationError, SimulationWarning
from trussflow.blocks.tracing.kernels import symbol, to_expression

ROUND_OFF = 1e-14  # relative: a few operations of 1e-16 each
# Of the best weighted solution, relative to the demand, for condition numbers up to 1e4.
RESIDUAL = 1e-8


@st.composite
def problems(draw):
    """Draw effectiveness, weights and demand, well enough conditioned to compare."""
    m = draw(st.integers(1, 4))
    n = draw(st.integers(m, 8))
    matrix = draw(arrays(float, (m, n), elements=st.floats(-2.0, 2.0)))
    # At most 16 in size beside 20 on one diagonal: never without full rank.
    matrix = matrix + 20.0 * np.eye(m, n)
    weights = draw(arrays(float, n, elements=st.floats(0.1, 10.0)))
    return matrix, weights, draw(arrays(float, m, elements=st.floats(-5.0, 5.0)))


@given(problem=problems())
def test_demand_is_met_with_the_least_weighted_effort(problem, evaluate):
    P, weights, u = problem
    block = WeightedAllocation(len(u), weights)
    Q = evaluate(block, demand=u, effectiveness=P)["command"]
    assert_near(P @ Q, u, RESIDUAL)
    # Stationary: W Q has no part that P cannot see, so no change along the null space helps.
    _, _, directions = np.linalg.svd(P)
    null_space = directions[len(u) :]
    assert_near(null_space @ (weights * Q), 0.0, RESIDUAL)


def test_traced_solution_keeps_to_the_structure_of_the_matrix():
    """Two independent halves: neither command depends on the other demand."""
    block = WeightedAllocation(2, np.ones(4))
    p, u, zero = symbol("p", (4,)), symbol("u", (2,)), np.zeros(2)
    rows = np.concatenate([p[:2], zero]), np.concatenate([zero, p[2:]])
    outputs = systems.respond(block, demand=u, effectiveness=np.stack(rows))
    slope = ca.jacobian(to_expression(outputs["command"]), to_expression(u))
    pattern = ca.DM(slope.sparsity(), 1).full()
    assert_array_equal(pattern, [[1, 0], [1, 0], [0, 1], [0, 1]])


@pytest.mark.parametrize(
    "rows",
    [
        [[1.0, 2, 3], [2, 4, 6]],
        [[0.1, 0.2, 0.3], [0.3, 0.6, 0.9]],
        [[0.1, 0.2, 0.7], [0.0, 0.0, 0.0]],
    ],
)
def test_demands_that_actuators_cannot_meet_have_no_commands(rows, backend):
    """Dependent rows leave pivots of zero or of round-off: no backend makes numbers of these."""
    diagram = Diagram("d")
    demand, rows_of, share = diagram.add(
        demand=Constant([1.0, 2.0]),
        rows_of=Constant(rows),
        share=WeightedAllocation(2, [1.0, 1.0, 1.0]),
    )
    demand >> share.demand
    rows_of >> share.effectiveness
    if backend == "numpy":
        with pytest.raises(
            SimulationError, match=r"LinAlgError.*(singular|not positive definite)"
        ):
            simulate(diagram, 1.0, step=1.0, backend=backend)
    else:
        with pytest.warns(
            SimulationWarning, match=r"'share\.command' stopped being finite"
        ):
            simulate(diagram, 1.0, step=1.0, backend=backend)
