"""Variable steps: orders, twins in C and Python, sparse Jacobian, automatic choice, statistics."""

import subprocess
import sys

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from systems import Time, assert_near, ports, ring, series

from trussflow.blocks import (
    Function,
    Integrator,
    MatrixGain,
    Simulator,
    StopWhen,
    simulate,
)
from trussflow.blocks.errors import DivergenceError
from trussflow.blocks.simulation.adaptive import METHODS, Control, VariableSpan
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.tracing.kernels import repeated
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.quantities import derivative
from trussflow.blocks.tracing.variable_step import definitions

ORDER_TOLERANCE = 0.1
BACKENDS = ("compiled", "interpreted", "numpy")
ROUND_OFF = 1e-12


def diagram_of(rates, start):
    """Return a diagram with x' = rates(t, x)."""
    n = len(start)
    rate = Function(rates, **ports(t=(), x=n, rate=n))
    diagram = series(rate=rate, block=Integrator(start))
    diagram.add(t=Time()) >> diagram.rate.t
    diagram.block >> diagram.rate.x
    return diagram


def swinging(t, x):
    """Return rates whose solution from (1, 0) is exp(sin t) (cos t, sin t)."""
    return np.stack([np.cos(t) * x[0] - x[1], x[0] + np.cos(t) * x[1]])


def exact_swing(t):
    return np.exp(np.sin(t)) * np.stack([np.cos(t), np.sin(t)])


def end_by_equal_steps(solver, backend, number, until=2.0):
    """Return states and dense output in the middle of the last step after a `number` of equal steps."""
    settings = {"solver": solver, "backend": backend, "log_step": 1.0}
    simulator = Simulator(diagram_of(swinging, [1.0, 0.0]), log=["block.y"], **settings)
    with simulator.opened(until) as run:
        control = Control.of(solver, 1e6, 1e6, 0.0)  # all steps are accepted
        control.begin(0.0, until)
        rows, times = np.zeros((1, 2)), np.zeros(0)
        run.executor.vary(
            VariableSpan(control, run.x, run.d, run.p, times, rows)
        )  # begins only
        for k in range(number):
            if k == number - 1:
                times = np.array([until * (1.0 - 0.5 / number)])
                control.due_rows = control.room = 1
            control.h, control.max_steps = until / number, 1
            run.executor.vary(VariableSpan(control, run.x, run.d, run.p, times, rows))
        assert control.steps == number
        assert control.t == pytest.approx(until)
        return run.x.copy(), rows[0].copy(), times[0]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "solver, order, numbers",
    [("RK45", 5, (128, 256)), ("DOP853", 8, (16, 24)), ("Rodas5P", 5, (64, 128))],
)
def test_order_of_equal_steps(solver, order, numbers, backend):
    if solver == "Rodas5P" and backend == "numpy":
        pytest.skip("its Jacobian by differences is not exact")
    errors = []
    for number in numbers:
        found, dense, t = end_by_equal_steps(solver, backend, number)
        errors.append(np.abs(found - exact_swing(2.0)).max())
        # The dense output is of an order one less, and no worse than ten times the error at the end.
        assert_near(dense, exact_swing(t), 10.0 * errors[-1])
    slope = np.log(errors[0] / errors[1]) / np.log(numbers[1] / numbers[0])
    assert slope == pytest.approx(order, abs=ORDER_TOLERANCE)


def stiff(t, x):
    """Return rates of the problem of Prothero and Robinson, whose solution is sin(t), and of an oscillator."""
    return np.stack([1e4 * (np.sin(t) - x[0]) + np.cos(t), x[2], -x[1] * x[0] ** 2])


@pytest.mark.parametrize("solver", METHODS)
def test_compiled_steps_are_those_in_python(solver):
    settings = {"rtol": 1e-6, "atol": 1e-8, "log_step": 0.1}
    first, *others = [
        simulate(
            diagram_of(stiff, [0.0, 1.0, 0.0]),
            1.0,
            solver=solver,
            backend=backend,
            **settings,
        )
        for backend in BACKENDS[:2]
    ]
    assert first.attrs["steps"] > 10
    assert_near(first["block.y"][:, 0], np.sin(first.time), 1e-4)
    for other in others:
        for name in ("steps", "rejected_steps", "evaluations", "factorizations"):
            # Round-off may change the last decimal of a step.
            assert other.attrs[name] == pytest.approx(
                first.attrs[name], abs=3, rel=0.01
            )
        assert_near(other["block.y"], first["block.y"], 1e-5)


def test_automatic_choice_says_what_it_did():
    smooth = simulate(diagram_of(swinging, [1.0, 0.0]), 2.0, solver="auto")
    assert smooth.attrs["method"] == "DOP853: no step was limited by stability"
    assert smooth.attrs["factorizations"] == 0
    result = simulate(diagram_of(stiff, [0.0, 1.0, 0.0]), 1.0, solver="auto")
    assert result.attrs["method"].startswith("Rodas5P: since t = 0.0")
    assert 0 < result.attrs["factorizations"] <= result.attrs["evaluations"] / 8
    explicit = simulate(diagram_of(stiff, [0.0, 1.0, 0.0]), 1.0, solver="DOP853")
    assert result.attrs["evaluations"] < explicit.attrs["evaluations"] / 10
    assert explicit.attrs["method"] == "DOP853"


def test_method_of_a_run_with_checkpoints(tmp_path):
    """The part after the last checkpoint is too short for another change of the method."""
    diagram = diagram_of(stiff, [0.0, 1.0, 0.0])
    result = simulate(
        diagram,
        1.0,
        solver="auto",
        stream_to=tmp_path / "run.nc",
        checkpoint_every=0.999,
    )
    assert result.attrs["method"].startswith("Rodas5P: since t = 0.0")


@pytest.mark.parametrize("end", ["event", "fault"])
def test_runs_that_end_early_have_statistics(end):
    rates = (lambda _, x: x) if end == "event" else (lambda _, x: x**2)
    diagram = diagram_of(rates, [1.0])
    if end == "event":
        (diagram.block.y[0] - 2.0) >> diagram.add("stop", StopWhen())
        result = simulate(diagram, 2.0, solver="RK45")
    else:
        with pytest.raises(DivergenceError) as raised:
            simulate(diagram, 2.0, solver="RK45")
        result = raised.value.result
    assert result.attrs["method"] == "RK45"
    assert result.attrs["evaluations"] > 6 * result.attrs["steps"] > 0


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_random_sparse_matrices_are_factorized(size):
    rng = np.random.default_rng(size)
    matrix = np.where(
        rng.random((size, size)) < 3.0 / size, rng.normal(size=(size, size)), 0.0
    )
    matrix -= np.diag(rng.uniform(0.0, 1e5, size))
    diagram = ring(rate=MatrixGain(matrix), block=Integrator(np.ones(size)))
    result = simulate(diagram, 1.0, solver="Rodas5P", backend="compiled")
    exact = scipy.linalg.expm(matrix) @ np.ones(size)
    assert_near(result["block.y"][-1], exact, 1e-7)


def test_rows_without_derivatives():
    """One rate is constant, one depends on time only, and one on another state."""
    rates = lambda t, x: np.stack([1.0 + 0.0 * x[0], 2.0 * t, 3.0 * x[1]])  # noqa: E731
    result = simulate(diagram_of(rates, np.zeros(3)), 2.0, solver="Rodas5P")
    assert_allclose(result["block.y"][-1], [2.0, 4.0, 8.0], rtol=1e-9)


def bent(a, b):
    return (np.sin(a) * b + np.exp(-a * b),)


def neighbours(t, x):
    n = len(x)
    pairs = [(x[i], x[i - 1] * (1.0 + t)) for i in range(n)]
    return np.stack([rate for (rate,) in repeated(bent, pairs)])


def test_sparse_jacobian_is_exact():
    """With kernels, against CasADi's derivative of the inlined equations."""
    plan = Plan(diagram_of(neighbours, np.ones(9)))
    prepared = Prepared(plan, [derivative()], Solver(solver="Rodas5P"))
    program, jacobian = prepared.programs[0], prepared.jacobian
    assert program.calls
    assert len(jacobian.groups) < 5
    x, t = np.linspace(-1.0, 1.0, 9), 0.7
    found = np.zeros((9, 10))
    for group in jacobian.groups:
        seeds = np.zeros(10)
        seeds[group.columns] = 1.0
        slope = jacobian.tangent.function(t, np.r_[x, seeds], [], []).full().ravel()
        found[group.rows, group.places] = slope[group.rows]
    by_state = program.jacobian(1)(t, x, [], []).full()
    by_time = program.jacobian(0)(t, x, [], []).full()
    assert_near(found, np.hstack([by_state, by_time]), ROUND_OFF)


SMALL_STACK = """
import threading
from fractions import Fraction
import numpy as np
from trussflow.blocks import Diagram, Gain, Integrator, Simulator

diagram = Diagram("d")
x, gain = diagram.add(x=Integrator(np.ones(10_000)), gain=Gain(-1.0))
x >> gain >> x
simulator = Simulator(diagram, solver="Rodas5P", backend="compiled", log=["x.y"], log_step=0.5)
with simulator.opened(1.0) as run:
    threading.stack_size(192 * 1024)  # the states alone have 80 kB
    thread = threading.Thread(target=run.advance, args=[Fraction(1)])
    thread.start()
    thread.join()
    print(np.allclose(run.x, np.exp(-1.0)))
"""


def test_large_steps_need_a_small_stack():
    """Threads have less of it than the main one, and a fault would end this process."""
    command = [sys.executable, "-c", SMALL_STACK]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.stdout == "True\n", run.stderr[-2000:]


@pytest.mark.parametrize("solver", METHODS)
def test_rows_of_a_small_memory(solver, monkeypatch):
    """Rows that do not fit into the memory of one call are written by the next ones."""
    monkeypatch.setattr("trussflow.blocks.simulation.run.CHUNK_NUMBERS", 6)
    diagram = ring(
        rate=MatrixGain([[0.0, 1.0], [-1.0, 0.0]]), block=Integrator([0.0, 1.0])
    )
    result = simulate(diagram, 5.0, solver=solver, log_step=0.01)
    assert_near(result["block.y"][:, 0], np.sin(result.time), 1e-6)


def test_coefficients_do_not_depend_on_print_options():
    before = definitions(None)
    with np.printoptions(legacy="1.13", precision=3):
        assert definitions(None) == before
