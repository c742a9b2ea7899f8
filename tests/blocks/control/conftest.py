"""Runs of a filter by its equations, and random samples of a linear process."""

import numpy as np
import pytest
import systems

from trussflow.blocks import Signals

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


@pytest.fixture(scope="session")
def follow():
    """Give a filter measurements and commands, sample by sample, and return its outputs and states."""

    def run(block, measurements, commands=None):
        p = Signals("filter", dict(block.parameters))
        x = Signals("filter", {name: block.initial(name, p) for name in block.states()})
        found = {}
        for k, y in enumerate(measurements):
            u = Signals("filter", {"measurement": y})
            if commands is not None:
                u["command"] = commands[k]
            t = np.float64(k * block.sample_time)
            for name, value in {**block.output(t, x, u, p), **x}.items():
                found.setdefault(name, []).append(value)
            x = Signals("filter", block.update(t, x, u, p))
        return {name: np.array(values) for name, values in found.items()}

    return run


@pytest.fixture(scope="session")
def draw():
    """Draw the states and measurements of a linear process, starting from a normal distribution."""

    def run(block, generator, commands, spread):
        process = block.process
        zero = np.zeros(block.order)
        x = generator.multivariate_normal(zero, spread, method="eigh")
        states, measurements = [], []
        for u in commands:
            v = generator.multivariate_normal(
                np.zeros(block.measurements), process.noise
            )
            states.append(x)
            measurements.append(process.C @ x + process.D @ u + v)
            w = generator.multivariate_normal(zero, process.covariance, method="eigh")
            x = process.A @ x + process.B @ u + w
        return np.array(states), np.array(measurements)

    return run
