"""Tuning of the mean-axes design on some samples, and its comparison on others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.evidence import fingerprint
from study_tools.ledger import Ledger

from flight.campaigns import LONG_DURATION, Campaign, loop_fingerprint
from flight.loops import flight_hardware, flight_simulator
from flight.margins import loop_session, loops_along, min_disk
from flight.metrics import GOALS, LATE_WINDOW, median_and_worst, run_metrics, table
from flight.sampled_loop import spectral_radius
from flight.samples import run_parameters
from trussflow.blocks.support.types import Vector
from trussflow.blocks.sweeps.tuning import Tuned, tune
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.transport.mission import Mission

RANGES = {
    "position_bandwidth": (1.0, 2.0, 4.0),
    "attitude_bandwidth": (0.3, 0.6, 1.2),
    "position_noise": (-6.0, -5.0, -4.0),
    "attitude_noise": (-6.0, float(np.log10(5e-6)), -4.0),
}
"""Minimum, initial value and maximum: bandwidths [rad/s], and decimal logarithms of acceleration noise
[m/s²/√Hz, rad/s²/√Hz]."""

INITIAL = {name: value for name, (_, value, _) in RANGES.items()}

MIN_DISK = 0.25
"""Lower bound on the disk margin of each actuator and sensor, nominal truss at rest [-]."""

THRUST_STEP_TOLERANCE = 0.15
"""A larger thrust takes more than one step [N]."""

TEXT = """\
Bandwidths of position and attitude of the mean-axes controller, and the acceleration noise of both in its
estimator, were first chosen by hand. Sweeps of both cases then gave the shipped design. Here,
`tune(derivatives=False)` starts with the values chosen by hand, and simulates Case 1 with the reference
hardware for {duration:g} s with the seeds {first} to {last}. The objective is the mean, over runs and goals
of [docs/flight](../flight/README.md) ({goals}), of each metric relative to its goal. Constraints: no metric
above its goal, and no disk margin of an actuator or sensor below {disk} on the nominal truss at rest.
{runs} runs{ended} reduced the objective from {before} to {cost}. The largest metric relative to its goal is
{most}.

{designs}

Metrics for the {count} seeds {begin} to {end}, which were not used for tuning:

{metrics}

Compared run by run, the objective of the tuned design is lower by {initial} than that of the initial design,
and by {shipped} than that of the shipped one (95 % confidence intervals). A second step is a thrust of more
than one step of 0.1 N at any base in the last {late:g} s."""

Designs = Mapping[str, xr.Dataset]

COMPARED = "position", "attitude", "late position"

SEEDS, OTHER_SEEDS = range(16), range(1000, 1064)
"""Seeds of the tuning and of the comparison."""

MAX_TRIALS = 25
"""Maximum number of designs [-]."""


def tuned_designs(
    folder: Path | None = None,
    workers: int | None = None,
    *,
    seeds: range = SEEDS,
    others: range = OTHER_SEEDS,
    trials: int = MAX_TRIALS,
    duration: float = LONG_DURATION,
) -> tuple[Tuned, Designs]:
    """Tune from the design chosen by hand on some samples of Case 1, and compare designs on others.

    Parameters
    ----------
    folder : pathlib.Path, optional
        Folder for finished runs; the same call resumes.
    workers : int, optional
        Number of parallel runs, as for `sweep` [-].
    seeds, others : range
        Seeds of the tuning and of the comparison.
    trials : int
        Maximum number of designs [-].
    duration : float
        Simulated time [s].

    Returns
    -------
    Tuned, dict of str to xarray.Dataset
        Result of `tune`, and of the initial, shipped and tuned design the metrics along ``sample``; attributes
        are the values in the `RANGES` and the disk margin.
    """
    simulator, session = flight_simulator(), loop_session()
    plant = flight_hardware(1).mounted(TunableTruss.accurate())
    free = FreeModes.of(plant.dynamics, MeanAxesDesign.shipped().estimated_modes)

    def becoming(**values: Any) -> dict[str, Vector]:
        design = design_of(values)
        return {
            "controller.law.bandwidth": design.of_groups(
                design.bandwidth, plant.dynamics.rigid_freedoms
            ),
            "controller.estimator.gain": design.estimator_gain(free),
        }

    def disk(values: Mapping[str, Any]) -> float:
        end = Mission.of_case(1).duration
        _, loop = next(loops_along(session, end, becoming(**values), {"at rest": 0.0}))
        return min_disk(loop) if spectral_radius(loop.closed()) < 1.0 else 0.0

    found = tune(
        simulator,
        duration,
        lambda run: relative_metrics(run_metrics(run)).mean(),
        RANGES,
        becoming=becoming,
        limits={"share": (lambda run: relative_metrics(run_metrics(run)), 1.0)},
        requirements={"disk": (lambda values: -disk(values), -MIN_DISK)},
        samples=[run_parameters(plant, seed) for seed in seeds],
        derivatives=False,
        iterations=trials,
        path=folder and folder / "tuning",
        workers=workers,
    )
    designs = {
        "initial": INITIAL,
        "shipped": values_of(MeanAxesDesign.shipped()),
        "tuned": values_of(design_of(found.values)),
    }
    compared = {}
    for name, values in designs.items():
        campaign = Campaign(
            section="Tuning",
            name=f"{name} design",
            loop=flight_simulator,
            rows=[becoming(**values) | run_parameters(plant, seed) for seed in others],
            labels=others,
            duration=duration,
        )
        runs = campaign.run(folder, executor="threads", workers=workers, progress=False)
        compared[name] = runs.assign_attrs(values | {"disk": disk(values)})
    return found, compared


def loop_fingerprints() -> list[float]:
    """Return the fingerprints of the simulated and of the linearized loop."""
    linearized = fingerprint(loop_session(backend="numpy"))
    return loop_fingerprint(flight_simulator, (("case", 1),)) + linearized


def relative_metrics(found: Mapping[str, float] | xr.Dataset) -> Vector:
    """Return each metric of one or several runs that has a goal, relative to it [-]."""
    return np.array([found[name] / goal for name, goal in GOALS.items()])


def design_of(values: Mapping[str, Any]) -> MeanAxesDesign:
    """Return the shipped design with other `values` of `RANGES`."""
    design = MeanAxesDesign.shipped()
    bandwidth, noise = design.bandwidth.copy(), design.acceleration_noise.copy()
    bandwidth[:2] = values["position_bandwidth"], values["attitude_bandwidth"]
    noise[:2] = 10.0 ** values["position_noise"], 10.0 ** values["attitude_noise"]
    return replace(design, bandwidth=bandwidth, acceleration_noise=noise)


def values_of(design: MeanAxesDesign) -> dict[str, float]:
    """Return the values of a `design` in the `RANGES`."""
    values = [*design.bandwidth[:2], *np.log10(design.acceleration_noise[:2])]
    return dict(zip(RANGES, map(float, values), strict=True))


def section(found: Tuned, compared: Designs, ledger: Ledger) -> str:
    """Return the section on the results of `tuned_designs`, whose numbers the ledger records."""
    designs, metrics, gains = {}, {}, {}
    objective = {
        name: relative_metrics(one).mean(axis=0) for name, one in compared.items()
    }
    for name, one in compared.items():
        run, values = f"tuning, {name}", one.attrs
        designs[run] = {
            "design": name,
            "bandwidth of position [rad/s]": values["position_bandwidth"],
            "bandwidth of attitude [rad/s]": values["attitude_bandwidth"],
            "acceleration noise of position [m/s²/√Hz]": 10.0
            ** values["position_noise"],
            "acceleration noise of attitude [rad/s²/√Hz]": 10.0
            ** values["attitude_noise"],
            "disk margin": values["disk"],
        }
        second = one["late force"].values > THRUST_STEP_TOLERANCE
        met = np.all([one[metric] <= goal for metric, goal in GOALS.items()], axis=0)
        metrics[run] = {
            "design": name,
            "objective": objective[name].mean(),
            **median_and_worst(one[list(COMPARED)]),
            "second step": int(second.sum()),
            "all goals met": int(met.sum()),
        }
        gain = objective[name] - objective["tuned"]
        if name != "tuned":
            note = ledger.of(run)
            half_width = 1.96 * gain.std(ddof=1) / np.sqrt(len(gain))
            gains[name] = (
                f"{note('gain', gain.mean())} ± {note('gain, ±', half_width, digits=2)}"
            )
    note, seeds = ledger.of("tuning"), compared["tuned"]["sample"].values
    return TEXT.format(
        **gains,
        before=note("before", found.before),
        cost=note("cost", found.cost),
        most=note("most", float(found.limits["share"].max())),
        runs=note("runs", found.runs),
        ended=f" ({found.message.rstrip('.').lower()})" if found.message else "",
        duration=LONG_DURATION,
        first=SEEDS[0],
        last=SEEDS[-1],
        count=len(seeds),
        begin=seeds[0],
        end=seeds[-1],
        goals=", ".join(GOALS),
        disk=MIN_DISK,
        late=LATE_WINDOW,
        designs=table(ledger, designs),
        metrics=table(ledger, metrics),
    )
