"""Many draws flown in batches, each a job that is kept."""

from __future__ import annotations

import inspect
import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from trussflow.models.flight import draws, flights, measures
from trussflow.models.flight.draws import Draw
from trussflow.models.flight.flights import DURATION, Flights
from trussflow.models.flight.measures import measured_by_seed
from trussflow.models.reporting.cache import Work, digest_of, inputs_of

TUNED = 100
"""Seeds below this one were used for tuning, and are not flown here."""

BATCH = 50
TOLD = ("mass", "frequency", "damping", "payload")
"""What a batch tells of its draws."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draws:
    """A batch of draws of one case.

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
    first: int
    count: int = BATCH
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"case{self.case}-draws-{self.first}"

    def work(self, folder: Path) -> Work:
        """Make the batch ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        flying = Flights(self.case)
        modes = flying.plant.dynamics.modes.modes
        seeds = range(self.first, self.first + self.count)
        trusses = [Draw.of_seed(seed, modes) for seed in seeds]
        parameters = [flying.parameters(seed) for seed in seeds]
        listed = json.dumps([{k: np.asarray(v).tolist() for k, v in each.items()} for each in parameters])
        methods = [inspect.getsource(module) for module in (sys.modules[__name__], flights, measures, draws)]

        def compute() -> xr.Dataset:
            found = measured_by_seed((flying.fly(each, self.duration) for each in parameters), seeds)
            return found.assign({k: ("seed", [getattr(draw, k) for draw in trusses]) for k in TOLD})

        return Work((*inputs_of(flying.simulator, self.duration, {}), digest_of([listed]), *methods), compute)


def all_draws(case: int, count: int) -> list[Draws]:
    """Return the batches of a case.

    Parameters
    ----------
    case : int
        1 or 2.
    count : int
        How many draws [-].
    """
    return [Draws(case=case, first=TUNED + k, count=min(BATCH, count - k)) for k in range(0, count, BATCH)]
