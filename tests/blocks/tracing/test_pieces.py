"""Long programs become several C functions, which compute the same."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from systems import series

from trussflow.blocks import Block, Output, Parameter, Simulator, State
from trussflow.blocks.tracing import codegen
from trussflow.blocks.tracing.kernels import repeated


class Ring(Block):
    """Seven masses that pull at their neighbours, twice through kernels: three stages of code."""

    x = State(7, initial="start")
    start = Parameter(np.linspace(0.1, 0.7, 7), 7)
    y = Output(7)

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        def pull(a, b):
            return (np.sin(a) * np.cos(b) - np.exp(-a * a) / (2.0 + b * b),)

        first = [
            pulled
            for (pulled,) in repeated(pull, [(x.x[i], x.x[i - 1]) for i in range(7)])
        ]
        total = sum(first)
        second = repeated(pull, [(first[i] * total, x.x[i]) for i in range(7)])
        return {
            "x": np.stack(
                [a / total + b for a, (b,) in zip(first, second, strict=True)]
            )
        }


@pytest.mark.parametrize("length, file", [(1, 300), (5, 900), (40, 10**9)])
def test_pieces_compute_the_same(length, file, tmp_path, monkeypatch):
    diagram = series(ring=Ring())
    expected = Simulator(diagram, step=1e-2, backend="interpreted").run(1.0)
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path))
    monkeypatch.setattr(codegen, "MAX_PIECE_INSTRUCTIONS", length)
    monkeypatch.setattr(codegen, "MIN_FILE_SIZE", file)
    simulator = Simulator(diagram, step=1e-2, backend="compiled")
    main, *others = codegen.c_sources(simulator.prepared.programs)
    assert (len(others) > 1) == (file < 10**9)
    assert (main.count("hidden") if others else main.count("noinline")) > 40 / length
    found = simulator.run(1.0)
    assert_allclose(found["ring.y"], expected["ring.y"], rtol=1e-13)
