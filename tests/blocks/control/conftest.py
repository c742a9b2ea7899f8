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
