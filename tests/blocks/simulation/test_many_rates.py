"""Diagrams with more sample times than each set of them that ticks together has a program for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Output,
    PythonFunction,
    Ramp,
    Simulator,
    UnitDelay,
    ZeroOrderHold,
    simulate,
)
from trussflow.blocks.tracing.waits import FEW_CLOCKS

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


def made(kind: str, period: float, offset: float) -> Block:
    if kind == "python":
        ports: dict[str, Any] = {"inputs": {"u": Input()}, "outputs": {"y": Output()}}
        return PythonFunction(lambda u: 2.0 * u + 1.0, period, offset=offset, **ports)
    return (ZeroOrderHold if kind == "hold" else UnitDelay)(period, offset=offset)


def chain() -> Diagram:
    """Return the blocks, each behind the one before, behind the time."""
    diagram = Diagram("chain")
    last = diagram.add(time=Ramp())
    for i, (kind, period, offset) in enumerate(CHAIN):
        last = last >> diagram.add(f"b{i}", made(kind, TICK * period, TICK * offset))
    return diagram


def by_hand(steps: int) -> np.ndarray:
    """Return what the blocks show at each tick: all that tick compute in turn, then delays store."""
    shown, stored, rows = np.zeros(len(CHAIN)), np.zeros(len(CHAIN)), []
    for k in range(steps + 1):
        ticking = [k >= offset and (k - offset) % period == 0 for _, period, offset in CHAIN]
        for i, (kind, _, _) in enumerate(CHAIN):
            if ticking[i]:
                u = shown[i - 1] if i else k * TICK
                shown[i] = {"hold": u, "delay": stored[i], "python": 2.0 * u + 1.0}[kind]
        for i, (kind, _, _) in enumerate(CHAIN):
            if ticking[i] and kind == "delay":
                stored[i] = shown[i - 1]
        rows.append(shown.copy())
    return np.array(rows)


@pytest.mark.parametrize("backend", ["numpy", "interpreted", "compiled"])
def test_a_chain_of_many_rates_is_what_it_is_by_hand(backend: str) -> None:
    assert len({block[1:] for block in CHAIN}) > FEW_CLOCKS
    result = simulate(chain(), DURATION, step=TICK, backend=backend)
    exact = by_hand(round(DURATION / TICK))
    for i in range(len(CHAIN)):
        np.testing.assert_allclose(result[f"b{i}.y"], exact[:, i], rtol=1e-12, atol=1e-12, err_msg=f"b{i}")


def test_clocks_count_from_where_a_run_begins() -> None:
    """What is sampled is then later by as much."""
    result = simulate(chain(), 1.0, start=0.12, step=TICK)
    exact = simulate(chain(), 1.0, step=TICK)
    later = result["b0.y"].values - exact["b0.y"].values
    np.testing.assert_allclose(later, 0.12, rtol=1e-12, atol=0)


def test_twenty_rates_need_one_program() -> None:
    """They tick together in up to a million ways."""
    diagram = Diagram("twenty rates")
    last = diagram.add(time=Ramp())
    for k in range(1, 21):
        last = last >> diagram.add(f"hold{k}", ZeroOrderHold(0.01 * k))
    simulator = Simulator(diagram, step=0.01)
    assert [p.name for p in simulator.prepared.programs if p.name.startswith("sample")] == ["sample_1"]
    ticks = 50
    for k in range(20, 0, -1):
        ticks -= ticks % k
    assert simulator.run(0.5)["hold20.y"][-1] == pytest.approx(0.01 * ticks, rel=1e-12)
