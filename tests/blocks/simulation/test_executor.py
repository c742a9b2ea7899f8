"""The executors agree: plain NumPy, CasADi's interpreter, and compiled code with its lanes."""

import subprocess
import sys

import numpy as np
import pytest

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.simulator import Simulator, simulate
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
    """All operations on all points; `count` instances at a time as one kernel, or one by one."""

    y = Output(("functions", "points"))
    points_ = Parameter(POINTS, None)

    def __init__(self, count, chosen=tuple(OPERATIONS)):
        self.count, self.chosen = count, chosen
        self.functions, self.points = len(chosen), count or len(POINTS)
        super().__init__()

    def output(self, t, x, u, p):
        def kernel(a, b):
            return (np.stack([OPERATIONS[name](a, b) for name in self.chosen]),)

        instances = [(p.points_[i, 0], p.points_[i, 1]) for i in range(self.points)]
        if self.count:
            columns = [result for (result,) in repeated(kernel, instances)]
        else:
            columns = [kernel(*arguments)[0] for arguments in instances]
        return {"y": np.transpose(np.stack(columns))}


def values(block, backend, parameters=None):
    diagram = Diagram("d")
    diagram.add(block=block)
    simulator = Simulator(diagram, step=1.0, backend=backend, log=["block.y"])
    found: Vector = simulator.run(1.0, parameters=parameters, not_finite="ignore")["block.y"].values[0]
    return found


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("count", [0, 2, 3, 4, 5, 7])
def test_every_operation_agrees_with_numpy(count, backend):
    """Straight-line code (0) and kernels of all numbers of instances: full and partial lanes."""
    expected = values(Formulas(count), "numpy")
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(values(Formulas(count), backend), expected, rtol=ROUND_OFF, atol=1e-12)


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("count", [0, 4])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e308, 1e-310])
def test_operations_agree_at_the_edges(bad, count, backend):
    """What is not finite must come through, or a run would not stop where it should."""
    chosen = ("polynomial", "nested signs", "trigonometry", "hyperbolic", "exponential", "sign")
    # CasADi's interpreter loses NaN in a minimum or maximum.
    more: tuple[str, ...] = ("extremes",) if backend == "compiled" else ()
    points = POINTS.copy()
    points[1] = points[2, 0] = points[3, 1] = 0.0 if not np.isfinite(bad) else bad

    class Edge(Formulas):
        """A parameter is finite; the edge is made inside."""

        def output(self, t, x, u, p):
            if np.isfinite(bad):
                return super().output(t, x, u, p)
            marked = np.where(p.points_ == 0.0, 1.0, 0.0)
            infinite = 1e200 * marked * 1e200
            made = {np.inf: infinite, -np.inf: -infinite}.get(bad, np.sqrt(-marked))
            return super().output(t, x, u, Signals("p", {"points_": p.points_ + made}))

    with np.errstate(all="ignore"):
        expected = values(Edge(count, chosen + more), "numpy", parameters={"block.points_": points})
    found = values(Edge(count, chosen + more), backend, parameters={"block.points_": points})
    assert np.isfinite(bad) or not np.isfinite(expected).all()
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("count", [0, 4])
def test_quotients_that_are_rounded_or_compared_are_exact(count, backend):
    """49 times the reciprocal of 49 is less than 1, so its floor would be 0."""

    class Quotients(Block):
        y = Output((100, 4))
        divisor = Parameter(49.0)

        def output(self, t, x, u, p):
            def kernel(n, d):
                compared = np.where(n / d >= 1.0, 1.0, 0.0)
                return (np.stack([np.floor(n / d), n // d, np.mod(n, d), compared]),)

            pairs = [(n + 0.0 * t, p.divisor) for n in np.arange(100.0)]
            rows = repeated(kernel, pairs) if count else [kernel(*pair) for pair in pairs]
            return {"y": np.stack([row for (row,) in rows])}

    np.testing.assert_array_equal(values(Quotients(), backend), values(Quotients(), "numpy"))


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("shape", [(), (1,), (3,), (2, 3), (2, 3, 4), (1, 1), (0,), (0, 3)])
def test_arrays_of_every_shape_keep_their_order(shape, backend):
    """Row-major everywhere, zero-size and three-dimensional ports included."""
    numbers = np.arange(np.prod(shape, dtype=int)).reshape(shape) + 1.0

    class Source(Block):
        y = Output(shape)
        value = Parameter(numbers, None)

        def output(self, t, x, u, p):
            return {"y": p.value}

    class Through(Block):
        u = Input(shape)
        y = Output(shape)
        q = State(shape, initial="start")
        start = Parameter(10.0 * numbers, None)

        def output(self, t, x, u, p):
            return {"y": x.q + 0.5 * u.u}

        def derivative(self, t, x, u, p):
            return {"q": u.u}

    class Held(Through):
        derivative = Block.derivative

        def update(self, t, x, u, p):
            return {"q": x.q + u.u}

    diagram = Diagram("d")
    source, through, held = diagram.add(source=Source(), through=Through(), held=Held().sampled(1))
    source >> through >> held
    result = simulate(diagram, 2.0, step=1.0, backend=backend)
    np.testing.assert_allclose(result["through.y"].values[-1], 12.5 * numbers, rtol=ROUND_OFF)
    np.testing.assert_allclose(result["held.y"].values[-1], 38.25 * numbers, rtol=ROUND_OFF)


@pytest.mark.parametrize("backend", ["numpy", *TRACED])
def test_open_zero_size_inputs_need_no_wire(backend):
    class Plant(Block):
        extra = Input((0,))
        spare = Input((2,), default=3.0)
        y = Output()

        def output(self, t, x, u, p):
            return {"y": t + np.sum(u.extra) + u.spare[0] + u.spare[1]}

    assert float(values(Plant(), backend)) == 6.0


@pytest.mark.parametrize("backend", TRACED)
def test_one_input_made_of_slices_and_ground(backend):
    class Source(Block):
        y = Output((3,))

        def output(self, t, x, u, p):
            return {"y": t + np.arange(1.0, 4.0)}

    class Grid(Block):
        u = Input((2, 3))
        y = Output((2, 3))

        def output(self, t, x, u, p):
            return {"y": 1.0 * u.u}

    diagram = Diagram("d")
    source, grid = diagram.add(source=Source(), grid=Grid())
    source.y[::-1] >> grid.u[1]
    source.y[1] >> grid.u[0, 0]
    diagram.ground(grid.u[0, 1:])
    result = simulate(diagram, 1.0, step=1.0, backend=backend)
    np.testing.assert_array_equal(result["grid.y"].values[0], [[2.0, 0.0, 0.0], [3.0, 2.0, 1.0]])


SCRIPT = """
import hashlib, sys
from trussflow.blocks.tracing.codegen import c_sources, content
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output

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
        subprocess.run(
            [sys.executable, "-c", SCRIPT],
            capture_output=True,
            text=True,
            check=True,
            env={**__import__("os").environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed in range(3)
    }
    assert len(digests) == 1
