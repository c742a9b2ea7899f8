"""Sampled and continuous blocks together: exact instants, simultaneous updates, no stale slopes."""

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import Counter, assert_near, ring

from trussflow.blocks import (
    Block,
    Diagram,
    Event,
    Gain,
    Input,
    Integrator,
    Mode,
    Output,
    Ramp,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)

BACKENDS = ("numpy", "interpreted", "compiled")
SOLVERS = ("rk4", "euler", "RK45", "DOP853", "Rodas5P", "auto")
ROUND_OFF = 1e-12  # some hundred additions of numbers near one
TICK = 0.01


class PythonGain(Gain):
    traced = False


class PythonDelay(UnitDelay):
    traced = False

    def feedthrough(self):
        return {"y": ()}


@pytest.mark.parametrize("gain", [Gain, PythonGain])
@pytest.mark.parametrize("solver, backend", [*product(SOLVERS, BACKENDS)])
def test_sampled_feedback_is_exact(solver, backend, gain):
    """X' = -2 x(t_k), sampled every 0.1 s, gives x(1) = 0.8^10 by hand."""
    loop = ring(integral=Integrator(1.0), feedback=gain(-2.0).sampled(0.1))
    result = simulate(
        loop, 1.0, step=0.05, log_step=0.1, solver=solver, backend=backend
    )
    assert_near(result["integral.y"], 0.8 ** np.arange(11), ROUND_OFF)


@pytest.mark.parametrize(
    "first, second",
    [(UnitDelay, UnitDelay), (PythonDelay, UnitDelay), (PythonDelay, PythonDelay)],
)
def test_updates_are_simultaneous(backend, first, second):
    """Two cross-coupled delays swap their values at each instant."""
    diagram = ring(a=first(0.1, 1.0), b=second(0.1, 2.0))
    result = simulate(diagram, 0.5, step=0.1, backend=backend)
    assert_array_equal(result["a.y"], [1, 2, 1, 2, 1, 2])
    assert_array_equal(result["b.y"], [2, 1, 2, 1, 2, 1])


def test_instants_are_integer_ticks_in_long_runs():
    """Ten thousand samples of 0.1 s fall on steps of 0.1 s, without a slip by round-off."""
    diagram = Diagram("counters")
    diagram.add(fast=Counter().sampled(0.1), slow=Counter().sampled(0.3))
    result = simulate(diagram, 1000.0, step=0.1, backend="compiled")
    assert_array_equal(result["fast.y"], np.arange(10001))
    assert_array_equal(result["slow.y"], np.arange(10001) // 3)


class Stopwatch(Block):
    """The time at which the input crossed a level."""

    u, y = Input(), Output()
    when = Mode()
    high = Event("rising")

    def output(self, t, x, u, p):
        return {"y": x.when}

    def indicators(self, t, x, u, p):
        return {"high": u.u - 0.7}

    def on_event(self, t, x, u, p, fired):
        return {"when": t}


@pytest.mark.parametrize("backend", ["numpy", "interpreted", "compiled"])
def test_a_jump_at_any_instant_causes_its_event_there(backend):
    """Behind a sampled ramp the event is at the sample, not within the step that follows."""
    diagram = Diagram("sampled")
    ramp, hold, watch = diagram.add(
        ramp=Ramp(1.0), hold=ZeroOrderHold(0.4), watch=Stopwatch()
    )
    ramp >> hold >> watch
    found = simulate(diagram, 2.0, step=0.2, backend=backend)
    assert found["watch.y"][-1] == 0.8
