"""Orders of the coupling schemes in the communication step, and their limits."""

import numpy as np
import pytest
from scipy.linalg import expm
from systems import assert_near, ring

from trussflow.blocks import Integrator, StateSpace, cosimulate

# An oscillator, driven through a lag with direct feedthrough.
A1, B1, C1 = (
    np.array([[0.0, 1.0], [-9.0, -0.6]]),
    np.array([[0.0], [1.0]]),
    np.array([[1.0, 0.0]]),
)
A2, B2, C2, D2 = (np.array([[v]]) for v in (-2.0, 1.0, 3.0, -1.5))
START = np.array([1.0, 0.0, 0.5])
END = 0.5  # s
COARSE = 0.01  # s
ORDER_TOLERANCE = 0.1


def oscillator():
    return StateSpace(A1, B1, C1, [[0.0]], initial_value=START[:2])


def lag():
    return StateSpace(A2, B2, C2, D2, initial_value=START[2:])


def exact():
    whole = np.block([[A1 + B1 @ D2 @ C1, B1 @ C2], [B2 @ C1, A2]])
    x = expm(whole * END) @ START
    return np.array([x[0], (C2 @ x[2:] + D2 @ C1 @ x[:2]).item()])


def slopes(run):
    errors = []
    for step in (COARSE, COARSE / 2, COARSE / 4):
        result = run(step)
        end = np.array([result["a.y"][-1].item(), result["b.y"][-1].item()])
        errors.append(abs(end - exact()))
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel", "iterate"])
def test_error_is_proportional_to_the_step(coupling):
    orders = slopes(
        lambda step: cosimulate(
            ring(a=oscillator(), b=lag()),
            END,
            step=step,
            members=["a", "b"],
            coupling=coupling,
            log=["a.y", "b.y"],
        )
    )
    assert_near(orders, 1, ORDER_TOLERANCE)


@pytest.mark.parametrize(
    "coupling, members, expected",
    [
        ("jacobi", ["a", "b"], (1.0 + 0.5 * 2.0, 2.0 + 0.5 * 1.0)),
        ("gauss-seidel", ["a", "b"], (2.0, 2.0 + 0.5 * 2.0)),
        ("gauss-seidel", ["b", "a"], (1.0 + 0.5 * 2.5, 2.5)),
        ("gauss-seidel", ["the rest", "a"], (1.0 + 0.5 * 2.5, 2.5)),
        # a = 1 + b / 2, b = 2 + a / 2
        ("iterate", ["a", "b"], (8.0 / 3.0, 10.0 / 3.0)),
    ],
)
def test_one_step_of_integrators_that_read_each_other(coupling, members, expected):
    diagram = ring(a=Integrator(1.0), b=Integrator(2.0))
    result = cosimulate(diagram, 0.5, step=0.5, members=members, coupling=coupling)
    assert (result["a.y"][-1], result["b.y"][-1]) == pytest.approx(expected, rel=1e-9)
