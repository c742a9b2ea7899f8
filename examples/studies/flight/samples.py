"""Many samples of what is uncertain about Case 1, flown by each law: how often it flies, and what matters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flight.draws import Draw, parameters_of, truss_of
from flight.flights import flown_hardware, noise_of
from flight.ladder import DURATION, JOINTS, LATE, LAWS, POSITION
from flight.measures import tracking
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.models.reporting.metrics import largest_component, late_part

FIRST = 1000
"""Seed of the first sample; those below were tuned on, or are flown by `campaign`."""

UNITS = {"position": "m", "attitude": "rad", "joints": "rad", "late position": "m", "late force": "N"}
"""What is kept of a sample, as `measures.UNITS` has it."""

UNCERTAINTIES = {"mass": "1", "frequency": "1", "damping": "1", "payload": "kg", "shapes": "1"}
"""What differs from the nominal truss, as `Draw` has it; of shapes the root of the mean square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """One law, where it is at home or behind the hardware of a flight.

    Attributes
    ----------
    law : str
        Of `LAWS`, with the plant that suits it.
    flown : bool
        Whether it sees and acts through `flown_hardware`; else all is exact, but held as long as the law is
        made for.
    """

    law: str
    flown: bool

    @property
    def name(self) -> str:
        """Its name in the report."""
        return f"{self.law}, {'hardware of the flight' if self.flown else 'exact'}"

    def fly(
        self,
        count: int,
        folder: Path | None = None,
        *,
        duration: float = DURATION,
        workers: int | None = None,
    ) -> xr.Dataset:
        """Return what is kept of so many samples, along ``sample``, with what was drawn and whether they fly.

        Parameters
        ----------
        count : int
            How many [-].
        folder : pathlib.Path, optional
            Where finished samples are kept; the same call goes on with the others.
        duration : float
            Of each flight [s].
        workers : int, optional
            As for `sweep` [-].
        """
        law, seeds = LAWS[self.law], range(FIRST, FIRST + count)
        hardware = flown_hardware(1) if self.flown else law.hardware()
        plant, simulator = law.simulator(hardware, ("truss.base_force",))
        modes = plant.dynamics.modes
        each = [
            parameters_of(plant, truss_of(seed, modes)) | (noise_of(seed) if self.flown else {})
            for seed in seeds
        ]
        swept = sweep(
            simulator,
            duration,
            vary={tuple(each[0]): [tuple(one.values()) for one in each]},
            keep=errors,
            path=None if folder is None else folder / self.name.replace(", ", "-").replace(" ", "-"),
            workers=workers,
            not_finite="ignore",
        )
        found = swept[[*UNITS, "status"]].drop_vars(tuple(each[0]), errors="ignore")
        drawn = [_told(Draw.of_seed(seed, modes.modes)) for seed in seeds]
        return found.assign(
            {
                name: ("sample", [one[name] for one in drawn], {"units": UNCERTAINTIES[name]})
                for name in drawn[0]
            }
        ).assign(flies=flies(found))


def errors(run: xr.Dataset) -> dict[str, float]:
    """Return the greatest errors and late forces of a `run`, as `UNITS` names them."""
    late = run["truss.base_force"].values[late_part(run["time"].values)]
    found = tracking(run) | {"late force": largest_component(late)}
    return {name: found[name] for name in UNITS}


def flies(found: xr.Dataset) -> xr.DataArray:
    """Tell which samples of `found` end where they should and are never lost on the way, as in the ladder."""
    near = (found["position"] <= POSITION) & (found["joints"] <= JOINTS) & (found["late position"] < LATE)
    return near & (found["status"] == "complete")


def share(flown: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return which part of `flown` (yes or no) is yes, and its 95 % confidence interval by Wilson [1]."""
    from scipy.stats import binomtest

    interval = binomtest(int(np.sum(flown)), len(flown)).proportion_ci(method="wilson")
    return float(np.mean(flown)), float(interval.low), float(interval.high)


def what_matters(found: xr.Dataset, measure: str) -> dict[str, float]:
    """Return the rank correlation (Spearman) of a `measure` of samples `found` with all that was drawn [1].

    Those that fly count. Beyond about 2/sqrt(n), n samples, it is no accident; it is NaN of fewer than three.
    """
    from scipy.stats import spearmanr

    flown = found.sel(sample=found["sample"][found["flies"].values])
    if flown.sizes["sample"] < 3:
        return dict.fromkeys(UNCERTAINTIES, np.nan)
    return {name: float(spearmanr(flown[name], flown[measure]).statistic) for name in UNCERTAINTIES}


def _told(draw: Draw) -> Mapping[str, float]:
    """Return what differs in a draw, as `UNCERTAINTIES` names it."""
    own = {name: getattr(draw, name) for name in ("mass", "frequency", "damping", "payload")}
    return own | {"shapes": float(np.sqrt(np.mean(draw.shapes**2)))}


def studies() -> Sequence[Study]:
    """Return all that is flown."""
    laws = [Study(law=law, flown=flown) for law in ("published", "mode-neutral") for flown in (False, True)]
    return [*laws, Study(law="mean axes", flown=True)]
