"""How the tests of the library look at blocks: one by one, or driven in a small diagram."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks import Block, Constant, Diagram, Signals, simulate
from trussflow.blocks.framework.types import Array


@pytest.fixture(scope="session")
def evaluate() -> Callable[..., dict[str, Any]]:
    """Return the outputs of one block at one instant, in plain NumPy."""

    def outputs(
        block: Block, t: float = 0.0, states: dict[str, Any] | None = None, **inputs: Array
    ) -> dict[str, Any]:
        def signals(values: dict[str, Any]) -> Signals:
            return Signals("block", {n: np.asarray(v, dtype=float) for n, v in values.items()})

        return block.output(np.float64(t), signals(states or {}), signals(inputs), signals(block.parameters))

    return outputs


@pytest.fixture(scope="session")
def respond() -> Callable[..., xr.Dataset]:
    """Simulate one block, its inputs driven by constants or by sources."""

    def response(
        block: Block, duration: float, settings: dict[str, Any] | None = None, **inputs: Array
    ) -> xr.Dataset:
        diagram = Diagram("test")
        diagram.add(block=block)
        for name, given in inputs.items():
            source = given if isinstance(given, Block) else Constant(given)
            diagram.connect(diagram.add(**{f"{name}_source": source}).y, block.port(name))
        options: dict[str, Any] = {"step": 0.01, "backend": "interpreted", "progress": False} | (
            settings or {}
        )
        return simulate(diagram, duration, **options)

    return response
