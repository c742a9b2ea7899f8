"""Algebraic loops through units are found, printed, iterated over, or refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import ring

from trussflow.blocks import Diagram, Gain, Integrator, StateSpace, Sum, cosimulate
from trussflow.blocks.errors import AlgebraicLoopError, SimulationError

H = 0.125  # s


def feedthrough(gain, start=1.0, rate=-1.0):
    """Return x' = rate x + u, y = x + gain u."""
    return StateSpace([[rate]], [[1.0]], [[1.0]], [[gain]], initial_value=[start])


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
def test_a_loop_is_printed_with_its_path(coupling, stepping):
    """The path leads through the blocks within a member."""
    diagram = Diagram("three")
    a, double, total, state = diagram.add(
        a=stepping(feedthrough(0.5), H),
        double=Gain(2.0),
        total=Sum("+-"),
        state=Integrator(),
    )
    a.y[0] >> double.u
    double >> total.u1
    state >> total.u2
    total >> state
    total.y >> a.u[0]
    with pytest.raises(AlgebraicLoopError) as caught:
        cosimulate(diagram, 1.0, step=H, coupling=coupling)
    text = str(caught.value)
    assert "algebraic loop through co-simulation members" in text
    assert "a.y --wire--> double.u ==feedthrough==> double.y   [" in text
    assert "double.y --wire--> total.u1 ==feedthrough==> total.y   [" in text
    assert "total.y --wire--> a.u ==feedthrough==> a.y   [" in text
    assert "test_loops.py:" in text
    assert 'coupling="iterate"' in text


@pytest.mark.parametrize("gain", [0.5, -0.9, 3.0])
def test_iteration_with_rollback_solves_a_loop_exactly(gain, stepping):
    """Loop gains above one included, and units that show outputs after steps only.

    y1 = x1 + g u1, u1 = y2 = x2 + g u2, u2 = y1; states advance with inputs held at their
    values at the end of the step: x' = -x + u, so x_new = f x + (1 - f) u.
    """
    f = np.exp(-H)
    k = 1.0 - f + gain  # from an input to the output at the end of the step
    x = np.array([1.0, -0.3])
    first = np.linalg.solve([[1.0, -gain], [-gain, 1.0]], x)
    expected = [first]
    for _ in range(8):
        y = np.linalg.solve([[1.0, -k], [-k, 1.0]], f * x)  # y1 = f x1 + k y2 and so on
        x = f * x + (1.0 - f) * y[::-1]
        expected.append(y)
    for refreshes in (True, False):
        diagram = ring(
            a=stepping(feedthrough(gain, 1.0), H / 64, refreshes=refreshes),
            b=stepping(feedthrough(gain, -0.3), H / 64, refreshes=refreshes),
        )
        result = cosimulate(diagram, 8 * H, step=H, coupling="iterate")
        found = np.column_stack([result["a.y"][:, 0], result["b.y"][:, 0]])
        assert_allclose(found, expected, rtol=1e-9)
        assert "restore" in diagram.a.runs[-1].calls
        assert result.attrs["iterations"] < 8 * 8


def test_a_loop_whose_members_cannot_go_back_is_refused(stepping):
    diagram = ring(
        a=stepping(feedthrough(0.5), H), b=stepping(feedthrough(0.5), H, restores=False)
    )
    with pytest.raises(
        AlgebraicLoopError, match=r"cannot return to an earlier state: 'b'"
    ):
        cosimulate(diagram, 1.0, step=H, coupling="iterate")


def test_member_that_cannot_go_back_is_neither_iterated_nor_given_a_tolerance(stepping):
    def diagram():
        return ring(a=stepping(feedthrough(0.0), H, restores=False), b=feedthrough(0.0))

    with pytest.raises(
        SimulationError, match=r'couple with "iterate".*state: \'a\'; use'
    ):
        cosimulate(diagram(), 1.0, step=H, coupling="iterate")
    with pytest.raises(
        SimulationError, match=r"control steps by a tolerance.*state: 'a'; use a"
    ):
        cosimulate(diagram(), 1.0, step=2 * H, tolerance=1e-3)
    cosimulate(diagram(), 1.0, step=H, coupling="jacobi")


def test_a_loop_without_a_solution_is_reported(stepping):
    diagram = ring(
        a=stepping(feedthrough(1.0), H), b=stepping(feedthrough(1.0, 2.0), H)
    )
    with pytest.raises(
        SimulationError, match=r"did not converge at t = 0 s.*'(a|b)\.y'"
    ):
        cosimulate(diagram, 1.0, step=H, coupling="iterate")


def test_feedthrough_without_a_loop_is_followed_at_once():
    """Three units in a row, in the wrong order, show what a whole run shows."""
    diagram = Diagram("row")
    last, middle, first = diagram.add(
        last=Gain(3.0), middle=Gain(2.0), first=Integrator(1.0)
    )
    first >> middle >> last
    diagram.connect(last.y, first.u)
    result = cosimulate(diagram, 4 * H, step=H, members=["last", "middle", "first"])
    assert_array_equal(result["last.y"], 6.0 * result["first.y"])
    assert_allclose(result["first.y"], (1.0 + 6.0 * H) ** np.arange(5), rtol=1e-12)
