"""Diagrams with many sample times, each subset of which ticks together at some instant."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from systems import ports

from trussflow.blocks import (
    Backlash,
    Block,
    Diagram,
    Function,
    Gain,
    Input,
    Output,
    PythonFunction,
    Ramp,
    State,
    Sum,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)

TICK = 0.01
DURATION = 3.0
CHAIN = [
    ("hold", 7, 0),
    ("python filter", 2, 1),
    ("filter", 3, 2),
    ("delay", 5, 0),
    ("python", 11, 4),
    ("delay", 2, 1),
    ("hold", 13, 12),
    ("python", 7, 0),
]
"""What each block of a chain is, and its sample time and offset [ticks]."""


class Filter(Block):
    """A sampled block with a state and direct feedthrough."""

    u, y = Input(), Output()
    s = State()

    def output(self, t, x, u, p):
        return {"y": x.s + u.u}

    def update(self, t, x, u, p):
        return {"s": 0.5 * x.s + u.u}


class PythonFilter(Filter):
    traced = False


def made(kind, period, offset):
    if kind == "python":
        block = PythonFunction(lambda u: 2.0 * u + 1.0, **ports(u=(), y=()))
    elif "filter" in kind:
        block = PythonFilter() if "python" in kind else Filter()
    else:
        block = (ZeroOrderHold if kind == "hold" else UnitDelay)(period)
    return block.sampled(period, offset)


def chain(number=8):
    """Return the first blocks, each behind a gain behind the one before, behind the time."""
    diagram = Diagram("chain")
    last = diagram.add(time=Ramp())
    for i, (kind, period, offset) in enumerate(CHAIN[:number]):
        block = diagram.add(f"b{i}", made(kind, TICK * period, TICK * offset))
        last = last >> diagram.add(f"gain{i}", Gain(-1.5)) >> block
    return diagram


def by_hand(number, steps):
    """Return what the blocks show at each tick: all that tick compute in turn, then delays store."""
    shown, stored, rows = np.zeros(number), np.zeros(number), []
    for k in range(steps + 1):
        following = stored.copy()
        for i, (kind, period, offset) in enumerate(CHAIN[:number]):
            u = -1.5 * (shown[i - 1] if i else k * TICK)
            if k < offset or (k - offset) % period:
                continue
            if kind == "delay":
                shown[i], following[i] = stored[i], u
            elif "filter" in kind:
                shown[i], following[i] = stored[i] + u, 0.5 * stored[i] + u
            else:
                shown[i] = u if kind == "hold" else 2.0 * u + 1.0
        stored = following
        rows.append(shown.copy())
    return np.array(rows)


@pytest.mark.parametrize("number, solver", [(4, "rk4"), (8, "rk4"), (4, "RK45")])
def test_a_chain_of_many_rates_is_what_it_is_by_hand(backend, number, solver):
    """More than five clocks share one program."""
    settings = {"solver": solver, "step": TICK, "log_step": TICK}
    result = simulate(chain(number), DURATION, backend=backend, **settings)
    exact = by_hand(number, round(DURATION / TICK))
    for i in range(number):
        assert_allclose(result[f"b{i}.y"], exact[:, i], rtol=1e-12, atol=1e-12)


def among_many_rates(diagram, rates=(4, 5, 6, 7, 11, 13)):
    """Return the diagram with a source ``time``, and blocks of more rates behind that."""
    time = diagram.add(time=Ramp())
    for k in rates:
        time >> diagram.add(f"hold{k}", ZeroOrderHold(TICK * k))
    return diagram


@pytest.mark.parametrize("law", [lambda u: -0.5 * u, lambda u: -np.tanh(u)])
@pytest.mark.parametrize("rates", [(5,), (4, 5, 6, 7, 11, 13)], ids=len)
def test_loops_are_solved_where_their_blocks_tick_together(law, rates, backend):
    """Where one of them ticks, the other shows what it showed: linear loops, and those that are iterated."""
    diagram = among_many_rates(Diagram("loop", loops="solve"), rates)
    first, second = diagram.add(
        first=ZeroOrderHold(2 * TICK), second=ZeroOrderHold(3 * TICK)
    )
    between = diagram.add(law=Function(law))
    (diagram.time.y + second.y) >> first.u
    first >> between >> second
    result = simulate(diagram, 0.3, step=TICK, backend=backend)
    a, b, rows = 0.0, 0.0, []
    for k in range(31):
        if k % 6 == 0:
            a = brentq(lambda a, k=k: k * TICK + law(a) - a, -1.0, 1.0, xtol=1e-14)
            b = law(a)
        elif k % 2 == 0:
            a = k * TICK + b
        elif k % 3 == 0:
            b = law(a)
        rows.append((a, b))
    found = np.column_stack([result["first.y"], result["second.y"]])
    assert_allclose(found, rows, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("kind", ["hold", "python"])
def test_blocks_in_a_circle_that_never_tick_together_are_no_loop(kind):
    diagram = among_many_rates(Diagram("in turn"))
    first, second = diagram.add(
        first=made(kind, 2 * TICK, 0.0), second=made(kind, 2 * TICK, TICK)
    )
    halved = diagram.add(halved=Gain(-0.25))
    (diagram.time.y + second.y) >> first.u
    first >> halved >> second
    result = simulate(diagram, 0.3, step=TICK)
    gain, bias = (1.0, 0.0) if kind == "hold" else (2.0, 1.0)
    a, b, rows = 0.0, 0.0, []
    for k in range(31):
        if k % 2:
            b = gain * -0.25 * a + bias
        else:
            a = gain * (k * TICK + b) + bias
        rows.append((a, b))
    found = np.column_stack([result["first.y"], result["second.y"]])
    assert_allclose(found, rows, rtol=1e-12, atol=1e-12)


def test_loops_solved_for_initial_states_are_solved_anew_later():
    """All clocks tick at the start, and only some later."""
    diagram = among_many_rates(Diagram("started", loops="solve"))
    total, back, started, hold = diagram.add(
        total=Sum("++"),
        back=Gain(-0.5),
        started=Backlash(0.0, 2 * TICK),
        hold=ZeroOrderHold(2 * TICK),
    )
    diagram.hold7 >> total.u1
    total >> back >> total.u2
    total >> started
    total >> hold
    result = simulate(diagram, 0.3, step=TICK, backend="numpy")
    k = np.arange(31) // 2 * 2
    assert_allclose(result["hold.y"], k // 7 * 7 * TICK / 1.5, rtol=1e-12, atol=1e-12)
