"""Sections of the report: tables of the results of the campaigns, in the texts of `flight.texts`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import SupportsFloat

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger, Note

from flight.campaigns import (
    ARM_ERROR,
    FIRST_SEED,
    INITIAL_MOMENTUM,
    INITIAL_PROPELLANT,
    LONG_DURATION,
)
from flight.failures import FAILURE_METRICS
from flight.limits import IMPERFECTIONS
from flight.loops import LAWS, PAPER_LAWS, reference_hardware_of
from flight.margins import BUCKLING_RATE, VARIATIONS, max_gain_ratio
from flight.metrics import (
    DISPLAY_UNITS,
    GOALS,
    MAX_JOINTS,
    MAX_POSITION,
    METRICS,
    heading,
)
from flight.samples import (
    MAX_DAMPING,
    MAX_DEVIATION,
    MAX_PAYLOAD,
    MIN_DAMPING,
    NOMINAL_SEED,
)
from flight.texts import (
    FAILURES,
    LIMITS,
    LOOPS,
    MARGINS,
    MISSIONS,
    OFF_NOMINAL,
    PROPELLANT,
    SAMPLES,
)
from trussflow.models.feasibility import survey
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.wiring import path_of

OFF_NOMINAL_METRICS = (
    "position",
    "attitude",
    "joints",
    "late position",
    "torque",
    "alarms",
)
FIGURE_METRICS = ("position", "attitude", "late position", "late grasp 4")

Results = Mapping[str, xr.Dataset]


def displayed(note: Note, name: str, value: SupportsFloat, unit: str) -> str:
    """Record a value [`unit`], and return it in its displayed unit, without the unit."""
    display, factor = DISPLAY_UNITS[unit]
    return note(name, factor * float(value), display, show_unit=False)


def cumulative(label: str, values: np.ndarray) -> Curve:
    """Return the empirical distribution of values [any]."""
    return Curve(label, np.sort(values), np.arange(1, len(values) + 1) / len(values))


def samples_section(found: Results, ledger: Ledger, folder: Path) -> str:
    """Return the metrics of the Monte Carlo samples by case, and write their figure into the folder."""
    rows, panels, counts = [], [], []
    header = ["largest value of a run"]
    for case, data in found.items():
        complete = np.isfinite(data["position"].values)
        succeeded = ledger.count(f"{case}: complete", int(complete.sum()))
        counts.append(
            f"{succeeded} of {ledger.count(f'{case}: samples', complete.size)} in {case.title()}"
        )
        header += [f"{case.title()}: median", "worst", "goal: below", "missed by"]
    for name, (unit, _) in METRICS.items():
        display, factor = DISPLAY_UNITS[unit]
        cells, curves = [], []
        for case, data in found.items():
            values = data[name].values
            note = ledger.of(case)
            cells += [
                displayed(note, f"{name}, {word}", value, unit)
                for word, value in (
                    ("median", np.nanmedian(values)),
                    ("greatest", np.nanmax(values)),
                )
            ]
            goal = (
                torque_limit(int(case[-1]))
                if name.endswith("torque")
                else GOALS.get(name)
            )
            missed = 0 if goal is None else int(np.sum(~(values < goal * (1.0 - 1e-9))))
            cells += [
                "" if goal is None else f"{factor * goal:.3g}",
                ""
                if goal is None
                else ledger.count(f"{case}: {name}, not below", missed, [case]),
            ]
            curves.append(cumulative(case.title(), factor * values))
        rows.append((heading(name), *cells))
        if name in FIGURE_METRICS:
            panels.append(
                Panel(
                    curves=curves,
                    x=f"{name} [{display}]",
                    y="share of samples [-]",
                    marks=[factor * GOALS[name]],
                    legend_inside=True,
                )
            )
    save(drawing(panels), folder / "samples.png", small=True)
    return SAMPLES.format(
        counts=", ".join(counts),
        deviation=MAX_DEVIATION,
        min_damping=MIN_DAMPING,
        max_damping=MAX_DAMPING,
        payload=MAX_PAYLOAD,
        first=FIRST_SEED,
        duration=LONG_DURATION,
        table=markdown_table(header, rows),
    )


def limits_section(
    bounds: Mapping[tuple[str, str], tuple[float, float]], ledger: Ledger
) -> str:
    """Return the robustness limits of each law."""
    rows = []
    for name, what in IMPERFECTIONS.items():
        factor, unit = {"s": (1e3, "ms"), "%": (0.01, "%")}.get(
            what.unit, (1.0, what.unit)
        )
        cells = []
        for law in LAWS:
            best, worst = (
                ledger.of(f"{name}, {law}")(
                    word, factor * value, unit, digits=2, show_unit=False
                )
                for word, value in zip(
                    ("succeeds", "fails"), bounds[name, law], strict=True
                )
            )
            parts = np.isfinite(bounds[name, law])
            cells.append(
                ", ".join(
                    np.array(
                        [f"**{best}**" if parts[1] else best, f"fails at {worst}"]
                    )[parts]
                )
            )
        rows.append((f"{what.label} [{unit.replace('*', '·')}]", *cells))
    header = ("imperfection, all else exact", *(law.label for law in LAWS.values()))
    return LIMITS.format(table=markdown_table(header, rows))


def missions_section(ledger: Ledger) -> str:
    """Return the feasibility of the missions with each single failure."""
    plant, found = SpaceTruss.accurate(), {}
    for case in CASES:
        limits = reference_hardware_of(case).limits(plant)
        found[case] = survey(
            plant.dynamics, path_of(Mission.of_case(case), plant), limits
        )
    rows = []
    for each in zip(*found.values(), strict=True):
        cells = [each[0].failure]
        for case, one in zip(found, each, strict=True):
            note = ledger.of(f"case {case}, {one.failure}")
            cells += [
                note("margin", one.margin),
                note("least duration", one.least_duration, "s", show_unit=False),
                note("needed torque", one.needed_torque, "N*m", show_unit=False),
            ]
        rows.append(cells)
    header = ["failure"]
    for case in found:
        header += [
            f"Case {case}: margin [-]",
            "least duration [s]",
            "needed torque [N·m]",
        ]
    return MISSIONS.format(table=markdown_table(header, rows))


def torque_limit(case: int) -> float:
    """Return the torque limit of bases and joints in a case [N·m]."""
    return float(reference_hardware_of(case).drives(1).maximum[0])


def failures_section(found: Results, ledger: Ledger) -> str:
    """Return the metrics of the runs with a failure."""
    rows = []
    for data in found.values():
        for label in data["sample"].values:
            one, note = data.sel(sample=label), ledger.of(str(label))
            if np.isnan(one["position"]):
                rows.append((label, "diverged", *[""] * (len(FAILURE_METRICS) + 1)))
                continue
            delay = note("found_after", float(one["found_after"]), "s", show_unit=False)
            cells = [
                displayed(note, name, one[name], unit)
                for name, unit in FAILURE_METRICS.items()
            ]
            rows.append((label, delay, *cells, str(int(one["false_alarms"]) or "")))
    heads = [
        f"{name.replace('_', ' ')} (component) [{DISPLAY_UNITS[unit][0]}]"
        for name, unit in FAILURE_METRICS.items()
    ]
    return FAILURES.format(
        table=markdown_table(
            ("failure", "isolated after [s]", *heads, "false alarms"), rows
        )
    )


def margins_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the margins of the nominal loop and the worst of the samples, at each instant."""
    drawn = found.where(found["seed"] != NOMINAL_SEED, drop=True)
    rows = []
    for instant in found["instant"].values:
        cells = [str(instant)]
        for name, loops, shown in (
            ("nominal", found.sel(seed=[NOMINAL_SEED]), list(VARIATIONS)),
            ("worst sample", drawn, ["nominal"]),
        ):
            at, note = loops.sel(instant=instant), ledger.of(f"{instant}, {name}")
            growth = at["growth"].max("seed")
            cells += [
                note(
                    f"growth, {v}",
                    float(growth.sel(variation=v)),
                    "1/s",
                    digits=2,
                    show_unit=False,
                )
                for v in shown
            ]
            cells.append(note("disk", float(at["disk"].min()), digits=2))
            cells.append(
                note(
                    "delay",
                    1e3 * float(at["delay"].min()),
                    "ms",
                    digits=2,
                    show_unit=False,
                )
            )
        rows.append(cells)
    header = [
        "Case 1",
        *VARIATIONS,
        "disk",
        "delay [ms]",
        "worst sample: nominal",
        "disk",
        "delay [ms]",
    ]
    ratio = max_gain_ratio(BUCKLING_RATE, 2 * MeanAxesDesign.shipped().sample_time)
    return MARGINS.format(
        table=markdown_table(header, rows),
        count=ledger.count("margins: samples", drawn.sizes["seed"]),
        ratio=ledger("margins: largest ratio of gains", ratio, digits=2),
    )


def off_nominal_section(found: Results, ledger: Ledger) -> str:
    """Return the worst metrics of each off-nominal case."""
    rows = []
    for name, data in found.items():
        succeeded = (data["position"].values < MAX_POSITION) & (
            data["joints"].values < MAX_JOINTS
        )
        count = ledger.count(f"{name}: successful", int(succeeded.sum()), [name])
        cells = [
            displayed(ledger.of(name), metric, data[metric].max(), METRICS[metric][0])
            for metric in OFF_NOMINAL_METRICS
        ]
        rows.append((name, f"{count} of {len(succeeded)}", *cells))
    header = ["case", "successful", *map(heading, OFF_NOMINAL_METRICS)]
    return OFF_NOMINAL.format(table=markdown_table(header, rows), error=ARM_ERROR)


def propellant_section(found: Results, ledger: Ledger) -> str:
    """Return propellant and wheel momentum with and without their management."""
    rows = []
    for name, data in found.items():
        one, note = data.isel(sample=0), ledger.of(name)
        used = one["used"].values
        cells = [
            displayed(note, f"base {i + 1} used", each, "kg")
            for i, each in enumerate(used)
        ]
        cells.append(displayed(note, "used", used.sum(), "kg"))
        cells += [
            note(f"held, {axis}", held, "N*m*s", show_unit=False)
            for axis, held in zip("xyz", one["momentum"].values, strict=True)
        ]
        rows.append((name, *cells, displayed(note, "position", one["position"], "m")))
    bases = [f"base {i + 1} [g]" for i in range(len(used))]
    momenta = [f"final momentum, {axis} [N·m·s]" for axis in "xyz"]
    return PROPELLANT.format(
        table=markdown_table(
            ("nominal truss", *bases, "all [g]", *momenta, heading("position")), rows
        ),
        momentum=", ".join(f"{each:g}" for each in INITIAL_MOMENTUM),
        propellant=INITIAL_PROPELLANT,
    )


def loops_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the errors of the exact loops of each law."""
    units = {
        "position": "m",
        "late position": "m",
        "late attitude": "rad",
        "grasp 4": "m",
        "late grasp 4": "m",
    }
    rows = [
        (
            law.label,
            *(
                ledger.of(f"exact, {key}")(
                    name, float(found[name].sel(sample=key)), unit
                )
                for name, unit in units.items()
            ),
        )
        for key, law in PAPER_LAWS.items()
    ]
    header = (
        "Case 1",
        "position (norm)",
        "late position (norm)",
        "late attitude (component)",
        "grasp 4 (norm)",
        "late grasp 4, about its mean (norm)",
    )
    return LOOPS.format(table=markdown_table(header, rows))
