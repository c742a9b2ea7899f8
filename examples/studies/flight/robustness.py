"""Margins of the flown loop for many draws, in batches that are kept."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.cache import Work, digest_of

from flight import draws, margins, sampled_loop
from flight.draws import parameters_of, truss_of
from flight.flights import STEP
from flight.margins import INSTANTS, VARIATIONS, LoopMargins, loops_along
from trussflow.blocks.simulation.session import Session
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission


@dataclass(frozen=True, slots=True, kw_only=True)
class Robustness:
    """Margins along the flights of some draws of Case 1.

    Attributes
    ----------
    seeds : tuple of int
        Of the draws, or `NOMINAL`.
    """

    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"margins-{self.seeds[0]}"

    def work(self, folder: Path) -> Work:
        """Make the batch ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        plant, mission = TunableTruss.accurate(), Mission.of_case(1)
        diagram = mean_axes_transport(mission, plant)
        session = Session(diagram, outputs=[], step=STEP)
        codes = [program.code for program in session.prepared.programs]
        methods = [inspect.getsource(m) for m in (sys.modules[__name__], margins, draws, sampled_loop)]

        def compute() -> xr.Dataset:
            found: list[list[LoopMargins]] = []
            for seed in self.seeds:
                values = parameters_of(plant, truss_of(seed, plant.dynamics.modes))
                found.append(
                    [LoopMargins.of(loop) for _, loop in loops_along(session, mission.duration, values)]
                )
            radii = [[list(each.radii.values()) for each in row] for row in found]
            growth = np.log(radii) / MeanAxesDesign.shipped().sample_time
            return xr.Dataset(
                {
                    "growth": (("seed", "instant", "variation"), growth),
                    "disk": (("seed", "instant"), [[each.disk for each in row] for row in found]),
                    "delay": (("seed", "instant"), [[each.delay for each in row] for row in found]),
                },
                {"seed": list(self.seeds), "instant": list(INSTANTS), "variation": list(VARIATIONS)},
            )

        fixed = repr((self, mission, session.prepared.plan.p.listed(session.prepared.plan.parameters({}))))
        return Work((session.prepared.fingerprint, *codes, digest_of([fixed]), *methods), compute)
