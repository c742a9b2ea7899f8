"""The executors agree: plain NumPy, CasADi's interpreter, and compiled code with its lanes."""

import os
import subprocess
import sys
from itertools import product

import numpy as np
import pytest

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Function,
    Input,
    Output,
    Parameter,
    Simulator,
    State,
    TimeFunction,
    simulate,
)
from trussflow.blocks.tracing.tracing import repeated

TRACED = ("interpreted", "compiled")
ROUND_OFF = 1e-13  # relative, of libm against NumPy and of fused multiply-add

OPERATIONS = {
    "polynomial": lambda a, b: 3.0 + 2.0 * a - a**2 + 0.5 * a**3 * b - b / -7.0 + 1.0 / (2.0 + a * a),
    "nested signs": lambda a, b: -np.negative(a) - (-(b - a)) * -1.5 - (a - (b - (a - b))),
    "powers": lambda a, b: np.abs(a) ** 1.7 + np.abs(b) ** a + np.sqrt(a * a + 1.0) + 2.0**b,
    "trigonometry": lambda a, b: np.sin(a) + np.cos(b) + np.tan(a / 4.0) + np.arctan2(a, b),
    "large angles": lambda a, b: np.sin(1e3 * a) + np.cos(1e4 * b) + np.sin(1e7 * a),
    "inverse": lambda a, b: np.arcsin(a / 8) + np.arccos(b / 8) + np.arctan(a) + np.arctanh(b / 9),
    "hyperbolic": lambda a, b: np.sinh(a) + np.cosh(b) + np.tanh(a) + np.arcsinh(b),
    "exponential": lambda a, b: np.exp(-a) + np.log(np.abs(b)) + np.exp(50.0 * a) * 1e-200,
    "rounding": lambda a, b: np.floor(a) + 10.0 * np.ceil(b) + np.abs(a - b),
    "comparison": lambda a, b: np.where(a < b, a, -b) + np.where(a <= 0.0, 1.0, 0.0) + (a > b) * 4.0,
    "logic": lambda a, b: np.where(
        np.logical_or(np.logical_and(a > 0.0, b > 0.0), np.logical_not(a < 1.0)), a * b, a + b
    ),
    "extremes": lambda a, b: np.minimum(a, b) + 3.0 * np.maximum(a, 0.5) + np.clip(b, -1.0, 1.0),
    "sign": lambda a, b: np.sign(a) + 2.0 * np.sign(b) + np.copysign(3.0, b),
}
"""Functions of two numbers, as users write them."""

POINTS = np.random.default_rng(1).uniform(-5.0, 5.0, (7, 2))


class Formulas(Block):
    """Operations on points; `count` instances as one kernel, or all one by one if it is zero."""

    y = Output(("functions", "points"))
    points_ = Parameter(POINTS, None)

    def __init__(self, count, names=tuple(OPERATIONS), **parameters):
        self.count, self.names, self.functions = count, names, len(names)
        self.points = count or len(POINTS)
        super().__init__(**parameters)

    def arguments(self, p):
        """Return pairs of numbers."""
        return p.points_

    def output(self, t, x, u, p):
        def kernel(a, b):
            return (np.stack([OPERATIONS[name](a, b) for name in self.names]),)

        pairs = self.arguments(p)
        instances = [(pairs[i, 0], pairs[i, 1]) for i in range(self.points)]
        if self.count:
            columns = [result for (result,) in repeated(kernel, instances)]
        else:
            columns = [kernel(*arguments)[0] for arguments in instances]
        return {"y": np.transpose(np.stack(columns))}


class EdgeFormulas(Formulas):
    """Arguments a b - c d from finite parameters, so that they may be infinite or not a number."""

    factors = Parameter(shape=None)

    def __init__(self, kernel, names, factors):
        super().__init__(len(factors) if kernel else 0, names, factors=factors)
        self.points = len(factors)

    def arguments(self, p):
        f = p.factors
        return f[..., 0] * f[..., 1] - f[..., 2] * f[..., 3]


def values(block, backend):
    diagram = Diagram("d")
    diagram.add(block=block)
    simulator = Simulator(diagram, step=1.0, backend=backend, log=["block.y"])
    return simulator.run(1.0, not_finite="ignore")["block.y"].values[0]


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("count", [0, 2, 3, 4, 5, 7])
def test_every_operation_agrees_with_numpy(count, backend):
    """Straight-line code (0) and kernels of all numbers of instances: full and partial lanes."""
    expected = values(Formulas(count), "numpy")
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(values(Formulas(count), backend), expected, rtol=ROUND_OFF, atol=1e-12)


EDGES = [(1e200, 1e200, 1e200, 1e200), (1e200, 1e200, 0.0, 0.0), (-1e200, 1e200, 0.0, 0.0)]
EDGES += [(number, 1.0, 0.0, 0.0) for number in (0.0, -0.0, 1e308, 1e-310)]
FINITE = (1.7, 1.0, 0.0, 0.0)


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("kernel", [False, True])
def test_operations_agree_at_the_edges(kernel, backend):
    """Numbers that are not finite must come through, or a run would not stop where it should."""
    names = ("polynomial", "nested signs", "trigonometry", "hyperbolic", "exponential", "sign")
    # CasADi's interpreter loses NaN in a minimum or maximum.
    names += ("extremes",) if backend == "compiled" else ()
    factors = np.array([*product(EDGES, EDGES), *product(EDGES, [FINITE]), *product([FINITE], EDGES)])
    with np.errstate(all="ignore"):
        expected = values(EdgeFormulas(kernel, names, factors), "numpy")
        found = values(EdgeFormulas(kernel, names, factors), backend)
    assert not np.isfinite(expected[:, :3]).all()
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("count", [0, 4])
def test_quotients_that_are_rounded_or_compared_are_exact(count, backend):
    """49 times the reciprocal of 49 is less than 1, so its floor would be 0."""

    class Quotients(Block):
        y = Output((50, 4))
        divisor = Parameter(49.0)

        def output(self, t, x, u, p):
            def kernel(n, d):
                compared = np.where(n / d >= 1.0, 1.0, 0.0)
                return (np.stack([np.floor(n / d), n // d, np.mod(n, d), compared]),)

            pairs = [(n + 0.0 * t, p.divisor) for n in np.arange(50.0)]
            rows = repeated(kernel, pairs) if count else [kernel(*pair) for pair in pairs]
            return {"y": np.stack([row for (row,) in rows])}

    np.testing.assert_array_equal(values(Quotients(), backend), values(Quotients(), "numpy"))


SHAPES = [(), (1,), (3,), (2, 3), (2, 3, 4), (1, 1), (0,), (0, 3)]


class Through(Block):
    u, y = Input("shape"), Output("shape")
    q = State("shape", initial="start")
    start = Parameter(shape="shape")

    def __init__(self, numbers):
        self.shape = numbers.shape
        super().__init__(start=10.0 * numbers)

    def output(self, t, x, u, p):
        return {"y": x.q + 0.5 * u.u}

    def derivative(self, t, x, u, p):
        return {"q": u.u}


class Held(Through):
    derivative = Block.derivative

    def update(self, t, x, u, p):
        return {"q": x.q + u.u}


@pytest.mark.parametrize("backend", TRACED)
def test_arrays_of_every_shape_keep_their_order(backend):
    """Row-major everywhere, zero-size and three-dimensional ports included."""
    diagram = Diagram("d")
    arrays = [np.arange(np.prod(shape, dtype=int)).reshape(shape) + 1.0 for shape in SHAPES]
    for i, numbers in enumerate(arrays):
        source = diagram.add(f"source{i}", Constant(numbers))
        held = diagram.add(f"held{i}", Held(numbers).sampled(1))
        source >> diagram.add(f"through{i}", Through(numbers)) >> held
    result = simulate(diagram, 2.0, step=1.0, backend=backend)
    for i, numbers in enumerate(arrays):
        np.testing.assert_allclose(result[f"through{i}.y"].values[-1], 12.5 * numbers, rtol=ROUND_OFF)
        np.testing.assert_allclose(result[f"held{i}.y"].values[-1], 38.25 * numbers, rtol=ROUND_OFF)


@pytest.mark.parametrize("backend", ["numpy", *TRACED])
def test_open_zero_size_inputs_need_no_wire(backend):
    class Plant(Block):
        extra, spare = Input(0), Input(2, default=3.0)
        y = Output()

        def output(self, t, x, u, p):
            return {"y": t + np.sum(u.extra) + u.spare[0] + u.spare[1]}

    assert values(Plant(), backend) == 6.0


@pytest.mark.parametrize("backend", TRACED)
def test_one_input_made_of_slices_and_ground(backend):
    diagram = Diagram("d")
    grid = Function(lambda u: 1.0 * u, {"u": Input((2, 3))}, {"y": Output((2, 3))})
    source, grid = diagram.add(source=TimeFunction(lambda t: t + np.arange(1.0, 4.0)), grid=grid)
    source.y[::-1] >> grid.u[1]
    source.y[1] >> grid.u[0, 0]
    diagram.ground(grid.u[0, 1:])
    result = simulate(diagram, 1.0, step=1.0, backend=backend)
    np.testing.assert_array_equal(result["grid.y"].values[0], [[2.0, 0.0, 0.0], [3.0, 2.0, 1.0]])


SCRIPT = """
import hashlib, sys
from trussflow.blocks.tracing.codegen import c_sources, content
from trussflow.blocks import Block, Diagram, Input, Output, Simulator

class Many(Block):
    a = Input(); b = Input(); c = Input(); y = Output(); z = Output()
    def output(self, t, x, u, p):
        return {"y": u.a + 2 * u.b + 3 * u.c + t, "z": t * t}

class Python(Many):
    traced = False

diagram = Diagram("d")
blocks = [diagram.add(**{f"m{i}": (Python if i % 2 else Many)()}) for i in range(6)]
for block in blocks:
    block.sampled(0.1)
diagram.ground(blocks[0].a, blocks[0].b, blocks[0].c)
for before, after in zip(blocks, blocks[1:]):
    before.y >> after.a; before.z >> after.b; before.y >> after.c
simulator = Simulator(diagram, step=0.1, backend="interpreted")
code = [content(simulator.prepared.programs), *c_sources(simulator.prepared.programs)]
print(hashlib.sha256("".join(code).encode()).hexdigest())
"""


def test_generated_code_is_the_same_in_every_process():
    """Otherwise the cache of compiled code would never be hit."""
    digests = {
        subprocess.check_output([sys.executable, "-c", SCRIPT], env=os.environ | {"PYTHONHASHSEED": seed})
        for seed in "01"
    }
    assert len(digests) == 1
