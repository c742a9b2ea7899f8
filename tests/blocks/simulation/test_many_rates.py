"""Diagrams with many sample times, each subset of which ticks together at some instant."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from trussflow.blocks import (
    Backlash,
    Diagram,
    Function,
    Gain,
    Input,
    Output,
    PythonFunction,
    Ramp,
    Sum,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)

TICK = 0.01
DURATION = 3.0
CHAIN = [
    ("hold", 7, 0),
    ("delay", 2, 1),
    ("python", 3, 2),
    ("hold", 5, 0),
    ("delay", 11, 4),
    ("python", 2, 1),
    ("hold", 13, 12),
    ("delay", 7, 0),
]
"""What each block of a chain is, and its sample time and offset [ticks]."""


def made(kind, period, offset):
    if kind == "python":
        ports = {"inputs": {"u": Input()}, "outputs": {"y": Output()}}
        return PythonFunction(lambda u: 2.0 * u + 1.0, period, offset=offset, **ports)
    return (ZeroOrderHold if kind == "hold" else UnitDelay)(period, offset=offset)


def chain():
    """Return the blocks, each behind the one before, behind the time."""
    diagram = Diagram("chain")
    last = diagram.add(time=Ramp())
    for i, (kind, period, offset) in enumerate(CHAIN):
        last = last >> diagram.add(f"b{i}", made(kind, TICK * period, TICK * offset))
    return diagram


def by_hand(steps):
    """Return what the blocks show at each tick: all that tick compute in turn, then delays store."""
    shown, stored, rows = np.zeros(len(CHAIN)), np.zeros(len(CHAIN)), []
    for k in range(steps + 1):
        ticking = [
            k >= offset and (k - offset) % period == 0 for _, period, offset in CHAIN
        ]
        for i, (kind, _, _) in enumerate(CHAIN):
            if ticking[i]:
                u = shown[i - 1] if i else k * TICK
                shown[i] = {"hold": u, "delay": stored[i], "python": 2.0 * u + 1.0}[
                    kind
                ]
        for i, (kind, _, _) in enumerate(CHAIN):
            if ticking[i] and kind == "delay":
                stored[i] = shown[i - 1]
        rows.append(shown.copy())
    return np.array(rows)


def test_a_chain_of_many_rates_is_what_it_is_by_hand(backend):
    result = simulate(chain(), DURATION, step=TICK, backend=backend)
    exact = by_hand(round(DURATION / TICK))
    for i in range(len(CHAIN)):
        assert_allclose(result[f"b{i}.y"], exact[:, i], rtol=1e-12, atol=1e-12)


def test_clocks_count_from_where_a_run_begins():
    """What is sampled is then later by as much."""
    result = simulate(chain(), 1.0, start=0.12, step=TICK)
    exact = simulate(chain(), 1.0, step=TICK)
    later = result["b0.y"].values - exact["b0.y"].values
    assert_allclose(later, 0.12, rtol=1e-12)


def among_many_rates(diagram):
    """Return the diagram with a source ``time``, and blocks of six more rates behind that."""
    time = diagram.add(time=Ramp())
    for k in (4, 5, 6, 7, 11, 13):
        time >> diagram.add(f"hold{k}", ZeroOrderHold(TICK * k))
    return diagram


@pytest.mark.parametrize("law", [lambda u: -0.5 * u, lambda u: -np.tanh(u)])
def test_loops_of_many_rates_are_solved_where_their_blocks_tick_together(law, backend):
    """Where one of them ticks, the other shows what it showed: linear loops, and those that are iterated."""
    diagram = among_many_rates(Diagram("loop", loops="solve"))
    first, second = diagram.add(
        first=ZeroOrderHold(2 * TICK), second=ZeroOrderHold(3 * TICK)
    )
    between = diagram.add(law=Function(law, {"u": Input()}, {"y": Output()}))
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
