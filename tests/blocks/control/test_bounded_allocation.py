"""Allocation within limits: against conditions of optimality, another solver, and its specification."""

import campaign
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.optimize import lsq_linear
from systems import assert_near, ports

from trussflow.blocks import (
    BoundedAllocation,
    Constant,
    Diagram,
    Function,
    OperatingPoint,
    RateBoundedAllocation,
    Session,
    Sine,
    Step,
    linearize,
    simulate,
)
from trussflow.blocks.control.bounded_least_squares import bounded_least_squares
from trussflow.blocks.errors import DivergenceError
from trussflow.blocks.testing import check_block

PROBLEM_COUNT = 100 * campaign.SIZE
GRADIENT_TOLERANCE = 1e-9  # of the size of the terms that cancel in the gradient
INPUTS = {
    "demand": np.array([1.0, -0.7]),
    "effectiveness": np.array([[1.0, 0.5, 0.0, 0.2], [0.0, 1.0, 0.3, -0.4]]),
    "spread": np.array([[2.0, 0.3], [0.3, 1.0]]),
    "lower": np.full(4, -0.6),
    "upper": np.full(4, 0.6),
    "preferred": np.array([0.1, 0.0, -0.1, 0.05]),
}


def problem(random, m, n):
    """Return the inputs of an allocation: ordinary, without full rank, fixed, unlimited, unreachable."""
    matrix = random.standard_normal((m, n))
    kind = random.integers(5)
    if kind == 1:
        matrix[:, : n // 2] = 0.0
    elif kind == 2:
        matrix[-1] = matrix[0]
    elif kind == 3:
        matrix = np.round(matrix)
    root = random.standard_normal((m, m))
    lower, upper = -random.uniform(0.0, 1.0, n), random.uniform(0.0, 1.0, n)
    fixed = random.uniform(size=n) < random.choice([0.0, 0.2, 1.0], p=[0.5, 0.4, 0.1])
    demand = random.standard_normal(m) * 10.0 ** random.uniform(-2.0, 2.0)
    if random.uniform() < 0.2:  # just reachable, all at limits
        demand = matrix @ np.where(random.uniform(size=n) < 0.5, lower, upper)
    elif random.uniform() < 0.2:
        lower = np.where(fixed, lower, -1e3)
    return {
        "demand": demand,
        "effectiveness": matrix,
        "spread": root @ root.T + 0.1 * np.eye(m),
        "preferred": random.standard_normal(n) * random.integers(2),
        "lower": lower,
        "upper": np.where(fixed, lower, upper),
    }


def least_squares(weights, u):
    """Return A and b of the same problem as the least |A Q - b|."""
    whitened = np.linalg.inv(np.linalg.cholesky(u["spread"]))
    matrix = np.vstack([whitened @ u["effectiveness"], np.diag(weights)])
    return matrix, np.concatenate([whitened @ u["demand"], weights * u["preferred"]])


def free_gradient(weights, u, Q):
    """Return the largest part of the gradient along which Q may still move, by the size of its terms."""
    A, b = least_squares(weights, u)
    gradient = A.T @ (A @ Q - b)
    at_low, at_high = u["lower"] >= Q, u["upper"] <= Q
    gradient = np.where(at_low, np.minimum(gradient, 0.0), gradient)
    gradient = np.where(
        at_high, np.where(at_low, 0.0, np.maximum(gradient, 0.0)), gradient
    )
    terms = np.abs(A.T) @ (np.abs(A) @ np.abs(Q) + np.abs(b))
    return np.max(np.abs(gradient)) / max(1e-300, np.max(terms))


@pytest.mark.parametrize("m, n", [(1, 1), (2, 5), (4, 3), campaign.only(6, 9)])
def test_optimal_on_every_backend(m, n):
    """Random problems, degenerate ones among them; the compiled code is what an FMU holds."""
    random = np.random.default_rng(10 * m + n)
    weights = 10.0 ** random.uniform(-2.5, -1.0) * random.uniform(0.3, 3.0, n)
    sessions = [
        Session(BoundedAllocation(m, weights), step=1.0, backend=backend)
        for backend in ("numpy", "interpreted", "compiled")
    ]
    for session in sessions:
        session.start(inputs=problem(random, m, n))
    unreachable = 0
    for _ in range(PROBLEM_COUNT):
        u = problem(random, m, n)
        for session in sessions:
            session.set(u)
        first, *others = (session.outputs for session in sessions)
        Q = first["command"]
        assert free_gradient(weights, u, Q) < GRADIENT_TOLERANCE
        assert np.all((u["lower"] <= Q) & (u["upper"] >= Q))
        unreachable += np.max(np.abs(first["missed"])) > 0.01
        left = u["demand"] - u["effectiveness"] @ Q
        assert_near(first["missed"], left, 1e-9 * max(1.0, np.abs(left).max()))
        at_limit = (u["lower"] == Q) | (u["upper"] == Q)
        assert_array_equal(first["saturated"], at_limit)
        for name, values in first.items():
            scale = max(1.0, np.max(np.abs(values)))
            for other in others:
                assert_near(other[name], values, 1e-9 * scale)
    assert unreachable > PROBLEM_COUNT / 5


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_commands_move_no_faster_than_rates(backend):
    block, diagram = (
        RateBoundedAllocation(2, np.full(4, 0.1), [1.0, 2.0, 3.0, 1e6], 0.05),
        Diagram("d"),
    )
    diagram.add(block=block, sine=Sine([1.5, -1.5], 2.0))
    for name in ("effectiveness", "spread", "lower", "upper"):
        diagram.connect(diagram.add(name, Constant(INPUTS[name])).y, block.port(name))
    diagram.sine >> block.demand
    result = simulate(diagram, 1.0, step=0.05, backend=backend)
    Q = result["block.command"].values
    change = np.max(np.abs(np.diff(Q, axis=0)), axis=0)
    assert_near(change[:3], [0.05, 0.1, 0.15], 1e-14)
    assert change[3] > 0.16
    assert np.max(np.abs(Q)) == 0.6


def slopes(function, at):
    """Return the Jacobian by central differences."""
    return np.transpose(
        [(function(at + e) - function(at - e)) / 2e-6 for e in 1e-6 * np.eye(at.size)]
    )


# none, some, all that matter at limits
@pytest.mark.parametrize("size", [0.3, 1.0, 3.0])
def test_linear_model_is_the_slope(size, evaluate):
    """All inputs vary; the metric stays symmetric."""
    values = {**INPUTS, "demand": size * INPUTS["demand"]}
    block = BoundedAllocation(2, [0.1, 0.2, 0.1, 0.3])
    model = linearize(
        block, list(values), ["command", "missed"], at=OperatingPoint(inputs=values)
    )
    at = np.concatenate([value.ravel() for value in values.values()])
    symmetric = np.eye(at.size)
    symmetric[11:13, 11:13] = 0.5

    def outputs(flat):
        parts = np.split(
            symmetric @ flat, np.cumsum([value.size for value in values.values()])
        )
        shaped = {
            n: part.reshape(values[n].shape)
            for n, part in zip(values, parts, strict=False)
        }
        found = evaluate(block, **shaped)
        return np.concatenate([found["command"], found["missed"]])

    assert_near(model.D @ symmetric, slopes(outputs, at), 1e-7)


def test_a_linear_model_after_a_check():
    """CasADi keeps derivatives by name: those in all directions at once are not those in one."""
    block = BoundedAllocation(2, [0.1, 0.2, 0.1, 0.3])
    check_block(block)
    model = linearize(
        block, list(INPUTS), ["command"], at=OperatingPoint(inputs=INPUTS)
    )
    assert np.isfinite(model.D).all()


@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_effort_that_weighs_nothing_costs_no_digits(backend, rng):
    """More demands than actuators, and squared weights 1e10 apart: plain least squares within limits."""
    matrix, demand = rng.standard_normal((5, 3)), 3.0 * rng.standard_normal(5)
    limits = np.array([-9.0, -0.1, -9.0]), np.array([9.0, 0.1, 9.0])
    u = {
        "effectiveness": matrix,
        "demand": demand,
        "spread": np.eye(5),
        "lower": limits[0],
        "upper": limits[1],
    }
    session = Session(BoundedAllocation(5, np.full(3, 1e-5)), step=1.0, backend=backend)
    session.start(inputs=u)
    exact = lsq_linear(matrix, demand, limits, method="bvls", tol=1e-15).x
    assert_near(session.outputs["command"], exact, 1e-9)


def test_slope_by_weights():
    def command(weights):
        matrix, limits = np.array([[1.0, 2.0, 3.0]]), np.array([0.2, 0.2, 9.0])
        preferred = np.array([0.3, 0.1, 0.0])
        one = np.ones((1, 1))
        return bounded_least_squares(
            matrix, one, 1.5 * one[0], weights, preferred, -limits, limits
        )[0]

    at = np.array([0.5, 3.0, 0.7])
    block = Function(command, **ports(u=3, y=3))
    model = linearize(block, at=OperatingPoint(inputs={"u": at}))
    assert_near(model.D, slopes(command, at), 1e-8)
    assert np.max(np.abs(model.D)) > 0.01


@pytest.mark.parametrize(
    "name, after", [("lower", [1.0, -1.0]), ("spread", [[-1.0]]), ("demand", [-1.0])]
)
def test_problem_without_solution_ends_the_run(name, after, backend):
    """A lower limit above the upper one, a metric that is none, a demand that is not finite."""
    sources = {
        "demand": [1.0],
        "effectiveness": [[1.0, 2.0]],
        "spread": [[1.0]],
        "lower": [-0.5, -0.5],
        "upper": [0.5, 0.5],
    }
    block, diagram = BoundedAllocation(1, [0.1, 0.1]).sampled(0.1), Diagram("wrong")
    diagram.add(block=block, known=Function(lambda u: np.where(u > 0, u, np.nan)))
    for port, value in sources.items():
        source = Step(
            0.2, initial_value=value, final_value=after if port == name else value
        )
        diagram.add(**{port: source})
        diagram.connect(
            source.y, diagram.known.u if port == "demand" else block.port(port)
        )
    diagram.known >> block.demand
    with pytest.raises(DivergenceError, match=r"'block\.command'.*t = 0\.2 s"):
        simulate(diagram, 1.0, step=0.1, backend=backend)
