"""What tuning brings: a design found on some trusses, flown on others beside the one chosen by hand."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.cache import digest_of, inputs_of

from flight import measures
from flight.flights import DURATION, STEP, Flights
from flight.margins import disks, loops_along
from flight.measures import UNITS, measured
from flight.sampled_loop import spectral_radius
from flight.samples import FIRST
from flight.sections import GOALS
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.blocks.sweeps.tuning import tune
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting import metrics
from trussflow.models.transport.mean_axes_wiring import mean_axes_transport
from trussflow.models.transport.mission import Mission

RANGES = {
    "position_bandwidth": (1.0, 2.0, 4.0),
    "attitude_bandwidth": (0.3, 0.6, 1.2),
    "position_noise": (-6.0, -5.0, -4.0),
    "attitude_noise": (-6.0, float(np.log10(5e-6)), -4.0),
}
"""Least, chosen by hand, and greatest: bandwidths [rad/s]; logarithms to base 10 of acceleration noise
[m/s²/√Hz, rad/s²/√Hz]."""

DISK = 0.25
"""Least disk margin of an actuator or sensor, nominal truss at rest; the shipped design has 0.26 [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """A search on some draws of Case 1, from what was chosen by hand, and flights of others.

    Attributes
    ----------
    seeds, others : range
        Of truss and noise: tuned on, and flown afterwards [-].
    trials : int
        How many designs are tried at most [-].
    duration : float
        Of each flight [s].
    """

    seeds: range = range(16)
    others: range = range(FIRST, FIRST + 64)
    trials: int = 25
    duration: float = DURATION

    def fly(self, folder: Path | None = None, *, workers: int | None = None) -> xr.Dataset:
        """Return what is measured of flights by each design, along ``design`` and ``seed``.

        Parameters
        ----------
        folder : pathlib.Path, optional
            Where finished flights are kept; the same call goes on with the others.
        workers : int, optional
            As for `sweep` [-].
        """
        flying, case = Flights(1), Mission.of_case(1)
        dynamics, simulator = flying.plant.dynamics, flying.simulator
        session = Session(mean_axes_transport(case, TunableTruss.accurate()), outputs=[], step=STEP)
        free = FreeModes.of(dynamics, MeanAxesDesign.shipped().estimated_modes)

        def becoming(**values: Any) -> dict[str, Vector]:
            design = design_of(values)
            return {
                "controller.law.bandwidth": design.of_groups(design.bandwidth, dynamics.rigid_freedoms),
                "controller.estimator.gain": design.estimator_gain(free),
            }

        def disk(values: Mapping[str, Any]) -> float:
            _, loop = next(loops_along(session, case.duration, becoming(**values), {"at rest": 0.0}))
            stable = spectral_radius(loop.closed()) < 1.0
            return min(float(each[:, 0].min()) for each in disks(loop).values()) if stable else 0.0

        if folder is not None:
            sources = [inspect.getsource(module) for module in (sys.modules[__name__], measures, metrics)]
            folder = folder / digest_of((*inputs_of(simulator, self.duration, {}), *sources))
        found = tune(
            simulator,
            self.duration,
            lambda run: shares(run).mean(),
            RANGES,
            becoming=becoming,
            limits={"share": (shares, 1.0)},
            requirements={"disk": (lambda values: -disk(values), -DISK)},
            samples=[flying.parameters(seed) for seed in self.seeds],
            derivatives=False,
            iterations=self.trials,
            path=folder and folder / "tuning",
            workers=workers,
        )
        by_hand = {name: value for name, (_, value, _) in RANGES.items()}
        shipped = values_of(MeanAxesDesign.shipped())
        designs = {"by hand": by_hand, "shipped": shipped, "tuned": values_of(design_of(found.values))}
        each = [becoming(**d) | flying.parameters(seed) for d in designs.values() for seed in self.others]
        flown = sweep(
            simulator,
            self.duration,
            vary={tuple(each[0]): [tuple(one.values()) for one in each]},
            keep=lambda run: measured(run) | {"share": shares(run).mean()},
            path=folder and folder / "flown",
            executor="threads",
            workers=workers,
            repeats=self.trials,
            not_finite="ignore",
            progress=False,
        )
        shape = len(designs), len(self.others)
        columns: dict[str, Any] = {
            name: (("design", "seed"), flown[name].values.reshape(shape)) for name in (*UNITS, "share")
        }
        columns |= {name: ("design", [values[name] for values in designs.values()]) for name in RANGES}
        columns["disk"] = "design", [disk(values) for values in designs.values()]
        told = {"before": found.before, "cost": found.cost, "runs": found.runs, "message": found.message}
        most = {"most": float(found.limits["share"].max())}
        return xr.Dataset(columns, {"design": [*designs], "seed": [*self.others]}, told | most)


def shares(run: xr.Dataset) -> Vector:
    """Return which part of each of `GOALS` a `run` takes [1]."""
    found = measured(run)
    return np.array([found[name] / most for name, most in GOALS.items()])


def design_of(values: Mapping[str, Any]) -> MeanAxesDesign:
    """Return the shipped design with other `values`, as of `RANGES`."""
    design = MeanAxesDesign.shipped()
    bandwidth, noise = design.bandwidth.copy(), design.acceleration_noise.copy()
    bandwidth[:2] = values["position_bandwidth"], values["attitude_bandwidth"]
    noise[:2] = 10.0 ** values["position_noise"], 10.0 ** values["attitude_noise"]
    return replace(design, bandwidth=bandwidth, acceleration_noise=noise)


def values_of(design: MeanAxesDesign) -> dict[str, float]:
    """Return the values of a `design`, as of `RANGES`."""
    values = [*design.bandwidth[:2], *np.log10(design.acceleration_noise[:2])]
    return dict(zip(RANGES, map(float, values), strict=True))
