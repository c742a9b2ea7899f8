"""Many draws flown, one job for each case."""

from __future__ import annotations

import inspect
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.cache import Work, digest_of, inputs_of

from flight import draws, flights, measures
from flight.draws import Draw
from flight.flights import DURATION, Flights
from trussflow.models.reporting import metrics

TUNED = 100
"""Seeds below this one were used for tuning, and are not flown here."""

TOLD = ("mass", "frequency", "damping", "payload")
"""What is told of the draws."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """Draws of one case, flown side by side on each core.

    Attributes
    ----------
    case : int
        1 or 2.
    first, count : int
        Seeds of truss and noise [-].
    duration : float
        Of each flight [s].
    """

    case: int
    count: int
    first: int = TUNED
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"case{self.case}-draws"

    def work(self, folder: Path) -> Work:
        """Make the draws ready.

        Parameters
        ----------
        folder : pathlib.Path
            Where flights are kept until all are flown.
        """
        flying = Flights(self.case)
        seeds = range(self.first, self.first + self.count)
        each = [flying.parameters(seed) for seed in seeds]
        listed = json.dumps([{k: np.asarray(v).tolist() for k, v in one.items()} for one in each])
        modules = (sys.modules[__name__], flights, measures, metrics, draws)
        methods = [inspect.getsource(module) for module in modules]
        inputs = (*inputs_of(flying.simulator, self.duration, {}), digest_of([listed]), *methods)

        def compute() -> xr.Dataset:
            found = flying.measured(each, seeds, self.duration, folder / digest_of(inputs))
            modes = flying.plant.dynamics.modes.modes
            trusses = [Draw.of_seed(seed, modes) for seed in seeds]
            return found.assign({k: ("seed", [getattr(draw, k) for draw in trusses]) for k in TOLD})

        return Work(inputs, compute)
