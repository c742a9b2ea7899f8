"""Adaptive and stiff solvers: tolerance, break points, exact Jacobian; order of the fixed ones."""

import numpy as np
import pytest
import scipy.linalg

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.errors import SimulationError
from trussflow.blocks.framework.port import Output
from trussflow.blocks.simulation import run as run_module
from trussflow.blocks.simulation.adaptive import IMPLICIT, METHODS, Function, integrate
from trussflow.blocks.simulation.simulator import Simulator, simulate

BACKENDS = ("numpy", "interpreted", "compiled")
SLOPE_TOLERANCE = 0.1
TOLERANCE = 1e-8
GLOBAL_TO_LOCAL = 100.0  # the error at the end adds up those of many steps
A = np.array([[-0.3, 1.0, 0.2], [-1.5, -0.1, 0.0], [0.1, 0.4, -0.7]])


class Linear(Block):
    y = Output((3,))
    x = State((3,), initial=1.0)
    a = Parameter(A, (3, 3))

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": p.a @ x.x}


class VanDerPol(Block):
    y = Output((2,))
    x = State(initial=2.0)
    v = State()
    mu = Parameter(100.0)

    def output(self, t, x, u, p):
        return {"y": np.stack([x.x, x.v])}

    def derivative(self, t, x, u, p):
        return {"x": x.v, "v": p.mu * (1.0 - x.x**2) * x.v - x.x}


class Pulse(Block):
    """A short pulse that a solver steps over unless it is told."""

    y = Output()
    x = State()
    told: tuple[float, ...]

    def __init__(self, told=(699.0, 701.0)):
        self.told = told
        super().__init__()

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": np.where(np.abs(t - 700.0) < 1.0, 0.5, 0.0)}

    def breakpoints(self):
        return self.told


def diagram_of(block):
    diagram = Diagram("d")
    diagram.add(block=block)
    return diagram


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("solver", "order"), [("euler", 1), ("rk4", 4)])
def test_order_of_fixed_steps(solver, order, backend):
    """Against the matrix exponential, over four halvings of the step."""
    exact = scipy.linalg.expm(2.0 * A) @ np.ones(3)
    errors = []
    for halving in range(4):
        step = (0.2 if order == 4 else 0.01) / 2**halving
        result = simulate(diagram_of(Linear()), 2.0, step=step, solver=solver, backend=backend)
        errors.append(np.abs(result["block.y"].values[-1] - exact).max())
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(slopes, order, rtol=0, atol=SLOPE_TOLERANCE)


@pytest.mark.parametrize("backend", BACKENDS)
def test_stages_see_their_own_time(backend):
    """The rate 4 t^3 is integrated exactly by Simpson's rule, which RK4 then is."""

    class Cubic(Block):
        y = Output()
        x = State()

        def output(self, t, x, u, p):
            return {"y": x.x}

        def derivative(self, t, x, u, p):
            return {"x": 4.0 * t**3}

    result = simulate(diagram_of(Cubic()), 1.0, step=0.25, backend=backend)
    np.testing.assert_allclose(result["block.y"], result.time**4, rtol=1e-14)


@pytest.mark.parametrize("solver", METHODS)
def test_tolerance_is_met_at_all_logged_instants(solver):
    result = simulate(
        diagram_of(Linear()),
        5.0,
        solver=solver,
        backend="interpreted",
        log_step=0.5,
        rtol=TOLERANCE,
        atol=TOLERANCE,
    )
    exact = [scipy.linalg.expm(t * A) @ np.ones(3) for t in result.time.values]
    allowed = GLOBAL_TO_LOCAL * TOLERANCE
    np.testing.assert_allclose(result["block.y"], exact, rtol=0, atol=allowed)


@pytest.mark.parametrize("solver", IMPLICIT)
@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_stiff_linear_system(solver, backend):
    stiff = np.diag([-1e6, -1.0, -1e3]) + np.triu(np.ones((3, 3)), 1)
    result = simulate(
        diagram_of(Linear(a=stiff)),
        1.0,
        solver=solver,
        backend=backend,
        log_step=0.25,
        rtol=TOLERANCE,
        atol=TOLERANCE,
    )
    exact = scipy.linalg.expm(stiff) @ np.ones(3)
    allowed = GLOBAL_TO_LOCAL * TOLERANCE
    np.testing.assert_allclose(result["block.y"][-1], exact, rtol=0, atol=allowed)


def test_stiff_solvers_agree_on_van_der_pol():
    """Through a fast transition, where an explicit solver would crawl."""
    ends = [
        simulate(
            diagram_of(VanDerPol()),
            100.0,
            solver=solver,
            backend="interpreted",
            log_step=100.0,
            rtol=TOLERANCE,
            atol=TOLERANCE,
        )["block.y"].values[-1]
        for solver in IMPLICIT
    ]
    for end in ends[1:]:
        np.testing.assert_allclose(end, ends[0], rtol=1e-4)  # the phase error of the transition


@pytest.mark.parametrize("solver", METHODS)
def test_break_points_are_honoured(solver):
    def end(told):
        block = diagram_of(Pulse(told))
        result = simulate(block, 1000.0, solver=solver, backend="interpreted", log_step=1000.0)
        return float(result["block.y"][-1])

    assert end((699.0, 701.0, 5.0, -1.0, 2e6, 0.0, 1000.0)) == pytest.approx(1.0, abs=TOLERANCE)
    assert end(()) == 0.0, "the pulse must be one that is missed without break points"


@pytest.mark.parametrize("value", [np.nan, np.inf, "soon"])
def test_break_points_must_be_times(value):
    with pytest.raises(SimulationError, match=r"breakpoints\(\) of block 'block' .*must be finite"):
        simulate(diagram_of(Pulse((1.0, value))), 1.0, solver="RK45", backend="numpy")


@pytest.mark.parametrize("solver", METHODS)
@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_implicit_solvers_get_the_exact_jacobian(solver, backend, monkeypatch):
    given: list[Function | None] = []

    def spy(method, rate, jacobian, *rest):
        given.append(jacobian)
        return integrate(method, rate, jacobian, *rest)

    monkeypatch.setattr(run_module, "integrate", spy)
    simulate(diagram_of(VanDerPol(mu=3.0)), 0.1, solver=solver, backend=backend)
    assert len(given) == 1
    if solver in IMPLICIT and backend != "numpy":
        jacobian = given[0]
        assert jacobian is not None
        found = jacobian(0.3, np.array([2.0, 5.0]))
        np.testing.assert_allclose(found, [[0.0, 1.0], [-61.0, -9.0]], rtol=1e-14)
    else:
        assert given[0] is None


@pytest.mark.parametrize("solver", ["rk4", *METHODS])
@pytest.mark.parametrize("backend", BACKENDS)
def test_diagram_without_continuous_states(solver, backend):
    class Time(Block):
        y = Output()

        def output(self, t, x, u, p):
            return {"y": 2.0 * t}

    result = simulate(diagram_of(Time()), 1.0, step=0.25, log_step=0.25, solver=solver, backend=backend)
    np.testing.assert_allclose(result["block.y"], [0.0, 0.5, 1.0, 1.5, 2.0], rtol=1e-14)


def test_one_simulator_runs_many_times():
    simulator = Simulator(diagram_of(Linear()), solver="LSODA", backend="interpreted", log_step=1)
    first, other, again = (
        simulator.run(2.0, initial={"block.x": x})["block.y"].values for x in (1.0, 2.0, 1.0)
    )
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(other, 2 * first, rtol=1e-6)
