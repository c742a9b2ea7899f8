"""Free motions of the plant. Ordinary tests interpret its equations, as their runs are short."""

from typing import NamedTuple

import numpy as np
import pytest
import systems

from trussflow.blocks import simulate

interpreted = pytest.fixture(scope="module", autouse=True)(systems.interpreted)


class FreeMotion(NamedTuple):
    """Coordinates, speeds, and the conserved quantities (energy, both momenta) at all samples."""

    q: np.ndarray
    v: np.ndarray
    conserved: list[np.ndarray]

    @property
    def drifts(self):
        """Largest relative change of each conserved quantity."""
        changes = [
            np.linalg.norm(values - values[0], axis=1) for values in self.conserved
        ]
        return np.max(changes, axis=1) / [
            np.linalg.norm(values[0]) for values in self.conserved
        ]


@pytest.fixture
def free_motion():
    """Return a function that simulates a truss without inputs."""

    def move(truss, duration, q, v, **settings):
        diagram = systems.series(truss=truss)
        diagram.ground(truss.actuation)
        result = simulate(
            diagram, duration, initial={"truss.q": q, "truss.v": v}, **settings
        )
        q, v, energy = (
            result[f"truss.{name}"].values
            for name in ("coordinates", "speeds", "energy")
        )
        linear, angular = zip(*map(truss.dynamics.momentum, q, v), strict=True)
        return FreeMotion(q, v, [energy[:, None], np.array(linear), np.array(angular)])

    return move
