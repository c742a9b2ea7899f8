"""Random diagrams of library blocks run alike on all backends, or are refused by one of our errors.

Alike where NumPy's numbers are finite: CasADi simplifies u/u to 1 and 0*u to 0 before it evaluates.

TRUSSFLOW_DIAGRAMS sets their number, 60 by default; TRUSSFLOW_SEED where to begin.
"""

import os
import random
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import (
    PD,
    Block,
    Chirp,
    Concatenate,
    Constant,
    DeadZone,
    Diagram,
    DiscreteTransferFunction,
    DisturbanceObserver,
    Function,
    Gain,
    Ground,
    IntegralSlidingMode,
    Integrator,
    MatrixGain,
    Noise,
    Product,
    Quintic,
    Ramp,
    RateLimiter,
    Saturation,
    Select,
    Simulator,
    Sine,
    StateSpace,
    Step,
    Sum,
    Table,
    TimeTable,
    TransferFunction,
    Trapezoid,
    TrussflowError,
    UnitDelay,
    Waypoints,
    ZeroOrderHold,
)
from trussflow.blocks.framework.types import Vector

DIAGRAMS = int(os.environ.get("TRUSSFLOW_DIAGRAMS", "60"))
SEED = int(os.environ.get("TRUSSFLOW_SEED", "0"))
COMPILED_EVERY = 20

ALIKE = 1e-9
"""Relative to the largest number of a signal: round-off of other orders of the same operations."""


def number(r: random.Random, size: int | None = None) -> Any:
    """Return a number, or a few; sometimes one that asks for trouble."""
    if size is not None:
        return [number(r) for _ in range(size)]
    return r.choice([0.0, 1.0, -1.0, 0.5, r.uniform(-3, 3), r.uniform(-3, 3)])


def positive(r: random.Random) -> float:
    return r.choice([0.1, 0.5, 1.0, 2.0])


def time(r: random.Random) -> float:
    return r.choice([0.1, 0.2, 0.3, 0.05])


MAKERS: list[Callable[[random.Random, int | None], Block]] = [
    lambda r, n: Constant(number(r, n)),
    lambda r, n: Step(r.choice([0.3, 0.35, 0.0]), initial_value=number(r, n)),
    lambda r, n: Ramp(number(r, n), start_time=r.choice([0.0, 0.2])),
    lambda r, n: Sine(number(r, n), positive(r)),
    lambda r, n: Chirp(positive(r), positive(r), positive(r), amplitude=number(r, n)),
    lambda r, _n: Noise(positive(r), time(r), seed=r.randrange(9)),
    lambda r, n: TimeTable([0.0, 0.2, 1.0], [number(r, n) for _ in range(3)]),
    lambda r, n: Quintic(number(r, n), positive(r)),
    lambda r, n: Trapezoid(number(r, n), positive(r), positive(r)),
    lambda r, n: Waypoints([0.0, 0.5, 1.0], [number(r, n) for _ in range(3)], stop=r.random() < 0.5),
    lambda _r, n: Ground(n),
    lambda r, n: Gain(number(r, n)),
    lambda r, n: MatrixGain([number(r, n or 2) for _ in range(r.choice([1, 2]))]),
    lambda r, _n: Sum(r.choice(["+", "-", "++", "+-", "--+"])),
    lambda r, _n: Product(r.choice(["*", "**", "*/", "/", "**/"])),
    lambda r, _n: Select([r.randrange(-2, 3) for _ in range(r.choice([1, 2]))]),
    lambda r, _n: Concatenate([r.choice([1, 2]) for _ in range(r.choice([1, 2]))]),
    lambda r, _n: Function(r.choice([np.abs, np.sin, np.tanh, np.sqrt, np.exp, np.sign, np.log])),
    lambda r, _n: Table([-1.0, 0.0, 2.0], number(r, 3), extrapolate=r.random() < 0.5),
    lambda r, _n: Saturation(-positive(r), positive(r)),
    lambda r, _n: DeadZone(-positive(r), positive(r)),
    lambda r, _n: RateLimiter(positive(r), time(r)),
    lambda r, n: Integrator(number(r, n)),
    lambda r, n: StateSpace([[number(r), 1.0], [-1.0, number(r)]], number(r, 2), [number(r, 2)] * (n or 1)),
    lambda r, _n: TransferFunction(number(r, r.choice([1, 2])), [1.0, positive(r)]),
    lambda r, _n: DiscreteTransferFunction([number(r)], [1.0, number(r)], sample_time=time(r)),
    lambda r, n: UnitDelay(time(r), number(r, n)),
    lambda r, _n: ZeroOrderHold(2.0 * time(r), offset=r.choice([0.0, 0.05])),
    lambda r, _n: PD(positive(r), positive(r)),
    lambda r, _n: DisturbanceObserver(positive(r)),
    lambda r, _n: IntegralSlidingMode(
        gamma=positive(r), mu=positive(r), beta=0.5, eta=positive(r), sigma=0.5, boundary_layer=0.1
    ),
]


def build(seed: int) -> Diagram:
    """Return a diagram of random blocks whose inputs are wired at random to outputs that fit."""
    r = random.Random(seed)
    diagram, size = Diagram("random"), r.choice([None, None, 2, 3])
    for i in range(r.randrange(1, 9)):
        diagram.add(**{f"b{i}": r.choice(MAKERS)(r, r.choice([None, size, size]))})
    outputs = [port for block in diagram.blocks.values() for port in block.outputs()]
    for block in list(diagram.blocks.values()):
        for port in block.inputs():
            for source in r.sample(outputs, len(outputs)):
                try:
                    source >> port
                except TrussflowError:
                    continue
                break
            else:
                diagram.ground(port)
    return diagram


def run(diagram: Diagram, backend: str, solver: str) -> dict[str, Vector] | str:
    """Return all signals, or the name of the error of ours."""
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            simulator = Simulator(diagram, step=0.1, solver=solver, backend=backend)
            result = simulator.run(1.0, progress=False, not_finite="ignore")
    except TrussflowError as error:
        return type(error).__name__
    return {str(name): values.values for name, values in result.items()}


def check(seed: int) -> str:
    """Run the diagram of a seed on several backends; return how it went."""
    diagram, solver = build(seed), random.Random(seed).choice(["rk4", "rk4", "euler"])
    expected = run(diagram, "numpy", solver)
    for backend in ["interpreted", "compiled"] if seed % COMPILED_EVERY == 0 else ["interpreted"]:
        found = run(diagram, backend, solver)
        if expected == "DivergenceError":
            continue  # traced, 0/0 of equal signals is 1: what is not finite need not be so traced
        if isinstance(expected, str) or isinstance(found, str):
            assert expected == found, f"seed {seed}: numpy {expected!s:.200}, {backend} {found!s:.200}"
            continue
        for name, values in expected.items():
            finite = np.isfinite(values)
            scale = max(1.0, np.abs(values[finite]).max(initial=0.0))
            np.testing.assert_allclose(
                found[name][finite],
                values[finite],
                rtol=0.0,
                atol=ALIKE * scale,
                err_msg=f"seed {seed}: {name} on {backend}",
            )
    return expected if isinstance(expected, str) else "ran"


@pytest.mark.parametrize("part", range(4))
def test_random_diagrams_run_alike_or_are_refused(part: int) -> None:
    found = [check(seed) for seed in range(SEED + part, SEED + DIAGRAMS, 4)]
    assert "ran" in found
