"""How the tests of estimation run a filter by its equations, and draw what it should make sense of."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import Signals
from trussflow.blocks.framework.types import Vector

Follow = Callable[..., dict[str, Vector]]
Draw = Callable[..., tuple[Vector, Vector]]


@pytest.fixture(scope="session")
def follow():
    """Give a filter measurements and commands, sample by sample, and return its outputs and states."""

    def run(block, measurements, commands=None):
        p = Signals("filter", dict(block.parameters))
        x = Signals("filter", {name: block.initial(name, p) for name in block.states()})
        found: dict[str, list[Any]] = {}
        for k, y in enumerate(measurements):
            u = Signals("filter", {"measurement": y})
            if commands is not None:
                u["command"] = commands[k]
            t = np.float64(k * (block.sample_time or 0.0))
            for name, value in {**block.output(t, x, u, p), **x}.items():
                found.setdefault(name, []).append(value)
            x = Signals("filter", block.update(t, x, u, p))
        return {name: np.array(values) for name, values in found.items()}

    return run


@pytest.fixture(scope="session")
def draw():
    """Draw the states and measurements of a linear process, starting from a normal distribution."""

    def drawn(block, generator, samples, commands, spread):
        process: Any = block.process
        n, m = block.order, block.measurements
        x = generator.multivariate_normal(np.zeros(n), spread, method="eigh")
        states, measurements = [], []
        for k in range(samples):
            v = generator.multivariate_normal(np.zeros(m), process.noise)
            states.append(x)
            measurements.append(process.C @ x + process.D @ commands[k] + v)
            w = generator.multivariate_normal(np.zeros(n), process.covariance, method="eigh")
            x = process.A @ x + process.B @ commands[k] + w
        return np.array(states), np.array(measurements)

    return drawn
