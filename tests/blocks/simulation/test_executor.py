"""The executors agree: plain NumPy, CasADi's interpreter, and compiled code with its lanes."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from systems import ports, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Function,
    Input,
    Output,
    Parameter,
    State,
    TimeFunction,
    simulate,
)
from trussflow.blocks.tracing.kernels import repeated

TRACED = ("interpreted", "compiled")
ROUND_OFF = 1e-13  # relative, of libm against NumPy and of fused multiply-add


def values(block, backend):
    diagram = series("d", block=block)
    return simulate(diagram, 1.0, step=1.0, backend=backend)["block.y"].values[0]


@pytest.mark.parametrize("backend", TRACED)
@pytest.mark.parametrize("kernel", [False, True])
def test_quotients_that_are_rounded_or_compared_are_exact(kernel, backend):
    """49 times the reciprocal of 49 is less than 1, so its floor would be 0."""

    class Quotients(Block):
        y = Output((50, 4))
        divisor = Parameter(49.0)

        def output(self, t, x, u, p):
            def quotients(n, d):
                compared = np.where(n / d >= 1.0, 1.0, 0.0)
                return (np.stack([np.floor(n / d), n // d, np.mod(n, d), compared]),)

            pairs = [(n + 0.0 * t, p.divisor) for n in np.arange(50.0)]
            rows = (
                repeated(quotients, pairs)
                if kernel
                else [quotients(*pair) for pair in pairs]
            )
            return {"y": np.stack([row for (row,) in rows])}

    assert_array_equal(values(Quotients(), backend), values(Quotients(), "numpy"))


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
    arrays = [
        np.arange(np.prod(shape, dtype=int)).reshape(shape) + 1.0 for shape in SHAPES
    ]
    for i, numbers in enumerate(arrays):
        source = diagram.add(f"source{i}", Constant(numbers))
        held = diagram.add(f"held{i}", Held(numbers).sampled(1))
        source >> diagram.add(f"through{i}", Through(numbers)) >> held
    result = simulate(diagram, 2.0, step=1.0, backend=backend)
    for i, numbers in enumerate(arrays):
        assert_allclose(
            result[f"through{i}.y"].values[-1], 12.5 * numbers, rtol=ROUND_OFF
        )
        assert_allclose(
            result[f"held{i}.y"].values[-1], 38.25 * numbers, rtol=ROUND_OFF
        )


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
    grid = Function(lambda u: 1.0 * u, **ports(u=(2, 3), y=(2, 3)))
    source, grid = diagram.add(
        source=TimeFunction(lambda t: t + np.arange(1.0, 4.0)), grid=grid
    )
    source.y[::-1] >> grid.u[1]
    source.y[1] >> grid.u[0, 0]
    diagram.ground(grid.u[0, 1:])
    result = simulate(diagram, 1.0, step=1.0, backend=backend)
    assert_array_equal(result["grid.y"].values[0], [[2.0, 0.0, 0.0], [3.0, 2.0, 1.0]])


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
        subprocess.check_output(
            [sys.executable, "-c", SCRIPT], env=os.environ | {"PYTHONHASHSEED": seed}
        )
        for seed in "01"
    }
    assert len(digests) == 1
