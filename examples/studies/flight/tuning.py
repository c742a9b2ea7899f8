"""Tuning of the mean-axes design on some samples, and its comparison on others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.evidence import fingerprint
from study_tools.ledger import Ledger

from flight.campaigns import LONG_DURATION, loop_fingerprint
from flight.loops import flight_simulator
from flight.margins import loop_session, loops_along, min_disk
from flight.metrics import GOALS, run_metrics, table
from flight.sampled_loop import spectral_radius
from flight.samples import noise_parameters, sample_parameters
from trussflow.blocks.support.types import Vector
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.blocks.sweeps.tuning import tune
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting.metrics import LATE_WINDOW
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

COLUMNS = {
    "bandwidth of position [rad/s]": lambda one: one["position_bandwidth"],
    "bandwidth of attitude [rad/s]": lambda one: one["attitude_bandwidth"],
    "acceleration noise of position [m/s²/√Hz]": lambda one: (
        10.0 ** one["position_noise"]
    ),
    "acceleration noise of attitude [rad/s²/√Hz]": lambda one: (
        10.0 ** one["attitude_noise"]
    ),
    "disk margin": lambda one: one["disk"],
}
COMPARED = "position", "attitude", "late position"
STATISTICS: dict[str, Callable[..., Any]] = {"median": np.median, "worst": np.max}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuning:
    """Search on some samples of Case 1, from the design chosen by hand, and comparison on others.

    Attributes
    ----------
    seeds, others : range
        Seeds of the tuning and of the comparison.
    trials : int
        Maximum number of designs [-].
    duration : float
        Simulated time [s].
    """

    seeds: range = range(16)
    others: range = range(1000, 1064)
    trials: int = 25
    duration: float = LONG_DURATION

    def run(
        self, folder: Path | None = None, *, workers: int | None = None
    ) -> xr.Dataset:
        """Return the metrics of the initial, shipped and tuned design along ``design`` and ``seed``.

        Parameters
        ----------
        folder : pathlib.Path, optional
            Folder for finished runs; the same call resumes.
        workers : int, optional
            Number of parallel runs, as for `sweep` [-].
        """
        simulator, session, plant = (
            flight_simulator(),
            loop_session(),
            TunableTruss.accurate(),
        )
        free = FreeModes.of(plant.dynamics, MeanAxesDesign.shipped().estimated_modes)

        def parameters(seed: int) -> dict[str, Any]:
            return sample_parameters(plant, seed) | noise_parameters(seed)

        def becoming(**values: Any) -> dict[str, Vector]:
            design = design_of(values)
            return {
                "controller.law.bandwidth": design.of_groups(
                    design.bandwidth, plant.dynamics.rigid_freedoms
                ),
                "controller.estimator.gain": design.estimator_gain(free),
            }

        def disk(values: Mapping[str, Any]) -> float:
            duration = Mission.of_case(1).duration
            _, loop = next(
                loops_along(session, duration, becoming(**values), {"at rest": 0.0})
            )
            return min_disk(loop) if spectral_radius(loop.closed()) < 1.0 else 0.0

        found = tune(
            simulator,
            self.duration,
            lambda run: relative_metrics(run).mean(),
            RANGES,
            becoming=becoming,
            limits={"share": (relative_metrics, 1.0)},
            requirements={"disk": (lambda values: -disk(values), -MIN_DISK)},
            samples=[parameters(seed) for seed in self.seeds],
            derivatives=False,
            iterations=self.trials,
            path=folder and folder / "tuning",
            workers=workers,
        )
        designs = {
            "initial": INITIAL,
            "shipped": values_of(MeanAxesDesign.shipped()),
            "tuned": values_of(design_of(found.values)),
        }
        rows = [
            becoming(**values) | parameters(seed)
            for values in designs.values()
            for seed in self.others
        ]
        swept = sweep(
            simulator,
            self.duration,
            vary={tuple(rows[0]): [tuple(row.values()) for row in rows]},
            keep=lambda run: run_metrics(run) | {"share": relative_metrics(run).mean()},
            path=folder and folder / "comparison",
            executor="threads",
            workers=workers,
            repeats=self.trials,
            not_finite="ignore",
            progress=False,
        )
        shape = len(designs), len(self.others)
        columns: dict[str, Any] = {
            name: (("design", "seed"), swept[name].values.reshape(shape))
            for name in (*GOALS, "share")
        }
        columns |= {
            name: ("design", [values[name] for values in designs.values()])
            for name in RANGES
        }
        columns["disk"] = "design", [disk(values) for values in designs.values()]
        facts = {
            "before": found.before,
            "cost": found.cost,
            "most": float(found.limits["share"].max()),
            "runs": found.runs,
            "message": found.message,
            "duration": self.duration,
            "first": self.seeds[0],
            "last": self.seeds[-1],
        }
        return xr.Dataset(
            columns, {"design": [*designs], "seed": [*self.others]}, facts
        )


def loop_fingerprints() -> list[float]:
    """Return the fingerprints of the simulated and of the linearized loop."""
    linearized = fingerprint(loop_session("numpy"))
    return loop_fingerprint(flight_simulator, (("case", 1),)) + linearized


def relative_metrics(run: xr.Dataset) -> Vector:
    """Return each metric of a run that has a goal, relative to it [-]."""
    found = run_metrics(run)
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


def section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the section on the result of `Tuning.run`, whose numbers the ledger records."""
    facts, count = found.attrs, found.sizes["seed"]
    designs, metrics, gains = {}, {}, {}
    for name in found["design"].values.tolist():
        one, run = found.sel(design=name), f"tuning, {name}"
        designs[run] = {"design": name}
        designs[run] |= {title: of(one) for title, of in COLUMNS.items()}
        met = np.all([one[metric] <= goal for metric, goal in GOALS.items()], axis=0)
        second = one["late force"].values > THRUST_STEP_TOLERANCE
        metrics[run] = {
            "design": name,
            "objective": one["share"].values.mean(),
            **{
                f"{metric}, {word}": statistic(one[metric].values)
                for metric in COMPARED
                for word, statistic in STATISTICS.items()
            },
            "second step": int(second.sum()),
            "all goals met": int(met.sum()),
        }
        gain = one["share"].values - found["share"].sel(design="tuned").values
        if name != "tuned":
            note, half_width = ledger.of(run), 1.96 * gain.std(ddof=1) / np.sqrt(count)
            gains[name] = (
                f"{note('gain', gain.mean())} ± {note('gain, ±', half_width, digits=2)}"
            )
    note, seeds = ledger.of("tuning"), found["seed"].values
    return TEXT.format(
        **{name: facts[name] for name in ("first", "last", "duration")},
        **{
            name: note(name, facts[name]) for name in ("before", "cost", "most", "runs")
        },
        **gains,
        begin=seeds[0],
        end=seeds[-1],
        goals=", ".join(GOALS),
        disk=MIN_DISK,
        ended=f" ({facts['message'].rstrip('.').lower()})" if facts["message"] else "",
        late=LATE_WINDOW,
        designs=table(ledger, designs),
        count=count,
        metrics=table(ledger, metrics),
    )
