"""Sampled and continuous blocks together: exact instants, simultaneous updates, no stale slopes."""

from itertools import product
from typing import ClassVar

import numpy as np
import pytest

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.simulation.simulator import simulate

BACKENDS = ("numpy", "interpreted", "compiled")
SOLVERS = ("rk4", "euler", "RK45", "DOP853", "LSODA", "BDF", "Radau")
ROUND_OFF = 1e-12  # some hundred additions of numbers near one
TICK = 0.01


class Integral(Block):
    u = Input()
    y = Output()
    x = State(initial=1.0)

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": u.u}


class Gain(Block):
    u = Input()
    y = Output()
    gain = Parameter(1.0)

    def output(self, t, x, u, p):
        return {"y": p.gain * u.u}


class PythonGain(Gain):
    traced = False


class Square(Block):
    y = Output()

    def output(self, t, x, u, p):
        return {"y": t * t + 1.0}


class Affine(Block):
    u = Input()
    y = Output()

    def output(self, t, x, u, p):
        return {"y": 2.0 * u.u + 1.0}


class Filter(Block):
    """A sampled block with a state and direct feedthrough."""

    u = Input()
    y = Output()
    s = State()

    def output(self, t, x, u, p):
        return {"y": x.s + u.u}

    def update(self, t, x, u, p):
        return {"s": 0.5 * x.s + u.u}


class PythonFilter(Filter):
    traced = False


class Delay(Block):
    u = Input()
    y = Output()
    s = State(initial="start")
    start = Parameter(0.0)

    def output(self, t, x, u, p):
        return {"y": x.s}

    def update(self, t, x, u, p):
        return {"s": u.u}


class PythonDelay(Delay):
    traced: ClassVar[bool] = False

    def feedthrough(self):
        return {"y": ()}


@pytest.mark.parametrize("gain", [Gain, PythonGain])
@pytest.mark.parametrize(("solver", "backend"), [*product(SOLVERS, BACKENDS)])
def test_sampled_feedback_is_exact(solver, backend, gain):
    """X' = -2 x(t_k), sampled every 0.1 s, gives x(1) = 0.8^10 by hand."""
    loop = Diagram("loop")
    integral, feedback = loop.add(integral=Integral(), feedback=gain(gain=-2.0).sampled(0.1))
    integral >> feedback >> integral
    result = simulate(loop, 1.0, step=TICK, solver=solver, backend=backend)
    expected = 0.8 ** np.arange(11)
    at_samples = result["integral.y"].sel(time=np.arange(11) / 10, method="nearest")
    np.testing.assert_allclose(at_samples, expected, rtol=0, atol=ROUND_OFF)


def by_hand(ratios, offsets, last):
    """Return what the filters of the chain below hold at each tick, in integer ticks."""
    held, states = [0.0] * len(ratios), [0.0] * len(ratios)
    rows = []
    for k in range(last + 1):
        signal, following = (k * TICK) ** 2 + 1.0, list(states)
        for i, (ratio, offset) in enumerate(zip(ratios, offsets, strict=True)):
            u = 2.0 * signal + 1.0
            if k >= offset and (k - offset) % ratio == 0:
                held[i], following[i] = states[i] + u, 0.5 * states[i] + u
            signal = held[i]
        states = following
        rows.append(list(held))
    return np.array(rows)


def chain(ratios, offsets, python):
    """Return square -> affine -> filter -> affine -> filter -> affine -> filter."""
    diagram = Diagram("chain")
    before: Block = diagram.add(square=Square())
    for i, (ratio, offset) in enumerate(zip(ratios, offsets, strict=True)):
        kind = PythonFilter if python[i] else Filter
        affine, sampled = diagram.add(
            **{f"a{i}": Affine(), f"f{i}": kind().sampled(ratio * TICK, offset * TICK)}
        )
        before >> affine >> sampled
        before = sampled
    return diagram


@pytest.mark.parametrize("python", [*product((False, True), repeat=3)])
@pytest.mark.parametrize("offsets", [(0, 0, 0), (1, 0, 4), (2, 1, 6)])
@pytest.mark.parametrize("ratios", [(3, 2, 7), (7, 2, 3)])
def test_multirate_chain_is_exact(ratios, offsets, python):
    offsets = tuple(o % r for o, r in zip(offsets, ratios, strict=True))
    last = 2 * 3 * 7 + 5
    diagram = chain(ratios, offsets, python)
    result = simulate(diagram, last * TICK, step=TICK, backend="interpreted")
    found = np.stack([result[f"f{i}.y"] for i in range(3)], axis=1)
    np.testing.assert_allclose(found, by_hand(ratios, offsets, last), rtol=ROUND_OFF)


@pytest.mark.parametrize("python", [(False, False, False), (True, False, True)])
@pytest.mark.parametrize(("solver", "backend"), [*product(("rk4",), BACKENDS), ("BDF", "numpy")])
def test_multirate_chain_is_exact_however_it_runs(solver, backend, python):
    ratios, offsets, last = (3, 2, 7), (1, 0, 4), 47
    result = simulate(
        chain(ratios, offsets, python), last * TICK, step=TICK, log_step=TICK, solver=solver, backend=backend
    )
    found = np.stack([result[f"f{i}.y"] for i in range(3)], axis=1)
    np.testing.assert_allclose(found, by_hand(ratios, offsets, last), rtol=ROUND_OFF)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("first", "second"), [(Delay, Delay), (PythonDelay, Delay), (PythonDelay, PythonDelay)]
)
def test_updates_are_simultaneous(backend, first, second):
    """Two cross-coupled delays swap their values at each instant."""
    diagram = Diagram("swap")
    a, b = diagram.add(a=first(start=1.0).sampled(0.1), b=second(start=2.0).sampled(0.1))
    a >> b >> a
    result = simulate(diagram, 0.5, step=0.1, backend=backend)
    np.testing.assert_array_equal(result["a.y"], [1, 2, 1, 2, 1, 2])
    np.testing.assert_array_equal(result["b.y"], [2, 1, 2, 1, 2, 1])


@pytest.mark.parametrize("solver", ["rk4", "RK45"])
@pytest.mark.parametrize("gain", [Gain, PythonGain])
def test_first_sample_is_at_the_offset_and_holds(solver, gain):
    """Before the first instant a sampled output is zero, then what was sampled last."""
    diagram = Diagram("hold")
    square, now, later = diagram.add(
        square=Square(), now=gain().sampled(0.04), later=gain().sampled(0.04, offset=0.01)
    )
    square >> now
    square >> later
    result = simulate(diagram, 0.06, step=TICK, log_step=TICK, solver=solver, backend="numpy")
    t = np.array([0.0, 0.0, 0.0, 0.0, 0.04, 0.04, 0.04])
    np.testing.assert_allclose(result["now.y"], t * t + 1, rtol=ROUND_OFF)
    t = np.array([np.nan, 0.01, 0.01, 0.01, 0.01, 0.05, 0.05])
    np.testing.assert_allclose(result["later.y"], np.nan_to_num(t * t + 1), rtol=ROUND_OFF)


@pytest.mark.parametrize("backend", BACKENDS)
def test_loop_through_the_integrated_output_of_a_nested_diagram_is_legal(backend):
    """The inner diagram passes u on and integrates it; 1 - integral fed back gives e^-t."""

    class Difference(Block):
        u = Input()
        y = Output()

        def output(self, t, x, u, p):
            return {"y": 1.0 - u.u}

    outer, middle, inner = Diagram("outer"), Diagram("middle"), Diagram("inner")
    direct, integral = inner.add(direct=Gain(), integral=Integral())
    inner.expose(u=(direct.u, integral.u), passed=direct.y, integrated=integral.y)
    middle.add(inner=inner)
    middle.expose(u=inner.u, passed=inner.passed, integrated=inner.integrated)
    difference, middle = outer.add(difference=Difference(), middle=middle)
    difference >> middle.u
    middle.integrated >> difference
    result = simulate(outer, 1.0, step=TICK, backend=backend, initial={"middle.inner.integral.x": 0})
    truncation = 1e-9  # of RK4: h^4 / 120
    np.testing.assert_allclose(result["middle.inner.direct.y"], np.exp(-result.time), rtol=0, atol=truncation)


def test_instants_are_integer_ticks_in_long_runs():
    """Ten thousand samples of 0.1 s fall on steps of 0.1 s, without a slip by round-off."""

    class Counter(Block):
        y = Output()
        n = State()

        def output(self, t, x, u, p):
            return {"y": x.n}

        def update(self, t, x, u, p):
            return {"n": x.n + 1.0}

    diagram = Diagram("counters")
    diagram.add(fast=Counter().sampled(0.1), slow=Counter().sampled(0.3))
    result = simulate(diagram, 1000.0, step=0.1, backend="compiled")
    np.testing.assert_array_equal(result["fast.y"], np.arange(10001))
    np.testing.assert_array_equal(result["slow.y"], np.arange(10001) // 3)
