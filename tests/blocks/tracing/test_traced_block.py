"""Equations traced once and filled in again equal equations traced in place."""

import numpy as np
import pytest
from systems import assert_near

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Parameter, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.simulation.simulator import simulate
from trussflow.blocks.tracing.kernels import repeated
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.blocks.tracing.traced_block import TracedBlock

ROUND_OFF = 1e-13


def bent(a, b):
    return np.sin(a) * b + a / (1.0 + b * b), a * b


class Source(Block):
    """A vector, a scalar, and a matrix with structural zeros."""

    vector = Output(6)
    scalar = Output()
    matrix = Output((4, 4))
    a = Parameter(1.3)

    def output(self, t, x, u, p):
        pairs = np.array([[5.0, 1.0], [1.0, 4.0]])
        rows = [
            np.stack(
                [
                    p.a * pairs[i % 2, j % 2] if i // 2 == j // 2 else 0.0
                    for j in range(4)
                ]
            )
            for i in range(4)
        ]
        vector = np.stack([p.a * i + t for i in range(6)])
        return {"vector": vector, "scalar": np.cos(t), "matrix": np.stack(rows)}


class Everything(Block):
    """Kernels that follow one another, linear equations, a branch and a state."""

    vector = Input(6)
    scalar = Input()
    matrix = Input((4, 4))
    pair = Input(2, default=0.0)
    kernels = Output(6)
    solution = Output(4)
    branch = Output()
    q = State(6)
    k = Parameter(0.7)

    def output(self, t, x, u, p):
        first = repeated(bent, [(u.vector[i], u.scalar * (i % 2)) for i in range(6)])
        between = [b / (2.0 + p.k) + x.q[i] for i, (_, b) in enumerate(first)]
        second = repeated(
            bent, [(between[i], u.pair[i % 2] * first[5 - i][0]) for i in range(6)]
        )
        regular = u.matrix + 3.0 * p.k * np.eye(4)
        return {
            "kernels": np.stack(
                [a[0] + p.k * b[0] for a, b in zip(first, second, strict=True)]
            ),
            "solution": solve_positive_definite(regular, u.vector[:4]),
            "branch": np.where(
                u.scalar > 0.5, u.vector[0] / (2.0 + u.scalar), np.sum(u.pair)
            ),
        }

    def derivative(self, t, x, u, p):
        return {"q": 0.1 * self.output(t, x, u, p)["kernels"] - x.q}


def build(wiring):
    """Wire everything, something, or nothing but zeros."""
    diagram = Diagram("d")
    source, block = diagram.add(source=Source(), block=Everything())
    if wiring == "signals":
        source.vector >> block.vector
        source.scalar >> block.scalar
        source.matrix >> block.matrix
        source.vector[:2] >> block.pair
    elif wiring == "zeros among signals":
        source.vector[:3] >> block.vector[3:]
        source.matrix[:2, :2] >> block.matrix[2:, 2:]
        diagram.ground(
            block.vector[:3], block.scalar, block.matrix[:2], block.matrix[2:, :2]
        )
    else:
        diagram.ground(block.vector, block.scalar, block.matrix)
    return diagram


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize("wiring", ["signals", "zeros among signals", "zeros"])
def test_filled_in_equals_numpy(wiring, fits, backend, monkeypatch):
    monkeypatch.setattr(TracedBlock, "fits", lambda _self, _arguments: fits)
    found = simulate(build(wiring), 1.0, step=0.1, backend=backend)
    expected = simulate(build(wiring), 1.0, step=0.1, backend="numpy")
    assert (np.abs(expected["block.solution"]).max() > 0.1) == (wiring != "zeros")
    for name in expected:
        assert_near(found[name], expected[name], ROUND_OFF, err_msg=str(name))
