"""Trusses as they may be, of which the controller knows the nominal one only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, misjudged, scaled

UNCERTAIN = 0.1
"""How far mass and frequencies are from nominal at most, and the deviation of mode shapes at most [-]."""

NOMINAL = -1
"""In place of a seed: the nominal truss, with the noise of seed 0."""

LIGHTEST_DAMPING, HEAVIEST_DAMPING = 1e-3, 1e-2
HEAVIEST_PAYLOAD = 20.0  # kg


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """What differs from the nominal truss.

    Attributes
    ----------
    mass, frequency : float
        Relative change of all masses, and of all frequencies [-].
    shapes : Vector, shape (h,)
        Relative change of how each mode moves the grasps [-].
    damping : float
        Of all modes, fraction of critical damping [-].
    payload : float
        Point mass at the tip that is farthest from the root [kg].
    """

    mass: float
    frequency: float
    shapes: Vector
    damping: float
    payload: float

    @classmethod
    def of_seed(cls, seed: int, modes: int) -> Self:
        """Return a draw: mass, frequencies and payload uniform, shapes normal, damping log-uniform.

        Parameters
        ----------
        seed : int
            Which draw.
        modes : int
            Of the truss [-].
        """
        random = np.random.default_rng(seed)
        mass, frequency = random.uniform(-UNCERTAIN, UNCERTAIN, 2)
        deviation = random.uniform(0.0, UNCERTAIN)
        return cls(
            mass=mass,
            frequency=frequency,
            shapes=deviation * random.standard_normal(modes),
            damping=10.0 ** random.uniform(np.log10(LIGHTEST_DAMPING), np.log10(HEAVIEST_DAMPING)),
            payload=random.uniform(0.0, HEAVIEST_PAYLOAD),
        )

    def truss(self, nominal: TrussModes) -> TrussModes:
        """Return the truss that it makes of the nominal one.

        Parameters
        ----------
        nominal : TrussModes
            Its damping does not matter.
        """
        bare = scaled(nominal.damped(0.0), mass=1.0 + self.mass, frequency=1.0 + self.frequency)
        laden = loaded(bare, tip(nominal), self.payload)
        return misjudged(laden, 1.0 + self.shapes).damped(self.damping)


def truss_of(seed: int, nominal: TrussModes) -> TrussModes:
    """Return the truss of a draw, or the nominal one.

    Parameters
    ----------
    seed : int
        Of the draw, or `NOMINAL`.
    nominal : TrussModes
        What the controller believes.
    """
    return nominal if seed == NOMINAL else Draw.of_seed(seed, nominal.modes).truss(nominal)


def parameters_of(plant: TunableTruss, truss: TrussModes) -> dict[str, Vector]:
    """Return a truss as parameters of a run.

    Parameters
    ----------
    plant : TunableTruss
        Named ``truss`` in the diagram.
    truss : TrussModes
        The one to fly.
    """
    return {f"truss.{name}": value for name, value in plant.truss_parameters(truss).items()}


def tip(truss: TrussModes) -> Vector:
    """Return the point of a truss that is farthest from its root [m]."""
    return np.asarray(truss.positions[np.argmax(np.linalg.norm(truss.positions, axis=1))])
