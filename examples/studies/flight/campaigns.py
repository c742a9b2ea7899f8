"""Simulations of the report: sweeps over parameters of one loop each, and their fingerprints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import cycle, product, repeat
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.evidence import fingerprint, projection

from flight.faults import FEASIBLE, fault_runs
from flight.loops import PAPER_LAWS, flight_hardware, flight_simulator, law_simulator
from flight.metrics import LATE_WINDOW, run_metrics, tracking
from flight.samples import NOMINAL_SEED, run_parameters
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.tunable_truss import TunableTruss
from trussflow.models.reporting.metrics import largest_norm, late_part
from trussflow.models.transport.mission import CASES

FIRST_SEED = 8000
"""First seed of the Monte Carlo samples; the design was tuned with smaller seeds."""

TRUSSES = (NOMINAL_SEED, FIRST_SEED, FIRST_SEED + 1)
"""Seeds of the trusses that the runs of one kind of condition have in turn."""

FAULT_TRUSSES = [TRUSSES[(i + i // 3) % 3] for i in range(9)]
"""Seeds of successive runs with faults: in nine runs of three times, each truss comes with each time."""

LOOPS: dict[str, dict[str, Any]] = {
    "Literal arm, Case 1": {"case": 1, "arm": "literal"},
    "Literal arm, Case 2": {"case": 2, "arm": "literal"},
    "Jaco arm, Case 1": {"case": 1, "arm": "jaco"},
    "Jaco arm, Case 2": {"case": 2, "arm": "jaco"},
}
"""Arguments of `flight_simulator` by name of the loop."""

MAX_JACO_SAMPLES, JACO_FAULT_STEP = 32, 2
"""Largest number of Monte Carlo samples with the second arm, which also has every second run with faults [-]."""

BLOCK_SIZE = 16
"""Largest number of Monte Carlo samples in one campaign [-]."""

SHARED_LOOPS = 8
"""Estimated number of campaigns with the same loop, whose code for several runs at once is compiled [-]."""

DURATION, LONG_DURATION = 62.0, 100.0
"""Simulated time: 60 s of motion, then 2 s or 40 s at rest [s]."""

LONG_SAMPLES = 4
"""Number of Monte Carlo samples that are also simulated for the long duration [-]."""


PROPELLANT = "Propellant and wheel management"
DAMPING = "Damping by thrusters or arms"
WORST_CASE = "Worst case"
EXACT = "Exact loops"
"""Titles of sections of the report."""

ARM_ERROR = 0.05
"""Relative excess of mass and length of the arms above those of the nominal dynamics [-]."""

HEALTHY = "healthy samples"
AT_REST = f"healthy samples, {LONG_DURATION:g} s"
OTHER_ARMS = f"arms {ARM_ERROR:.0%} heavier and longer"
"""Kinds of the runs without a fault."""

AVOIDED_WEIGHT = 30.0
"""Additional weight of actuators that the feedback avoids [-]."""

FEEDBACK_WEIGHTS = {
    "thrusters damp": (1.0, AVOIDED_WEIGHT, AVOIDED_WEIGHT),
    "arms damp": (AVOIDED_WEIGHT, AVOIDED_WEIGHT, 1.0),
}
"""Additional weights of thrusts, base torques and joint torques in the feedback [-]."""

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
    kinds : sequence of str
        Kind of the condition of each run.
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
    kinds: Sequence[str] = ()
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
        structural = not all("." in name for name in names)
        found = sweep(
            partial(self.loop, **self.options)
            if structural
            else prepared(self.loop, tuple(self.options.items())),
            self.duration,
            vary={names: [tuple(row.values()) for row in self.rows]},
            keep=self.keep,
            path=folder and folder / self.name.replace(" ", "-"),
            not_finite="ignore",
            repeats=SHARED_LOOPS,
            **options,
        )
        found = found.drop_vars(names, errors="ignore")
        coordinates: dict[str, Any] = {"sample": list(self.labels)}
        if self.kinds:
            coordinates["kind"] = "sample", list(self.kinds)
        return found.assign_coords(coordinates)

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
def prepared(
    loop: Callable[..., Simulator], arguments: tuple[tuple[str, Any], ...]
) -> Simulator:
    """Return the simulator of a loop with arguments, which several campaigns share."""
    return loop(**dict(arguments))


@cache
def loop_fingerprint(
    loop: Callable[..., Simulator], arguments: tuple[tuple[str, Any], ...]
) -> list[float]:
    """Return the fingerprint of a loop with arguments, evaluated without compilation."""
    return fingerprint(loop(**dict(arguments), backend="numpy"))


def all_campaigns(count: int) -> list[Campaign]:
    """Return all campaigns of the report, with `count` Monte Carlo samples of each case."""
    return [
        *(campaign for name in LOOPS for campaign in loop_campaigns(name, count)),
        *propellant_campaigns(),
        damping_campaign(),
        Campaign(
            section=EXACT,
            name="exact loops",
            loop=law_simulator,
            options={"of_paper": True},
            rows=[{"law": law} for law in PAPER_LAWS],
            labels=list(PAPER_LAWS),
            keep=exact_metrics,
            duration=LONG_DURATION,
        ),
    ]


def loop_campaigns(name: str, count: int) -> list[Campaign]:
    """Return the campaigns of one of the `LOOPS`, with at most `count` Monte Carlo samples."""
    options, fault_step = LOOPS[name], 1
    if options["arm"] == "jaco":
        count, fault_step = min(count, MAX_JACO_SAMPLES), JACO_FAULT_STEP
    plant = TunableTruss.accurate(arm=options["arm"])

    def campaign(
        part: str,
        runs: Iterable[tuple[str, str, dict[str, Any]]],
        seeds: Iterable[int],
        duration: float = DURATION,
        **deviation: float,
    ) -> Campaign:
        """Return the campaign of runs, each with the truss and the noise of a seed."""
        given = list(zip(runs, seeds, strict=False))
        return Campaign(
            section=name,
            name=f"{name}, {part}",
            options={**options, **deviation},
            rows=[changes | run_parameters(plant, k) for (_, _, changes), k in given],
            labels=[f"{label}, {truss_name(k)}" for (_, label, _), k in given],
            kinds=[kind for (kind, _, _), _ in given],
            duration=duration,
        )

    seeds = range(FIRST_SEED, FIRST_SEED + count)
    case = options["case"]
    feasible = FEASIBLE[options["arm"], case]
    faults = list(fault_runs(flight_hardware(case), plant, feasible))
    found = [
        *(
            campaign(f"seeds {block[0]} to {block[-1]}", same(HEALTHY), block)
            for i in range(0, count, BLOCK_SIZE)
            for block in [seeds[i : i + BLOCK_SIZE]]
        ),
        campaign("at rest", same(AT_REST), seeds[:LONG_SAMPLES], LONG_DURATION),
        campaign("faults", faults[::fault_step], cycle(FAULT_TRUSSES)),
    ]
    if name == next(iter(LOOPS)):
        nominal = 1.0 / (1.0 + ARM_ERROR)
        arms = campaign("arms", same(OTHER_ARMS), TRUSSES, nominal_arms=nominal)
        found.append(arms)
    return found


def same(kind: str) -> Iterable[tuple[str, str, dict[str, Any]]]:
    """Return any number of runs of one kind without further parameters."""
    return repeat((kind, kind, {}))


def truss_name(seed: int) -> str:
    """Return the name of the truss of a seed."""
    return "nominal truss" if seed == NOMINAL_SEED else f"seed {seed}"


def propellant_campaigns() -> list[Campaign]:
    """Return the runs with and without propellant and wheel management."""
    plant = TunableTruss.accurate()
    start = {
        f"actuators.wheels_{i + 1}.h": np.array(INITIAL_MOMENTUM)
        for i in range(plant.robots)
    }
    start["actuators.thrusters_1.tank.integral"] = np.array(INITIAL_PROPELLANT)
    limits = [
        f"controller.economy.{n}" for n in ("propellant_spread", "unloading_time")
    ]
    return [
        Campaign(
            section=PROPELLANT,
            name=f"case {case}, {word} management",
            options={"case": case, "arm": "literal"},
            rows=[run_parameters(plant, NOMINAL_SEED) | start | values],
            labels=[NOMINAL_SEED],
            keep=consumption,
            duration=LONG_DURATION,
        )
        for case, (word, values) in product(
            CASES,
            {"without": dict.fromkeys(limits, DISABLED_LIMIT), "with": {}}.items(),
        )
    ]


def damping_campaign() -> Campaign:
    """Return the runs in which the feedback uses all actuators, mainly thrusters, or mainly arms."""
    plant, name = TunableTruss.accurate(), "controller.allocation.reluctance"
    shipped = MeanAxesDesign.shipped()
    feedbacks = {
        "shipped": (shipped.thrust_reluctance, 1.0, shipped.joint_reluctance),
        **FEEDBACK_WEIGHTS,
    }
    rows, labels, kinds = [], [], []
    for (kind, (thrust, torque, joint)), seed in product(feedbacks.items(), TRUSSES):
        bases = np.tile(np.repeat([thrust, torque], 3), plant.robots)
        weights = np.append(bases, np.full(plant.joints, joint))
        rows.append({name: weights} | run_parameters(plant, seed))
        labels.append(f"{kind}, {truss_name(seed)}")
        kinds.append(kind)
    return Campaign(
        section=DAMPING,
        name="damping",
        options={"case": 1, "arm": "literal"},
        rows=rows,
        labels=labels,
        kinds=kinds,
        keep=damping_metrics,
        duration=LONG_DURATION,
    )


def damping_metrics(run: xr.Dataset) -> dict[str, float]:
    """Return the propellant, and the metrics of `exact_metrics`."""
    used = run["actuators.used.y"].values[-1]
    return {**exact_metrics(run), "propellant": float(used.sum())}


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
    late = grasp[late_part(run["time"].values, LATE_WINDOW)]
    return {
        **{
            name: error[name] for name in ("position", "late position", "late attitude")
        },
        "grasp 4": largest_norm(grasp),
        "late vibration of grasp 4": largest_norm(late - late.mean(axis=0)),
    }
