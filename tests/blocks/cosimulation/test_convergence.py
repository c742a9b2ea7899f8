"""The error falls with the communication step as the scheme promises; the limit is exact."""

import numpy as np
import pytest
from scipy.linalg import expm, solve

from trussflow.blocks import Diagram, StateSpace, cosimulate
from trussflow.blocks.framework.types import Vector

# An oscillator, driven through a lag with direct feedthrough.
A1, B1, C1 = np.array([[0.0, 1.0], [-9.0, -0.6]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
A2, B2, C2, D2 = (np.array([[v]]) for v in (-2.0, 1.0, 3.0, -1.5))
START = np.array([1.0, 0.0, 0.5])
END = 0.5  # s
COARSE = 0.01  # s
TOLERANCE = 0.1  # of the slope, over four halvings


def oscillator():
    return StateSpace(A1, B1, C1, [[0.0]], initial_value=START[:2])


def lag():
    return StateSpace(A2, B2, C2, D2, initial_value=START[2:])


def loop(a, b):
    diagram = Diagram("oscillator and lag")
    diagram.add(a=a, b=b)
    diagram.connect(a.port("y"), b.port("u"))
    diagram.connect(b.port("y"), a.port("u"))
    return diagram


def exact():
    whole = np.block([[A1 + B1 @ D2 @ C1, B1 @ C2], [B2 @ C1, A2]])
    x: Vector = expm(whole * END) @ START
    return np.array([x[0], (C2 @ x[2:] + D2 @ C1 @ x[:2]).item()])


def slopes(run):
    steps = COARSE / 2.0 ** np.arange(5)
    errors = []
    for step in steps:
        result = run(step)
        end = np.array([result["a.y"][-1].item(), result["b.y"][-1].item()])
        errors.append(abs(end - exact()))
    found: Vector = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    return found


SCHEMES = [
    ("jacobi", 0, 1),
    ("jacobi", 1, 2),
    ("gauss-seidel", 0, 1),
    ("gauss-seidel", 1, 2),
    ("iterate", 0, 1),
    ("iterate", 1, 2),
]


@pytest.mark.parametrize(("coupling", "extrapolation", "order"), SCHEMES)
def test_error_falls_at_the_order_of_the_scheme(coupling, extrapolation, order):
    found = slopes(
        lambda step: cosimulate(
            loop(oscillator(), lag()),
            END,
            step=step,
            members=["a", "b"],
            coupling=coupling,
            extrapolation=extrapolation,
            log=["a.y", "b.y"],
        )
    )
    np.testing.assert_allclose(found, order, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
def test_units_that_know_no_lines_are_second_order_all_the_same(coupling, stepping):
    found = slopes(
        lambda step: cosimulate(
            loop(stepping(oscillator(), step), stepping(lag(), step)),
            END,
            step=step,
            coupling=coupling,
            extrapolation=1,
        )
    )
    np.testing.assert_allclose(found, 2, rtol=0, atol=TOLERANCE)


def test_units_that_do_not_refresh_are_first_order(stepping):
    found = slopes(
        lambda step: cosimulate(
            loop(stepping(oscillator(), step), stepping(lag(), step, refreshes=False)),
            END,
            step=step,
            coupling="jacobi",
        )
    )
    np.testing.assert_allclose(found, 1, rtol=0, atol=TOLERANCE)


def transition(a, b, step):
    """Return what a step makes of the state, of a held input, and of an input that rises."""
    n = len(a)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n : n + 1], block[n, n + 1] = a, b, 1.0
    whole = expm(block * step)
    return whole[:n, :n], whole[:n, n : n + 1], whole[:n, n + 1 :]


@pytest.mark.parametrize("extrapolation", [0, 1])
def test_iteration_is_the_implicit_solution(extrapolation):
    """The closed form: inputs at the end of the step solve a linear system."""
    step, number = 0.1, 7
    F1, G1, R1 = transition(A1, B1, step)
    F2, G2, R2 = transition(A2, B2, step)
    x1, x2 = START[:2, None], START[2:, None]
    u1, u2 = C2 @ x2 + D2 @ C1 @ x1, C1 @ x1
    expected = []
    for _ in range(number):
        if extrapolation:  # u(t) = u_old + (u_new - u_old) t / H
            H1, H2 = R1 / step, R2 / step
            f1, f2 = F1 @ x1 + (G1 - H1) @ u1, F2 @ x2 + (G2 - H2) @ u2
        else:
            H1, H2, f1, f2 = G1, G2, F1 @ x1, F2 @ x2
        # u1 = C2 (f2 + H2 u2) + D2 u2,  u2 = C1 (f1 + H1 u1)
        gain = C2 @ H2 + D2
        u2 = solve(np.eye(1) - C1 @ H1 @ gain, C1 @ f1 + C1 @ H1 @ C2 @ f2)
        u1 = C2 @ f2 + gain @ u2
        x1, x2 = f1 + H1 @ u1, f2 + H2 @ u2
        expected.append([u2.item(), u1.item()])
    result = cosimulate(
        loop(oscillator(), lag()),
        step * number,
        step=step,
        members=["a", "b"],
        coupling="iterate",
        extrapolation=extrapolation,
        solver_step=step / 64,
    )
    found = np.column_stack([result["a.y"][1:, 0], result["b.y"][1:, 0]])
    np.testing.assert_allclose(found, expected, rtol=1e-8)  # RK4 at H/64, iteration to 1e-10
    assert result.attrs["iterations"] < 8 * number


def test_jacobi_and_gauss_seidel_read_what_they_say():
    """One step from hand: integrators that read each other."""
    for coupling, order, expected in (
        ("jacobi", ["a", "b"], (1.0 + 0.5 * 2.0, 2.0 + 0.5 * 1.0)),
        ("gauss-seidel", ["a", "b"], (2.0, 2.0 + 0.5 * 2.0)),
        ("gauss-seidel", ["b", "a"], (1.0 + 0.5 * 2.5, 2.5)),
        ("iterate", ["a", "b"], (8.0 / 3.0, 10.0 / 3.0)),  # a = 1 + b / 2, b = 2 + a / 2
    ):
        diagram = loop(*(StateSpace([[0]], [[1]], [[1]], [[0]], initial_value=v) for v in (1.0, 2.0)))
        result = cosimulate(diagram, 0.5, step=0.5, members=["a", "b"], coupling=coupling, order=order)
        found = result["a.y"][-1].item(), result["b.y"][-1].item()
        assert found == pytest.approx(expected, rel=1e-9), (coupling, order)
