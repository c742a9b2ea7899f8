"""Simulations of the report: sweeps over parameters of one loop each, and their fingerprints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.evidence import fingerprint, projection

from flight.failures import failure_metrics, failure_parameters
from flight.loops import PAPER_LAWS, flight_simulator, law_simulator
from flight.metrics import run_metrics, tracking
from flight.samples import NOMINAL_SEED, run_parameters
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting.metrics import largest_norm, late_part
from trussflow.models.transport.mission import CASES

FIRST_SEED = 100
"""First seed of the Monte Carlo samples; the design was tuned with smaller seeds."""

NOMINAL_AND_SAMPLES = (NOMINAL_SEED, *range(FIRST_SEED, FIRST_SEED + 3))
"""Seeds of each off-nominal case."""

DURATION, LONG_DURATION = 80.0, 100.0
"""Simulated time: 60 s of motion, then 20 s or 40 s at rest [s]."""

FAILURE_TIMES = (10.0, 30.0, 50.0)  # s

SAMPLES, FAILURES, OFF_NOMINAL = "Monte Carlo samples", "Failures", "Off-nominal cases"
PROPELLANT, EXACT = "Propellant and wheel management", "Exact loops"
"""Titles of the sections of the report."""

FAILING: tuple[tuple[str, str, int, dict[str, Any]], ...] = (
    ("base", "", 3, {}),
    ("robot", ", with brakes", 3, {"brakes": True}),
    ("robot", "", 3, {}),
    ("base", ", turned", 4, {"turned": True}),
    ("base", ", Case 2", 2, {"case": 2}),
)
"""Failing part, remark, number of robots that may fail, and options of the loop."""

GAINS = (0.5, 0.7, 1.4, 2.0)
"""Actuator gains of the off-nominal cases, actual by commanded [-]."""

ARM_ERROR = 0.05
"""Relative error of the arms in the nominal dynamics [-]."""

INITIAL_MOMENTUM = (3.0, 2.0, 1.0)
"""Initial momentum of the wheels of each base, by axis [N·m·s]."""

INITIAL_PROPELLANT = 0.3
"""Propellant that base 1 has used before, the other bases none [kg]."""

DISABLED_LIMIT = 1e9
"""Propellant difference [kg] and unloading time [s] that switch off the propellant management."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """Sweep over parameters and initial states of a loop.

    Attributes
    ----------
    section : str
        Title of the section of the report.
    name : str
        Unique name in the report.
    loop : callable
        Function of the options, the arguments in the rows, and the backend that returns the simulator.
    options : mapping
        Arguments of `loop` in all runs.
    rows : sequence of mapping
        Arguments, parameters and initial states of each run, as for `sweep`.
    labels : sequence
        Name of each run.
    keep : callable
        Function of the result of a run that returns the kept values by name.
    duration : float
        Simulated time [s].
    """

    section: str
    name: str
    loop: Callable[..., Simulator] = flight_simulator
    options: Mapping[str, Any] = field(default_factory=dict)
    rows: Sequence[Mapping[str, Any]]
    labels: Sequence[Any]
    keep: Callable[[xr.Dataset], Mapping[str, Any]] = run_metrics
    duration: float = DURATION

    def run(self, folder: Path | None = None, **options: Any) -> xr.Dataset:
        """Return the kept values of all runs along ``sample``, NaN for runs that diverged.

        Parameters
        ----------
        folder : pathlib.Path, optional
            Folder for finished runs of all campaigns; the same call resumes.
        **options
            Further arguments of `sweep`.
        """
        names = tuple(self.rows[0])
        found = sweep(
            partial(self.loop, **self.options),
            self.duration,
            vary={names: [tuple(row.values()) for row in self.rows]},
            keep=self.keep,
            path=folder and folder / self.name.replace(" ", "-"),
            not_finite="ignore",
            **options,
        )
        return found.drop_vars(names, errors="ignore").assign_coords(
            sample=list(self.labels)
        )

    def fingerprint(self) -> list[float]:
        """Return the numbers that identify loops, duration, parameters and initial states."""
        found, values = dict[tuple[Any, ...], list[float]](), [self.duration]
        for row in self.rows:
            arguments = {name: value for name, value in row.items() if "." not in name}
            key = tuple({**self.options, **arguments}.items())
            found[key] = loop_fingerprint(self.loop, key)
            values += [value for name, value in row.items() if "." in name]
        return [number for each in found.values() for number in each] + [
            projection(values)
        ]


@cache
def loop_fingerprint(
    loop: Callable[..., Simulator], arguments: tuple[tuple[str, Any], ...]
) -> list[float]:
    """Return the fingerprint of a loop with arguments, evaluated without compilation."""
    return fingerprint(loop(**dict(arguments), backend="numpy"))


def all_campaigns(count: int) -> list[Campaign]:
    """Return all campaigns of the report, with `count` Monte Carlo samples of each case."""
    plant = TunableTruss.accurate()
    robots, joints = plant.robots, plant.joints
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    samples = [run_parameters(plant, seed) for seed in seeds]
    found = [
        Campaign(
            section=SAMPLES,
            name=f"case {case}",
            options={"case": case},
            rows=samples,
            labels=seeds,
            duration=LONG_DURATION,
        )
        for case in CASES
    ]
    for part, remark, failing, options in FAILING:
        failures = list(product([part], range(1, failing + 1), FAILURE_TIMES))
        found.append(
            Campaign(
                section=FAILURES,
                name=f"{part} fails{remark}",
                options={"brakes": False, **options},
                rows=[
                    failure_parameters(plant.dynamics, *failure) for failure in failures
                ],
                labels=[
                    f"{part} {robot} fails at {time:g} s{remark}"
                    for _, robot, time in failures
                ],
                keep=failure_metrics,
            )
        )
    more, less = 1.0 / (1.0 + ARM_ERROR), 1.0 / (1.0 - ARM_ERROR)
    cases: dict[str, tuple[float, dict[str, Any]]] = {
        **{f"actuator gain {gain:g}": (gain, {}) for gain in GAINS},
        f"arms {ARM_ERROR:.0%} heavier than nominal": (1.0, {"mass": more}),
        f"arms {ARM_ERROR:.0%} lighter than nominal": (1.0, {"mass": less}),
        f"arms {ARM_ERROR:.0%} longer than nominal": (1.0, {"length": more}),
        f"arms {ARM_ERROR:.0%} shorter than nominal": (1.0, {"length": less}),
    }
    for name, (gain, arms) in cases.items():
        health = {
            "failure.bases": np.full(robots, gain),
            "failure.drives": np.full(joints, gain),
        }
        found.append(
            Campaign(
                section=OFF_NOMINAL,
                name=name,
                options={"brakes": False, **arms},
                rows=[
                    health | run_parameters(plant, seed) for seed in NOMINAL_AND_SAMPLES
                ],
                labels=NOMINAL_AND_SAMPLES,
            )
        )
    start = {
        f"actuators.wheels_{i + 1}.h": np.array(INITIAL_MOMENTUM) for i in range(robots)
    }
    start["actuators.thrusters_1.tank.integral"] = np.array(INITIAL_PROPELLANT)
    disabled = {
        f"controller.economy.{name}": DISABLED_LIMIT
        for name in ("propellant_spread", "unloading_time")
    }
    for case, (word, values) in product(
        CASES, {"without": disabled, "with": {}}.items()
    ):
        found.append(
            Campaign(
                section=PROPELLANT,
                name=f"case {case}, {word} management",
                options={"case": case},
                rows=[run_parameters(plant, NOMINAL_SEED) | start | values],
                labels=[NOMINAL_SEED],
                keep=consumption,
                duration=LONG_DURATION,
            )
        )
    paper = Campaign(
        section=EXACT,
        name="exact loops",
        loop=law_simulator,
        options={"of_paper": True},
        rows=[{"law": law} for law in PAPER_LAWS],
        labels=list(PAPER_LAWS),
        keep=exact_metrics,
    )
    return [*found, paper]


def consumption(run: xr.Dataset) -> dict[str, float]:
    """Return propellant and final wheel momentum by axis, of any base, and the position error."""
    used = run["actuators.used.y"].values[-1].copy()
    used[0] -= INITIAL_PROPELLANT
    momentum = abs(run["actuators.stored.y"].values[-1]).reshape(-1, 3).max(axis=0)
    return {
        **{f"propellant of base {i}": each for i, each in enumerate(used, 1)},
        "propellant": used.sum(),
        **{
            f"final momentum {axis}": each
            for axis, each in zip("xyz", momentum, strict=True)
        },
        "position": tracking(run)["position"],
    }


def exact_metrics(run: xr.Dataset) -> dict[str, float]:
    """Return tracking errors, displacement of grasp 4, and its late deviation from the mean."""
    error, grasp = tracking(run), run["truss.grasp_displacement"].values[:, 3]
    late = grasp[late_part(run["time"].values)]
    return {
        **{
            name: error[name] for name in ("position", "late position", "late attitude")
        },
        "grasp 4": largest_norm(grasp),
        "late vibration of grasp 4": largest_norm(late - late.mean(axis=0)),
    }
