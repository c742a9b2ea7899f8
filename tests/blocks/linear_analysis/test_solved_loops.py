"""Linear models of diagrams with algebraic loops that are solved: the implicit function theorem, exactly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from systems import assert_near, ports

from trussflow.blocks import (
    Diagram,
    Free,
    Function,
    Integrator,
    OperatingPoint,
    Saturation,
    Sum,
    kalman_filter,
    linearize,
    loop_transfer,
    operating_point_after,
    trim,
)
from trussflow.blocks.errors import (
    DivergenceError,
    LinearAnalysisError,
    NameLookupError,
)

ROUND_OFF = 1e-13


def cubic():
    """Return y + y^3 = x + w, dx/dt = -y + v."""
    diagram = Diagram("cubic", loops="solve")
    state, bent, total = diagram.add(
        state=Integrator(2.0),
        bent=Function(
            lambda u, w, back: u + w - back**3, **ports(u=(), w=(), back=(), y=())
        ),
        total=Sum("+-"),
    )
    state >> bent.u
    bent >> bent.back
    bent >> total.u2
    total >> state
    diagram.expose(v=total.u1, w=bent.w, y=bent.y)
    return diagram


def solved(right):
    """Return the real root of y + y^3 = right."""
    roots = np.roots([1.0, 0.0, 1.0, -right])
    return roots[np.abs(roots.imag) < 1e-9][0].real


def test_a_loop_that_is_cut_is_none():
    """At the cut the slope of the law alone remains, -3 y^2: the loop's gain, for negative feedback."""
    diagram = cubic()
    diagram.guess(diagram.bent.y, 1.0)
    y = solved(2.0)
    point = OperatingPoint(inputs={"v": 0.0, "w": 0.0})
    found = loop_transfer(diagram, diagram.bent.back, at=point)
    assert_allclose(found.D, [[3.0 * y * y]], rtol=ROUND_OFF)


def test_trim_solves_loops_on_its_way():
    """For y = 1 at rest x = 2 and v = 1."""
    point = trim(
        cubic(),
        outputs={"y": 1.0},
        inputs={"v": Free(), "w": 0.0},
        states={"state.integral": Free(1.5)},
    )
    assert_near(point.states["state.integral"], 2.0, 1e-10)
    assert_near(point.inputs["v"], 1.0, 1e-10)
    assert_near(point.loops["bent.y"], 1.0, 1e-10)


def roots():
    """Return y^2 = 1 + x, dx/dt = v."""
    diagram = Diagram("roots", loops="solve")
    state, root = diagram.add(
        state=Integrator(),
        root=Function(
            lambda u, back: 1.0 + u - back**2 + back, **ports(u=(), back=(), y=())
        ),
    )
    state >> root.u
    root >> root.back
    diagram.expose(v=state.u, y=root.y)
    return diagram


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_point_says_which_solution_is_meant(sign):
    start = OperatingPoint(loops={"root.y": sign}, inputs={"v": 1.0})
    end = operating_point_after(roots(), 3.0, step=0.1, at=start)
    assert_near(end.loops["root.y"], 2.0 * sign, 1e-13)
    assert_near(linearize(roots(), at=end).C, [[sign / 4.0]], ROUND_OFF)
    with pytest.raises(
        NameLookupError,
        match=r"no loop signal 'root\.u'; the loop signals are: root\.y",
    ):
        linearize(roots(), at=OperatingPoint(loops={"root.u": 1.0}))


def test_where_there_is_no_solution_there_is_no_model():
    at = OperatingPoint(
        states={"state.integral": -2.0}, loops={"root.y": 1.0}, inputs={"v": 0.0}
    )
    with pytest.raises(
        DivergenceError, match="cannot solve the algebraic loop at t = 0 s"
    ):
        linearize(roots(), at=at)


@pytest.mark.parametrize("x, slope", [(1.0, 0.25), (5.0, 0.0)])
def test_a_saturation_in_a_loop(x, slope):
    """Of y = sat(x - 3 y) within the limits and at one."""
    diagram = Diagram("limited", loops="solve")
    state, limit = diagram.add(state=Integrator(x), limit=Saturation(-1.0, 1.0))
    (state.y - 3.0 * limit.y) >> limit.u
    diagram.expose(v=state.u, y=limit.y)
    assert_near(linearize(diagram).C, [[slope]], ROUND_OFF)


def test_a_sampled_loop():
    """With u = x - u^3 at samples, dx/dt = -u^3 + x: A = e^h - (e^h - 1) 3 u^2 / (1 + 3 u^2)."""
    diagram = Diagram("sampled", loops="solve")
    state, bent = diagram.add(
        state=Integrator(1.0), bent=Function(lambda u: -(u**3)).sampled(0.1)
    )
    total = state.y + bent.y
    total >> bent.u
    total >> state.u
    model = linearize(diagram, [state.u], [state.y])
    slope = 3.0 * solved(1.0) ** 2
    grown = np.exp(0.1)
    exact = grown - (grown - 1.0) * slope / (1.0 + slope)
    assert_near(model.A, [[exact]], ROUND_OFF)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 5))
def test_any_loop(seed, n):
    """With y = v + sin(F y): dy/dv is the inverse of I - diag(cos(F y)) F."""
    rng = np.random.default_rng(seed)
    matrix, v = rng.uniform(-0.9, 0.9, (n, n)) / n, rng.uniform(-1.0, 1.0, n)
    diagram = Diagram("any", loops="solve")
    law = Function(lambda v, back: v + np.sin(matrix @ back), **ports(v=n, back=n, y=n))
    diagram.add(law=law).y >> law.back
    diagram.expose(v=law.v, y=law.y)
    model = linearize(diagram, at=OperatingPoint(inputs={"v": v}))
    y = np.zeros(n)
    for _ in range(500):
        y = v + np.sin(matrix @ y)
    slope = np.cos(matrix @ y)[:, None] * matrix
    assert_near(model.D, np.linalg.inv(np.eye(n) - slope), 1e-12)


def test_what_is_stepped_inside_an_estimator_has_no_iterations():
    with pytest.raises(
        LinearAnalysisError, match="it has algebraic loops that are solved by iteration"
    ):
        kalman_filter(
            cubic(), ["y"], ["v"], kind="extended", every=0.1, measurement_noise=[1.0]
        )
