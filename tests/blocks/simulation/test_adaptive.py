"""Adaptive and stiff solvers: tolerance, break points, exact Jacobian; order of the fixed ones."""

import itertools

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from systems import assert_near, ring, series

from trussflow.blocks import (
    Function,
    Integrator,
    MatrixGain,
    Ramp,
    Sine,
    TimeFunction,
    simulate,
)
from trussflow.blocks.errors import DivergenceError, SimulationError, TimeLimitError
from trussflow.blocks.simulation import run as run_module
from trussflow.blocks.simulation.adaptive import IMPLICIT, METHODS
from trussflow.blocks.support.progress import RunBar

ORDER_TOLERANCE = 0.1
SOLVER_TOLERANCE = 1e-8
PRECISE = {"rtol": SOLVER_TOLERANCE, "atol": SOLVER_TOLERANCE}
# the error at the end adds up those of many steps
GLOBAL_TOLERANCE = 100.0 * SOLVER_TOLERANCE
A = np.array([[-0.3, 1.0, 0.2], [-1.5, -0.1, 0.0], [0.1, 0.4, -0.7]])


def diagram_of(block):
    return series(block=block)


def linear(matrix):
    """Return x' = A x, with all states one at the start."""
    return ring(rate=MatrixGain(matrix), block=Integrator(np.ones(3)))


def integral_of(function, breakpoints=()):
    return series(
        source=TimeFunction(function, breakpoints=breakpoints), block=Integrator()
    )


@pytest.mark.parametrize("solver, order, step", [("euler", 1, 0.01), ("rk4", 4, 0.2)])
def test_order_of_fixed_steps(solver, order, step, backend):
    """Against the matrix exponential, over four halvings of the step."""
    diagram = linear(A)
    exact = scipy.linalg.expm(2.0 * A) @ np.ones(3)
    errors = []
    for halving in range(4):
        result = simulate(
            diagram, 2.0, step=step / 2**halving, solver=solver, backend=backend
        )
        errors.append(np.abs(result["block.y"].values[-1] - exact).max())
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    assert_near(slopes, order, ORDER_TOLERANCE)


def test_stages_see_their_own_time(backend):
    """The rate 4 t^3 is integrated exactly by Simpson's rule, which RK4 then is."""
    result = simulate(
        integral_of(lambda t: 4.0 * t**3), 1.0, step=0.25, backend=backend
    )
    assert_allclose(result["block.y"], result.time**4, rtol=1e-14)


@pytest.mark.parametrize("solver", IMPLICIT)
@pytest.mark.parametrize("backend", ["numpy", "interpreted"])
def test_stiff_linear_system(solver, backend):
    stiff = np.diag([-1e6, -1.0, -1e3]) + np.triu(np.ones((3, 3)), 1)
    result = simulate(
        linear(stiff), 1.0, solver=solver, backend=backend, log_step=0.25, **PRECISE
    )
    exact = scipy.linalg.expm(stiff) @ np.ones(3)
    assert_near(result["block.y"][-1], exact, GLOBAL_TOLERANCE)


@pytest.mark.parametrize("solver", METHODS)
def test_steps_that_shrink_at_a_jump_end_the_run(solver):
    """A state comes to rest by dry friction, at t = 1/0.7."""
    slide = Function(lambda x: 0.3 - np.sign(x - 1.0))
    diagram = ring(block=Integrator(2.0), slide=slide)
    with pytest.raises(
        DivergenceError,
        match=r"'block\.\w+'.* Declare a Mode for a quantity that switches",
    ) as error:
        simulate(diagram, 5.0, solver=solver, log_step=0.1)
    assert "jumps between" in str(error.value)
    assert error.value.result.time[-1] == pytest.approx(1.4)


def test_many_short_steps_from_jump_to_jump_are_taken():
    """The solver advances by a period within a few dozen steps, all short in a run that is so long."""
    wave = lambda t: np.where(t < 20.0, np.sign(np.sin(100.0 * t)), 0.0)  # noqa: E731
    settings = {"rtol": 1e-4, "atol": 1e-6, "log_step": 1e5}
    simulate(integral_of(wave), 1e5, solver="RK45", **settings)


def test_many_short_steps_of_a_smooth_motion_are_taken():
    """A vibration dies out in the first minutes of a run of thousands of years."""
    matrix = np.array([[-0.05, 1.0, 0.0], [-1.0, -0.05, 0.0], [0.0, 0.0, -1e-11]])
    result = simulate(linear(matrix), 1e11, solver="auto", log_step=1e11, rtol=1e-6)
    assert_near(result["block.y"][-1], [0.0, 0.0, np.exp(-1.0)], 1e-4)


@pytest.mark.parametrize("error", [TimeLimitError, KeyboardInterrupt])
def test_a_run_can_be_ended_between_steps(error, monkeypatch):
    """At none of the steps anything is logged."""
    count = itertools.count()

    def update(*_):
        if next(count) == 1:
            raise error

    monkeypatch.setattr(RunBar, "update", update)
    with pytest.raises(error) as ended:
        simulate(linear(A), 100.0, solver="Rodas5P", log_step=100.0)
    assert ended.value.result.sizes["time"] == 1


@pytest.mark.parametrize("solver", ["RK45", "DOP853"])
def test_a_smooth_rate_that_swings_within_a_step_does_not_jump(solver, monkeypatch):
    """Steps of loose tolerance, as long as a part of the swing; all of them are tested."""
    monkeypatch.setattr(run_module, "SHORT_STEP", 1.0)
    monkeypatch.setattr(run_module, "MAX_SHORT_STEPS", 0)
    diagram = integral_of(lambda t: np.sin(2.0 * np.pi * t), ())
    settings = {"rtol": 1e-2, "atol": 1e-4, "log_step": 200.0}
    assert simulate(diagram, 200.0, solver=solver, **settings).sizes["time"] == 2


def test_rows_are_no_short_steps(monkeypatch):
    """Without states the solver goes from row to row, and no derivative can jump."""
    monkeypatch.setattr(run_module, "SHORT_STEP", 1e-2)
    result = simulate(diagram_of(Sine(1.0, 1.0)), 1.0, solver="RK45", log_step=5e-4)
    assert result.sizes["time"] == 2001


@pytest.mark.parametrize("solver", METHODS)
def test_break_points_are_honoured(solver):
    """A short pulse that a solver steps over unless its times are break points."""

    def end(breakpoints):
        diagram = integral_of(
            lambda t: np.where(np.abs(t - 700.0) < 1.0, 0.5, 0.0), breakpoints
        )
        result = simulate(
            diagram, 1000.0, solver=solver, backend="interpreted", log_step=1000.0
        )
        return result["block.y"].values[-1]

    assert end((699.0, 701.0, 5.0, -1.0, 2e6, 0.0, 1000.0)) == pytest.approx(
        1.0, abs=SOLVER_TOLERANCE
    )
    assert end(()) == 0.0


@pytest.mark.parametrize("value", [np.nan, "soon"])
def test_break_points_must_be_times(value):
    class Pulse(Ramp):
        def breakpoints(self):
            return (1.0, value)

    with pytest.raises(
        SimulationError, match=r"breakpoints\(\) of block 'block' .*must be finite"
    ):
        simulate(diagram_of(Pulse()), 1.0, solver="RK45", backend="numpy")


@pytest.mark.parametrize("solver", ["rk4", *METHODS])
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_diagram_without_continuous_states(solver, backend):
    result = simulate(
        diagram_of(Ramp(2.0)),
        1.0,
        step=0.25,
        log_step=0.25,
        solver=solver,
        backend=backend,
    )
    assert_allclose(result["block.y"], [0.0, 0.5, 1.0, 1.5, 2.0], rtol=1e-14)
