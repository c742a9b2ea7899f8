"""Random diagrams of library blocks, one for each seed."""

import random

import numpy as np

from trussflow.blocks import (
    PD,
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
    Operation,
    Quintic,
    Ramp,
    RateLimiter,
    RetimedQuintic,
    Saturation,
    Sine,
    StateSpace,
    Step,
    Sum,
    Table,
    TimeTable,
    TransferFunction,
    Trapezoid,
    UnitDelay,
    Waypoints,
    ZeroOrderHold,
)
from trussflow.blocks.errors import TrussflowError


def number(r, size=None):
    """Return a number, or a few; sometimes one that asks for trouble."""
    if size is not None:
        return [number(r) for _ in range(size)]
    return r.choice([0.0, 1.0, -1.0, 0.5, r.uniform(-3, 3), r.uniform(-3, 3)])


def positive(r):
    return r.choice([0.1, 0.5, 1.0, 2.0])


def time(r):
    return r.choice([0.1, 0.2, 0.3, 0.05])


MAKERS = [
    lambda r, n: Constant(number(r, n)),
    lambda r, n: Step(r.choice([0.3, 0.35, 0.0]), initial_value=number(r, n)),
    lambda r, n: Ramp(number(r, n), start_time=r.choice([0.0, 0.2])),
    lambda r, n: Sine(number(r, n), positive(r)),
    lambda r, _n: Noise(positive(r), time(r), seed=r.randrange(9)),
    lambda r, n: TimeTable([0.0, 0.2, 1.0], [number(r, n) for _ in range(3)]),
    lambda r, n: Quintic(number(r, n), positive(r)),
    lambda r, n: RetimedQuintic(number(r, n), positive(r), time(r)),
    lambda r, n: Trapezoid(number(r, n), positive(r), positive(r)),
    lambda r, n: Waypoints(
        [0.0, 0.5, 1.0], [number(r, n) for _ in range(3)], stop=r.random() < 0.5
    ),
    lambda _r, n: Ground(n),
    lambda r, n: Gain(number(r, n)),
    lambda r, n: MatrixGain([number(r, n or 2) for _ in range(r.choice([1, 2]))]),
    lambda r, _n: Sum(r.choice(["+", "-", "++", "+-", "--+"])),
    lambda r, _n: Operation(r.choice([np.multiply, np.divide])),
    lambda r, _n: Function(
        r.choice([np.abs, np.sin, np.tanh, np.sqrt, np.exp, np.sign, np.log])
    ),
    lambda r, _n: Table([-1.0, 0.0, 2.0], number(r, 3), extrapolate=r.random() < 0.5),
    lambda r, _n: Saturation(-positive(r), positive(r)),
    lambda r, _n: DeadZone(-positive(r), positive(r)),
    lambda r, _n: RateLimiter(positive(r), time(r)),
    lambda r, n: Integrator(number(r, n)),
    lambda r, n: StateSpace(
        [[number(r), 1.0], [-1.0, number(r)]], number(r, 2), [number(r, 2)] * (n or 1)
    ),
    lambda r, _n: TransferFunction(number(r, r.choice([1, 2])), [1.0, positive(r)]),
    lambda r, _n: DiscreteTransferFunction(
        [number(r)], [1.0, number(r)], sample_time=time(r)
    ),
    lambda r, n: UnitDelay(time(r), number(r, n)),
    lambda r, _n: ZeroOrderHold(2.0 * time(r), offset=r.choice([0.0, 0.05])),
    lambda r, _n: PD(positive(r), positive(r)),
    lambda r, _n: DisturbanceObserver(positive(r)),
    lambda r, _n: IntegralSlidingMode(
        gamma=positive(r),
        mu=positive(r),
        beta=0.5,
        eta=positive(r),
        sigma=0.5,
        boundary_layer=0.1,
    ),
]


def build(seed):
    """Return a diagram of random blocks whose inputs are wired at random to outputs that fit.

    Most are wired without algebraic loops: from blocks before, or from those that hold their inputs back.
    """
    r = random.Random(seed)
    diagram, size, loops = (
        Diagram("random"),
        r.choice([None, None, 2, 3]),
        r.random() < 0.1,
    )
    for i in range(r.randrange(1, 9)):
        diagram.add(**{f"b{i}": r.choice(MAKERS)(r, r.choice([None, size, size]))})
    blocks = list(diagram.blocks.values())
    for i, block in enumerate(blocks):
        sources = [
            port
            for k, source in enumerate(blocks)
            if loops or k < i or isinstance(source, Integrator | StateSpace | UnitDelay)
            for port in source.outputs()
        ]
        sources += [port[r.choice([0, [-1, 0]])] for port in sources if port.shape]
        for port in block.inputs():
            for source in r.sample(sources, len(sources)):
                try:
                    source >> port
                except TrussflowError:
                    continue
                break
            else:
                diagram.ground(port)
    return diagram
