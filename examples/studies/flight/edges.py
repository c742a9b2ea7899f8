"""Flights at the edge: actuators of another gain, and arms that are not what the controller believes."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.cache import Work, inputs_of

from flight import draws, failures, flights, measures
from flight.campaign import TUNED
from flight.draws import NOMINAL
from flight.flights import Flights
from flight.margins import with_arms
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting import metrics

DURATION = 80.0
"""The motion takes 60 s [s]."""

GAINS = (0.5, 0.7, 1.4, 2.0)
"""Of all actuators [1]."""

PART = 0.05
"""By which arms differ from what is believed [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """Case 1 behind its hardware, with one thing that the controller does not know.

    Attributes
    ----------
    label : str
        For people.
    gain : float
        Of all actuators, beyond their limits too, from the start [1].
    mass, length : float
        Of the arms that are believed, by those that there are [1].
    seeds : tuple of int
        Of trusses and noise; `NOMINAL` is the nominal truss.
    duration : float
        Of each flight [s].
    """

    label: str
    gain: float = 1.0
    mass: float = 1.0
    length: float = 1.0
    seeds: tuple[int, ...] = (NOMINAL, *range(TUNED, TUNED + 3))
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"edge: {self.label}"

    def work(self, folder: Path) -> Work:
        """Make the flights ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        plant = TunableTruss.accurate()
        believed = with_arms(plant.dynamics, mass=self.mass, length=self.length)
        flying = Flights(1, plant=plant, believed=believed, losses=True)
        gains = {
            "loss.bases": np.full(plant.robots, self.gain),
            "loss.drives": np.full(plant.joints, self.gain),
        }

        def compute() -> xr.Dataset:
            each = [gains | flying.parameters(seed) for seed in self.seeds]
            return flying.measured(each, self.seeds, self.duration)

        modules = (sys.modules[__name__], measures, metrics, draws, flights, failures)
        methods = [inspect.getsource(module) for module in modules]
        return Work((*inputs_of(flying.simulator, self.duration, {}), repr(self), *methods), compute)


def edges() -> list[Edge]:
    """Return all that is flown at the edge."""
    gains = [Edge(label=f"actuators do {gain:g} times what they are told", gain=gain) for gain in GAINS]
    more, less = 1.0 / (1.0 + PART), 1.0 / (1.0 - PART)
    arms = [
        Edge(label=f"arms are heavier than believed by {PART:.0%}", mass=more),
        Edge(label=f"arms are lighter than believed by {PART:.0%}", mass=less),
        Edge(label=f"arms are longer than believed by {PART:.0%}", length=more),
        Edge(label=f"arms are shorter than believed by {PART:.0%}", length=less),
    ]
    return gains + arms
