"""Monte Carlo samples of the truss, of which the controller knows the nominal values only."""

from __future__ import annotations

from typing import Any

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.hardware.hardware import SENSOR_UNITS
from trussflow.models.hardware.measurement import derived_seed
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.truss.variations import loaded, misjudged, scaled

NOMINAL_SEED = -1
"""Seed of the nominal truss with the noise of seed 0."""

MAX_DEVIATION = 0.1
"""Largest relative deviation of mass and frequencies, and largest standard deviation of shapes [-]."""

MIN_DAMPING, MAX_DAMPING = 1e-3, 1e-2
MAX_PAYLOAD = 20.0  # kg

UNCERTAINTIES = {
    "mass": "1",
    "frequency": "1",
    "damping": "1",
    "payload": "kg",
    "shapes": "1",
}
"""Units of the uncertain quantities."""


def deviations(seed: int, modes: int) -> dict[str, Any]:
    """Return the sample of a seed, as arguments of `varied_truss`.

    Mass, frequency and payload are uniform, shapes normal, and the damping is log-uniform.

    Parameters
    ----------
    seed : int
        Seed of the random numbers.
    modes : int
        Number of modes [-].
    """
    random = np.random.default_rng(seed)
    mass, frequency = random.uniform(-MAX_DEVIATION, MAX_DEVIATION, 2)
    spread = random.uniform(0.0, MAX_DEVIATION)
    return {
        "mass": mass,
        "frequency": frequency,
        "shapes": spread * random.standard_normal(modes),
        "damping": 10.0 ** random.uniform(np.log10(MIN_DAMPING), np.log10(MAX_DAMPING)),
        "payload": random.uniform(0.0, MAX_PAYLOAD),
    }


def varied_truss(
    nominal: TrussModes,
    *,
    mass: float,
    frequency: float,
    shapes: Vector,
    damping: float,
    payload: float,
) -> TrussModes:
    """Return a truss that deviates from the nominal one.

    Parameters
    ----------
    nominal : TrussModes
        Nominal truss; its damping is not used.
    mass, frequency : float
        Relative change of all masses and of all frequencies [-].
    shapes : Vector, shape (h,)
        Relative change of each mode shape at the grasps [-].
    damping : float
        Damping ratio of all modes [-].
    payload : float
        Point mass at the tip [kg].
    """
    bare = scaled(nominal.damped(0.0), mass=1.0 + mass, frequency=1.0 + frequency)
    return misjudged(loaded(bare, tip(nominal), payload), 1.0 + shapes).damped(damping)


def sample_parameters(plant: TunableTruss, seed: int) -> dict[str, Any]:
    """Return the parameters of a run with the truss of a seed; the plant must be named ``truss``."""
    truss = plant.dynamics.modes
    if seed != NOMINAL_SEED:
        truss = varied_truss(truss, **deviations(seed, truss.modes))
    return truss_parameters(plant, truss)


def truss_parameters(plant: TunableTruss, truss: TrussModes) -> dict[str, Any]:
    """Return the parameters of a run with a truss; the plant must be named ``truss``."""
    return {
        f"truss.{name}": value for name, value in plant.truss_parameters(truss).items()
    }


def noise_parameters(seed: int) -> dict[str, int]:
    """Return the seeds of all sensors for a run with a seed."""
    return {
        f"sensors.{name}.noise.seed": derived_seed(derived_seed(max(seed, 0), k), 0)
        for k, name in enumerate(SENSOR_UNITS)
    }


def run_parameters(plant: TunableTruss, seed: int) -> dict[str, Any]:
    """Return `sample_parameters` and `noise_parameters` of a seed."""
    return sample_parameters(plant, seed) | noise_parameters(seed)


def tip(truss: TrussModes) -> Vector:
    """Return the point of a truss that is farthest from the origin of its frame [m]."""
    return np.asarray(
        truss.positions[np.argmax(np.linalg.norm(truss.positions, axis=1))]
    )
