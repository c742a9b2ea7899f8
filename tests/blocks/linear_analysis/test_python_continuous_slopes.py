"""Linear models and trim with Python blocks that have continuous states."""

import numpy as np
import pytest
from systems import assert_near, ports

from trussflow.blocks import (
    Block,
    Diagram,
    Free,
    Function,
    Gain,
    Input,
    Output,
    Parameter,
    PythonFunction,
    State,
    StateSpace,
    ZeroOrderHold,
    linearize,
    loop_transfer,
    trim,
)
from trussflow.blocks.linear_analysis.opened_model import LocalJacobians
from trussflow.blocks.linear_analysis.trim import _Problem


class Swing(Block):
    """A damped pendulum whose second output passes one input on at once."""

    traced = False
    u = Input((1,))
    w = Input()
    y = Output((1,))
    z = Output()
    q = State((2,), initial=0.4)
    damping = Parameter(0.3)

    def output(self, t, x, u, p):
        return {"y": np.sin(x.q[0:1]), "z": x.q[1] + 2.0 * u.w**2}

    def derivative(self, t, x, u, p):
        pull = u.u[0] * np.cos(x.q[0]) - 4 * np.sin(x.q[0]) - p.damping * x.q[1]
        return {"q": np.stack([x.q[1], pull + u.w])}

    def feedthrough(self):
        return {"y": (), "z": ("w",)}


class Traced(Swing):
    """The same, traced."""

    traced = True


class Knowing(Swing):
    """The same, with its own derivatives."""

    def directional_derivative(self, kind, t, x, u, p, dx, du):
        if kind == "output":
            return {"y": np.cos(x.q[0:1]) * dx.q[0:1], "z": dx.q[1] + 4.0 * u.w * du.w}
        slope = -u.u[0] * np.sin(x.q[0]) - 4 * np.cos(x.q[0])
        rate = slope * dx.q[0] - p.damping * dx.q[1] + np.cos(x.q[0]) * du.u[0] + du.w
        return {"q": np.stack([dx.q[1], rate])}


def loop(kind, *, sampled=False, python=False):
    """Return two of these blocks in a row, the second fed by the first's direct output."""
    diagram = Diagram("swings")
    first, second, gain, lag, one = diagram.add(
        first=kind(),
        second=kind(),
        gain=Gain(-0.7),
        lag=StateSpace([[-2.0]], [[1.0]], [[1.0]], initial_value=[0.3]),
        one=Function(lambda y, r: y[0] + r, **ports(y=1, r=(), w=())),
    )
    lag >> one.y
    one >> first.w
    first.z >> second.w
    first.y >> gain >> second.u
    if sampled:
        second.y >> diagram.add(hold=ZeroOrderHold(0.2)) >> lag
    else:
        second.y >> lag
    if python:
        code = diagram.add(
            code=PythonFunction(
                lambda z, y: np.sin(y) + 0.3 * z, 0.1, **ports(z=(), y=1, u=1)
            )
        )
        second.z >> code.z
        gain >> code.y
        code >> first.u
    else:
        gain >> first.u
    diagram.expose(r=one.r, y=second.y, z=second.z)
    return diagram


@pytest.mark.parametrize("kind", [Swing, Knowing])
@pytest.mark.parametrize(
    "sampled, python", [(False, False), (True, False), (True, True)]
)
def test_models_are_those_of_the_traced_block(kind, sampled, python):
    exact = linearize(loop(Traced, sampled=sampled, python=python))
    model = linearize(loop(kind, sampled=sampled, python=python))
    assert set(model.state_labels) == set(exact.state_labels)
    order = [model.state_labels.index(label) for label in exact.state_labels]
    found = np.block(
        [[model.A[order][:, order], model.B[order]], [model.C[:, order], model.D]]
    )
    expected = np.block([[exact.A, exact.B], [exact.C, exact.D]])
    assert_near(found, expected, 1e-9)
    said = {model.derivatives[name] for name in ("first", "second")}
    assert (
        said == {"its own"}
        if kind is Knowing
        else all("differences" in s for s in said)
    )
    assert exact.D.any()


def test_loops_are_broken_as_with_the_traced_block():
    for where in ("gain.y", "second.w", "lag.u"):
        broken, exact = (loop_transfer(loop(kind), where) for kind in (Swing, Traced))
        assert broken(2j) == pytest.approx(exact(2j), rel=1e-8)


@pytest.mark.parametrize("sampled", [False, True])
def test_a_point_of_rest_is_found(sampled):
    found, exact = (
        trim(
            loop(kind, sampled=sampled, python=sampled),
            outputs={"y": [0.35]},
            inputs={"r": Free()},
        )
        for kind in (Swing, Traced)
    )
    assert found.residual <= 1e-9
    for name, value in exact.states.items():
        assert_near(found.states[name], value, 1e-7)
    assert_near(found.held["second.y"], [0.35], 1e-8)


def test_the_equations_of_trim_have_exact_derivatives():
    diagram = loop(Swing, sampled=True, python=True)
    problem = _Problem(diagram, {}, {"r": Free()}, {"y": [0.3]}, {}, None)
    z = problem._z + 0.01 * np.random.default_rng(1).normal(size=problem._z.size)
    with LocalJacobians(problem._model, 0.0, problem._p) as local:
        ends = [
            [problem._residual(local, z + h * sign) for sign in (1, -1)]
            for h in 1e-5 * np.eye(z.size)
        ]
        columns = [(up - down) / 2e-5 for up, down in ends]
        jacobian = problem._jacobian(local, z)
    assert_near(jacobian, np.stack(columns, axis=1), 1e-8)
