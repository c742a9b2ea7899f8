"""Sections of the report: tables of the results of the campaigns, in the texts of `flight.texts`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger, pretty

from flight.campaigns import (
    DURATION,
    FIRST_SEED,
    HEALTHY,
    INITIAL_MOMENTUM,
    INITIAL_PROPELLANT,
    LONG_DURATION,
    LONG_SAMPLES,
)
from flight.limits import IMPERFECTIONS
from flight.loops import LAWS, PAPER_LAWS, flight_hardware
from flight.margins import VARIATIONS
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
from flight.texts import DETAILS, LIMITS, LOOPS, MARGINS, MISSIONS, PROPELLANT, SAMPLES
from trussflow.models.feasibility import survey
from trussflow.models.feasibility.failures import single_failures
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.metrics import LATE_WINDOW
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.wiring import path_of

SUMMARY_METRICS = ("position", "attitude", "joints", "final position")

DETAIL_METRICS = (
    *SUMMARY_METRICS,
    "base torque",
    "joint torque",
    "false alarms",
    "isolated after",
)

SAMPLE_METRICS = [
    name
    for name in METRICS
    if name not in ("false alarms", "isolated after", "grasp 4")
    and not name.startswith(("propellant of", "final momentum", "late vibration"))
]

Results = Mapping[str, xr.Dataset]


def metrics_of(data: xr.Dataset) -> dict[str, Any]:
    """Return the variables of a dataset that are among the `METRICS`, in their order."""
    return {name: data[name] for name in METRICS if name in data}


def summary_tables(found: Results, ledger: Ledger) -> str:
    """Return the table of the kinds of condition of each loop, with the worst metrics of their runs."""
    tables = []
    for loop, runs in found.items():
        rows = {}
        for kind in dict.fromkeys(runs["kind"].values.tolist()):
            data = runs.isel(sample=runs["kind"].values == kind)
            after = data["isolated after"].values
            isolated = after[np.isfinite(after)]
            count = data.sizes["sample"]
            rows[f"{loop}, {kind}"] = {
                "condition": kind,
                "runs": count,
                "lost": count - int(successful(data).sum()),
                **{
                    name: float(data[name].fillna(np.inf).max())
                    for name in SUMMARY_METRICS
                },
                "false alarms": int(data["false alarms"].sum()),
                "isolated": "" if np.isnan(after).all() else isolated.size,
                "isolated after": float(isolated.max()) if isolated.size else "",
            }
        tables.append(f"### {loop[0].upper()}{loop[1:]}\n\n{table(ledger, rows)}")
    return "\n\n".join(tables)


def details_page(found: Results) -> str:
    """Return the page of the single runs, except those of healthy samples."""
    header = ["run", "lost", *map(heading, DETAIL_METRICS)]
    parts = [DETAILS]
    for loop, runs in found.items():
        data = runs.isel(sample=runs["kind"].values != HEALTHY)
        columns = [display_unit(name)[1] * data[name].values for name in DETAIL_METRICS]
        lost = np.where(successful(data).values, "", "yes")
        rows = []
        for k, label in enumerate(data["sample"].values):
            values = [float(column[k]) for column in columns]
            cells = ["" if np.isnan(value) else pretty(value) for value in values]
            rows.append([str(label), lost[k], *cells])
        table = markdown_table(header, rows)
        parts.append(f"## {loop[0].upper()}{loop[1:]}\n\n{table}\n")
    return "\n".join(parts)


def samples_section(found: Results, at_rest: Results, ledger: Ledger) -> str:
    """Return median and worst metrics of the healthy samples of each loop, late ones of the long runs."""
    header, rows = ["largest value of a run", "goal: below"], []
    for loop in found:
        header += [f"{loop}: median", "worst", "not below"]
    for name in SAMPLE_METRICS:
        goal, factor = GOALS.get(name), display_unit(name)[1]
        cells = [heading(name), f"{factor * goal:.3g}" if goal else ""]
        for loop, runs in (at_rest if name.startswith("late") else found).items():
            values = runs[name].values[runs["kind"].values == HEALTHY]
            note = ledger.of(f"{loop}, {HEALTHY}")
            cells += [
                displayed(note, f"{name}, median", np.nanmedian(values)),
                displayed(note, f"{name}, worst", np.nanmax(values)),
                note(f"{name}, not below", int(np.sum(~(values < goal))))
                if goal
                else "",
            ]
        rows.append(cells)
    return SAMPLES.format(
        deviation=MAX_DEVIATION,
        min_damping=MIN_DAMPING,
        max_damping=MAX_DAMPING,
        payload=MAX_PAYLOAD,
        first=FIRST_SEED,
        duration=DURATION,
        count=LONG_SAMPLES,
        late=LATE_WINDOW,
        long=LONG_DURATION,
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
    plant = flight_hardware(1).mounted(SpaceTruss.accurate())
    # Robots with braked joints have the same feasibility as their bases, which come first.
    failures = single_failures(plant.dynamics)[: 1 + plant.robots]
    rows, header = dict[str, list[str]](), ["failure"]
    for case in CASES:
        header += [
            f"Case {case}: margin [-]",
            "least duration [s]",
            "needed torque [N·m]",
        ]
        limits = flight_hardware(case).limits(plant)
        path = path_of(Mission.of_case(case), plant)
        for one in survey(plant.dynamics, path, limits, failures):
            note = partial(ledger.of(f"case {case}, {one.failure}"), show_unit=False)
            rows.setdefault(one.failure, [one.failure]).extend(
                [
                    note("margin", one.margin),
                    note("least duration", one.least_duration, "s"),
                    note("needed torque", one.needed_torque, "N*m"),
                ]
            )
    return MISSIONS.format(table=markdown_table(header, [*rows.values()]))


def margins_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the margins of the nominal loop and the worst of the samples, at each instant."""
    drawn = found["seed"].values != NOMINAL_SEED
    groups = {
        "nominal truss": found.isel(seed=~drawn),
        "worst sample": found.isel(seed=drawn),
    }
    rows = []
    for instant, (name, loops) in product(found["instant"].values, groups.items()):
        run, at = f"{instant}, {name}", loops.sel(instant=instant)
        note = partial(ledger.of(run), digits=2, show_unit=False)
        growth = at["growth"].max("seed")
        rows.append(
            [
                run,
                *(
                    note(f"growth, {v}", float(growth.sel(variation=v)), "1/s")
                    for v in VARIATIONS
                ),
                note("disk", float(at["disk"].min())),
                note("delay", 1e3 * float(at["delay"].min()), "ms"),
            ]
        )
    header = ["Case 1", *VARIATIONS, "disk", "delay [ms]"]
    return MARGINS.format(
        table=markdown_table(header, rows),
        count=ledger("margins: samples", int(drawn.sum())),
    )


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
        duration=LONG_DURATION,
    )


def loops_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the errors of the exact loops of each law."""
    rows = {
        f"exact, {key}": {"Case 1": law.label, **metrics_of(found.sel(sample=key))}
        for key, law in PAPER_LAWS.items()
    }
    return LOOPS.format(table=table(ledger, rows), duration=LONG_DURATION)
