"""Laws on the plant of paper: six modes, 1 ms, nothing else in between."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import xarray as xr
from study_tools.cache import Work, inputs_of

from flight import measures
from flight.ladder import DURATION, LAWS, Law
from flight.measures import tracking
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting import metrics
from trussflow.models.reporting.metrics import largest_norm, late_part

GRASP_4 = "truss.grasp_displacement"

PAPER_LAWS = {
    "published": LAWS["published"],
    "mode-neutral": LAWS["mode-neutral"],
    "mean axes": replace(
        LAWS["mean axes"],
        label="mean axes, consistent plant",
        plant=TunableTruss.consistent,
        hold=1e-3,
        delay=1e-3,
        step=1e-3,
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class OnPaper:
    """Case 1 by one law, held for 1 ms; the mean axes take another one to compute, and see no modes.

    Attributes
    ----------
    law : str
        Of `PAPER_LAWS`.
    duration : float
        Of the flight [s].
    """

    law: str
    duration: float = DURATION

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"on paper by {self.law}"

    def work(self, folder: Path) -> Work:
        """Make the flight ready.

        Parameters
        ----------
        folder : pathlib.Path
            Not used: nothing is shared.
        """
        law: Law = PAPER_LAWS[self.law]
        _, simulator = law.simulator(law.hardware(), more=(GRASP_4,))

        def compute() -> xr.Dataset:
            run = simulator.run(self.duration, progress=False)
            error, grasp = tracking(run), run[GRASP_4].values[:, 3]
            late = grasp[late_part(run["time"].values)]
            return xr.Dataset(
                {
                    **{name: error[name] for name in ("position", "late position", "late attitude")},
                    "grasp 4": largest_norm(grasp),
                    "late grasp 4": largest_norm(late - late.mean(axis=0)),
                }
            )

        methods = [inspect.getsource(module) for module in (sys.modules[__name__], measures, metrics)]
        return Work((*inputs_of(simulator, self.duration, {}), *methods), compute)
