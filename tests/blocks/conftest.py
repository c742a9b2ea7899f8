"""Evaluation of one block, and its response in a small diagram."""

import numpy as np
import pytest
from systems import simulate_block

from trussflow.blocks import Block, Constant, Signals


@pytest.fixture(params=["numpy", "interpreted", "compiled"])
def backend(request):
    """Return each backend in turn."""
    return request.param


@pytest.fixture(params=["rk4", "RK45"])
def solver(request):
    """Return a solver with fixed steps, and one that adapts them."""
    return request.param


@pytest.fixture(scope="session")
def evaluate():
    """Return the outputs of one block at one instant, in plain NumPy."""

    def outputs(block, t=0.0, states=None, **inputs):
        def signals(values):
            return Signals(
                "block", {n: np.asarray(v, dtype=float) for n, v in values.items()}
            )

        return block.output(
            np.float64(t),
            signals(states or {}),
            signals(inputs),
            signals(block.parameters),
        )

    return outputs


@pytest.fixture(scope="session")
def respond():
    """Simulate one block, its inputs driven by constants or by sources."""

    def response(block, duration, settings=None, **inputs):
        sources = {
            name: value if isinstance(value, Block) else Constant(value)
            for name, value in inputs.items()
        }
        return simulate_block(
            block, duration, sources, **{"step": 0.01, **(settings or {})}
        )

    return response
