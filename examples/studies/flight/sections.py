"""Sections of the report: tables of the results of the campaigns, in the texts of `flight.texts`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from flight import campaigns, worst_case
from flight.limits import IMPERFECTIONS
from flight.loops import LAWS, PAPER_LAWS, flight_hardware
from flight.margins import VARIATIONS
from flight.metrics import METRICS, lost, table
from flight.samples import NOMINAL_SEED
from flight.texts import (
    DAMPING,
    DETAILS,
    LIMITS,
    LOOPS,
    MARGINS,
    MISSIONS,
    PROPELLANT,
    WORST_CASE,
)
from flight.worst_case import Proof
from trussflow.models.feasibility import survey
from trussflow.models.feasibility.failures import single_failures
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import path_of

SUMMARY_METRICS = ("position", "attitude", "joints", "late position", "base torque")

DETAIL_METRICS = (*SUMMARY_METRICS, "joint torque", "false alarms", "isolated after")

WITNESS_QUANTITIES = {
    "position": ("mm", 1e3),
    "attitude": ("mrad", 1e3),
    "mass": ("%", 1.0),
    "frequency": ("%", 1.0),
    "damping": ("%", 1.0),
    "payload": ("kg", 1.0),
    "shapes": ("%", 1.0),
    "biases": ("mrad", 1e3),
}
"""Units of the quantities of a worst case in the table, and their factors."""

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
                "lost": int(lost(data).sum()),
                **{
                    name: float(data[name].fillna(np.inf).max())
                    for name in SUMMARY_METRICS
                },
                "false alarms": int(data["false alarms"].sum()),
                "isolated": "" if np.isnan(after).all() else isolated.size,
                "isolated after": float(isolated.max()) if isolated.size else "",
            }
        tables.append(f"### {loop}\n\n{table(ledger, rows)}")
    return "\n\n".join(tables)


def details_page(found: Results) -> str:
    """Return the page of the single runs, except those of healthy samples."""
    parts = [DETAILS.format(campaigns=campaigns)]
    for loop, runs in found.items():
        data = runs.isel(sample=runs["kind"].values != campaigns.HEALTHY)
        failed = np.where(lost(data).values, "yes", "")
        rows = {
            label: {
                "run": label,
                "lost": str(failed[k]),
                **{name: data[name].values[k] for name in DETAIL_METRICS},
            }
            for k, label in enumerate(data["sample"].values.tolist())
        }
        cells = table(Ledger(), rows).replace("not a number", "")
        parts.append(f"## {loop}\n\n{cells}\n")
    return "\n".join(parts)


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
    rows = []
    for name, options in campaigns.LOOPS.items():
        hardware = flight_hardware(options["case"])
        plant = hardware.mounted(SpaceTruss.accurate(arm=options["arm"]))
        path = path_of(Mission.of_case(options["case"]), plant)
        # Robots with braked joints have the same feasibility as their bases, which come first.
        failures = single_failures(plant.dynamics)[: 1 + plant.robots]
        for one in survey(plant.dynamics, path, hardware.limits(plant), failures):
            run = f"{name}, {one.failure}"
            note = partial(ledger.of(run), show_unit=False)
            rows.append(
                [
                    run,
                    note("margin", one.margin),
                    note("least duration", one.least_duration, "s"),
                    note("needed torque", one.needed_torque, "N*m"),
                ]
            )
    header = [
        "loop and failure",
        "margin [-]",
        "least duration [s]",
        "needed torque [N·m]",
    ]
    return MISSIONS.format(table=markdown_table(header, rows))


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
                note("disk", float(at["disk"].min(skipna=False))),
                note("delay", 1e3 * float(at["delay"].min(skipna=False)), "ms"),
            ]
        )
    header = ["Case 1", *VARIATIONS, "disk", "delay [ms]"]
    return MARGINS.format(
        table=markdown_table(header, rows),
        count=ledger("margins: samples", int(drawn.sum())),
    )


def worst_case_section(
    runs: xr.Dataset,
    worst: Mapping[str, Mapping[str, Any]],
    proof: Proof,
    ledger: Ledger,
) -> str:
    """Return the worst runs of the search with their trusses, and the proved growth rate.

    Parameters
    ----------
    runs : xarray.Dataset
        Runs of the loop, with healthy samples.
    worst : mapping
        Results of `worst_case.searched` by metric.
    proof : Proof
        Result of the linear analysis.
    ledger : Ledger
        Record of the numbers.
    """
    healthy = runs.isel(sample=runs["kind"].values == campaigns.HEALTHY)
    rows = []
    for name, (unit, factor) in WITNESS_QUANTITIES.items():
        cells = [f"{name} [{unit}]"]
        for metric, witness in worst.items():
            note = partial(ledger.of(f"worst {metric}"), show_unit=False)
            values = factor * np.atleast_1d(witness[name])[: worst_case.SHAPE_COUNT]
            cells.append(
                ", ".join(note(f"{name} {k}", v, unit) for k, v in enumerate(values, 1))
            )
        rows.append(cells)
    header = ["quantity", *(f"largest {metric} error" for metric in worst)]
    note = partial(ledger.of("worst case"), show_unit=False)
    return WORST_CASE.format(
        table=markdown_table(header, rows),
        position=ledger("worst sample", 1e3 * float(healthy["position"].max()), "mm"),
        attitude=ledger(
            "worst sample, attitude", 1e3 * float(healthy["attitude"].max()), "mrad"
        ),
        worst_case=worst_case,
        generations=len(worst_case.SPREADS),
        frequencies=len(worst_case.FREQUENCIES),
        growth=note("growth of corners", proof.growth, "1/s"),
        bound=note("bound", proof.bound, "1/s"),
        middle=note("growth in the middle", proof.middle, "1/s"),
        interpolated=note("interpolated growth", proof.interpolated, "1/s"),
    )


def propellant_section(found: Results, ledger: Ledger) -> str:
    """Return propellant and wheel momentum with and without their management."""
    rows = {
        name: {"nominal truss": name, **metrics_of(data.isel(sample=0))}
        for name, data in found.items()
    }
    return PROPELLANT.format(table=table(ledger, rows), campaigns=campaigns)


def damping_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the worst metrics of all trusses for each kind of damping."""
    kinds = found["kind"].values
    worst = {
        kind: found.isel(sample=kinds == kind).max("sample", skipna=False)
        for kind in dict.fromkeys(kinds.tolist())
    }
    rows = {
        f"damping, {kind}": {"feedback": kind, **metrics_of(data)}
        for kind, data in worst.items()
    }
    return DAMPING.format(
        table=table(ledger, rows), count=len(campaigns.TRUSSES), campaigns=campaigns
    )


def loops_section(found: xr.Dataset, ledger: Ledger) -> str:
    """Return the errors of the exact loops of each law."""
    rows = {
        f"exact, {key}": {"Case 1": law.label, **metrics_of(found.sel(sample=key))}
        for key, law in PAPER_LAWS.items()
    }
    return LOOPS.format(table=table(ledger, rows), campaigns=campaigns)
