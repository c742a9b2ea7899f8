"""Sections of the report: tables of the results of the campaigns, in the texts of `flight.texts`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from flight.campaigns import (
    ARM_ERROR,
    FIRST_SEED,
    INITIAL_MOMENTUM,
    INITIAL_PROPELLANT,
    LONG_DURATION,
)
from flight.limits import IMPERFECTIONS
from flight.loops import LAWS, PAPER_LAWS, reference_hardware_of
from flight.margins import BUCKLING_RATE, VARIATIONS, max_gain_ratio
from flight.metrics import (
    GOALS,
    METRICS,
    display_unit,
    displayed,
    heading,
    successful,
    table,
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
    "base torque",
    "alarms",
)
FIGURE_METRICS = ("position", "attitude", "late position", "late grasp 4")

Results = Mapping[str, xr.Dataset]


def cumulative(label: str, values: np.ndarray) -> Curve:
    """Return the empirical distribution of values [any]."""
    return Curve(label, np.sort(values), np.arange(1, len(values) + 1) / len(values))


def metrics_of(data: xr.Dataset) -> dict[str, Any]:
    """Return the variables of a dataset that are among the `METRICS`, in their order."""
    return {name: data[name] for name in METRICS if name in data}


def samples_section(found: Results, ledger: Ledger, folder: Path) -> str:
    """Return the metrics of the Monte Carlo samples by case, and write their figure into the folder."""
    rows, panels, counts = [], [], []
    header = ["largest value of a run"]
    for case, data in found.items():
        complete = np.isfinite(data["position"].values)
        note = ledger.of(case)
        succeeded = note("complete", int(complete.sum()))
        counts.append(
            f"{succeeded} of {note('samples', complete.size)} in {case.title()}"
        )
        header += [f"{case.title()}: median", "worst", "goal: below", "missed by"]
    for name in metrics_of(data):
        display, factor = display_unit(name)
        cells, curves = [heading(name)], []
        for case, data in found.items():
            values, note = data[name].values, ledger.of(case)
            cells += [
                displayed(note, f"{name}, median", np.nanmedian(values)),
                displayed(note, f"{name}, greatest", np.nanmax(values)),
            ]
            goal = GOALS.get(name)
            if name.endswith("torque"):
                goal = torque_limit(int(case[-1]))
            if goal is None:
                cells += ["", ""]
            else:
                missed = int(np.sum(~(values < goal * (1.0 - 1e-9))))
                cells += [f"{factor * goal:.3g}", note(f"{name}, not below", missed)]
            curves.append(cumulative(case.title(), factor * values))
        rows.append(cells)
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
        cells = [f"{what.label} [{unit.replace('*', '·')}]"]
        for law in LAWS:
            note = partial(ledger.of(f"{name}, {law}"), digits=2, show_unit=False)
            best, worst = bounds[name, law]
            parts = []
            if np.isfinite(best):
                text = note("succeeds", factor * best, unit)
                parts.append(f"**{text}**" if np.isfinite(worst) else text)
            if np.isfinite(worst):
                parts.append(f"fails at {note('fails', factor * worst, unit)}")
            cells.append(", ".join(parts))
        rows.append(cells)
    header = ("imperfection, all else exact", *(law.label for law in LAWS.values()))
    return LIMITS.format(table=markdown_table(header, rows))


def missions_section(ledger: Ledger) -> str:
    """Return the feasibility of the missions with each single failure."""
    plant, rows, header = SpaceTruss.accurate(), dict[str, list[str]](), ["failure"]
    for case in CASES:
        header += [
            f"Case {case}: margin [-]",
            "least duration [s]",
            "needed torque [N·m]",
        ]
        limits = reference_hardware_of(case).limits(plant)
        for one in survey(
            plant.dynamics, path_of(Mission.of_case(case), plant), limits
        ):
            note = partial(ledger.of(f"case {case}, {one.failure}"), show_unit=False)
            rows.setdefault(one.failure, [one.failure]).extend(
                [
                    note("margin", one.margin),
                    note("least duration", one.least_duration, "s"),
                    note("needed torque", one.needed_torque, "N*m"),
                ]
            )
    return MISSIONS.format(table=markdown_table(header, [*rows.values()]))


def torque_limit(case: int) -> float:
    """Return the torque limit of bases and joints in a case [N·m]."""
    joints = SpaceTruss.consistent().dynamics.joint_data
    return float(reference_hardware_of(case).drives(joints).maximum[0])


def failures_section(found: Results, ledger: Ledger) -> str:
    """Return the metrics of the runs with a failure."""
    rows = {
        str(label): {"failure": str(label), **metrics_of(data.sel(sample=label))}
        for data in found.values()
        for label in data["sample"].values
    }
    return FAILURES.format(table=table(ledger, rows))


def margins_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the margins of the nominal loop and the worst of the samples, at each instant."""
    drawn = found.where(found["seed"] != NOMINAL_SEED, drop=True)
    groups = (
        ("nominal", found.sel(seed=[NOMINAL_SEED]), [*VARIATIONS]),
        ("worst sample", drawn, ["nominal"]),
    )
    rows = []
    for instant in found["instant"].values:
        cells = [str(instant)]
        for name, loops, shown in groups:
            at, note = loops.sel(instant=instant), ledger.of(f"{instant}, {name}")
            note = partial(note, digits=2, show_unit=False)
            growth = at["growth"].max("seed")
            cells += [
                *(
                    note(f"growth, {v}", float(growth.sel(variation=v)), "1/s")
                    for v in shown
                ),
                note("disk", float(at["disk"].min())),
                note("delay", 1e3 * float(at["delay"].min()), "ms"),
            ]
        rows.append(cells)
    last = ["disk", "delay [ms]"]
    header = ["Case 1", *VARIATIONS, *last, "worst sample: nominal", *last]
    ratio = max_gain_ratio(BUCKLING_RATE, 2 * MeanAxesDesign.shipped().sample_time)
    return MARGINS.format(
        table=markdown_table(header, rows),
        count=ledger("margins: samples", drawn.sizes["seed"]),
        ratio=ledger("margins: largest ratio of gains", ratio, digits=2),
    )


def off_nominal_section(found: Results, ledger: Ledger) -> str:
    """Return the worst metrics of each off-nominal case."""
    rows = {}
    for name, data in found.items():
        succeeded = successful(data).values
        count = ledger.of(name)("successful", int(succeeded.sum()))
        rows[name] = {
            "case": name,
            "successful": f"{count} of {len(succeeded)}",
            **{metric: data[metric].max() for metric in OFF_NOMINAL_METRICS},
        }
    return OFF_NOMINAL.format(table=table(ledger, rows), error=ARM_ERROR)


def propellant_section(found: Results, ledger: Ledger) -> str:
    """Return propellant and wheel momentum with and without their management."""
    rows = {
        name: {"nominal truss": name, **metrics_of(data.isel(sample=0))}
        for name, data in found.items()
    }
    return PROPELLANT.format(
        table=table(ledger, rows),
        momentum=", ".join(f"{each:g}" for each in INITIAL_MOMENTUM),
        propellant=INITIAL_PROPELLANT,
    )


def loops_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the errors of the exact loops of each law."""
    rows = {
        f"exact, {key}": {"Case 1": law.label, **metrics_of(found.sel(sample=key))}
        for key, law in PAPER_LAWS.items()
    }
    return LOOPS.format(table=table(ledger, rows))
