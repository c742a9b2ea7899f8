"""The sections of the report on flying: tables of what the jobs found, and what is said of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from flight.campaign import TUNED
from flight.draws import HEAVIEST_DAMPING, HEAVIEST_PAYLOAD, LIGHTEST_DAMPING, NOMINAL, UNCERTAIN
from flight.edges import PART
from flight.emergencies import MEASURES
from flight.flights import DURATION, flown_hardware
from flight.ladder import IMPERFECTIONS, JOINTS, LATE, LAWS, POSITION, Rung
from flight.margins import BUCKLING, VARIATIONS, greatest_gain_ratio
from flight.measures import UNITS, column
from flight.on_paper import PAPER_LAWS, OnPaper
from flight.sparing import HELD, SPENT
from flight.texts import DRAWS, EDGES, FAILURES, LADDER, LIMITS, MARGINS, PAPER, SPARING
from trussflow.models.feasibility import survey
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.reporting.metrics import LATE_WINDOW
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES, Mission
from trussflow.models.transport.wiring import path_of

SHOWN = {"m": ("mm", 1e3), "rad": ("mrad", 1e3), "N": ("N", 1.0), "N*m": ("N·m", 1.0), "kg": ("g", 1e3)}
"""Unit and factor that units are shown with."""

GOALS = {
    "position": 3e-3,
    "attitude": 3e-3,
    "late position": 70e-6,
    "late joints": 20e-3,
    "late grasp 4": 35e-6,
    "late force": 0.2,
    "alarms": 1.0,
}
"""What a flight must stay below [as measured]; besides, torques must stay below their limits."""


EDGE_MEASURES = ("position", "attitude", "joints", "late position", "torque", "alarms")
"""What is told of flights at the edge."""

PANELS = ("position", "attitude", "late position", "late grasp 4")


def draws_section(batches: Mapping[int, xr.Dataset], ledger: Ledger, folder: Path) -> str:
    """Return what is said of the draws, and draw how they are spread.

    Parameters
    ----------
    batches : mapping
        All draws of each case.
    ledger : Ledger
        Takes down the numbers.
    folder : pathlib.Path
        Of the report.
    """
    rows, panels = [], []
    for name, plain in UNITS.items():
        unit, factor = SHOWN.get(plain, (plain, 1.0))
        cells, curves = [], []
        for case, flown in batches.items():
            values, runs = factor * flown[name].values, [f"case{case}-draws-{TUNED}"]
            goal = GOALS.get(name)
            if name.endswith("torque"):
                goal = torque_limit(case)
            cells += [
                ledger(f"case {case}: {name}, {word}", value, unit, runs=runs, show_unit=False)
                for word, value in (("median", np.nanmedian(values)), ("greatest", np.nanmax(values)))
            ]
            if goal is None:
                cells += ["", ""]
            else:
                beyond = int(np.sum(~(values < factor * goal * (1.0 - 1e-9))))
                count = ledger.count(f"case {case}: {name}, not below", beyond, runs)
                cells += [f"{factor * goal:.3g}", count]
            curves.append(Curve(f"Case {case}", np.sort(values), np.arange(1, len(values) + 1) / len(values)))
        rows.append((column(name, unit), *cells))
        if name in PANELS:
            panels.append(
                Panel(
                    curves=curves,
                    x=f"{name} [{unit}]",
                    y="share of draws [-]",
                    marks=[factor * GOALS[name]],
                    legend_inside=True,
                )
            )
    save(drawing(panels), folder / "draws.png", small=True)
    header = ["greatest of a flight"]
    for case in batches:
        header += [f"Case {case}: median", "worst", "goal: below", "missed by"]
    lost = {case: int(np.isnan(flown["position"].values).sum()) for case, flown in batches.items()}
    counts = ", ".join(
        f"{ledger.count(f'case {case}: flown', len(flown['seed']) - lost[case])} of "
        f"{ledger.count(f'case {case}: draws', len(flown['seed']))} in Case {case}"
        for case, flown in batches.items()
    )
    return DRAWS.format(
        counts=counts,
        mass=f"{UNCERTAIN:.0%}",
        damping=f"{LIGHTEST_DAMPING:.1%} to {HEAVIEST_DAMPING:.0%}",
        payload=f"{HEAVIEST_PAYLOAD:g} kg",
        tuned=TUNED,
        duration=f"{DURATION:g} s",
        settled=f"{LATE_WINDOW:g} s",
        table=markdown_table(header, rows),
    )


def ladder_section(rungs: Mapping[str, xr.Dataset], ledger: Ledger) -> str:
    """Return the ladder: what each law flies with, and what it is lost with.

    Parameters
    ----------
    rungs : mapping
        By name.
    ledger : Ledger
        Takes down the numbers.
    """
    rows = []
    for key, what in IMPERFECTIONS.items():
        factor, unit = {"s": (1e3, "ms"), "%": (0.01, "%")}.get(what.unit, (1.0, what.unit))
        cells = []
        for law in LAWS:
            name = Rung(law=law, imperfection=key).name
            found = rungs[name]
            flies, lost = (
                ledger(
                    f"{name}, {word}",
                    factor * float(found[word]),
                    unit,
                    runs=[name],
                    digits=2,
                    show_unit=False,
                )
                for word in ("flies", "lost")
            )
            if np.isnan(found["flies"]):
                cells.append(f"lost at {lost}")
            else:
                cells.append(flies if np.isnan(found["lost"]) else f"**{flies}**, lost at {lost}")
        rows.append((f"{what.label} [{unit.replace('*', '·')}]", *cells))
    table = markdown_table(("alone, all else exact", *(law.label for law in LAWS.values())), rows)
    return LADDER.format(
        table=table, position=f"{100 * POSITION:g} cm", joints=f"{JOINTS:g} rad", late=f"{1e3 * LATE:g} mm"
    )


def paper_section(found: Mapping[str, xr.Dataset], ledger: Ledger) -> str:
    """Return how the laws compare where the source's is at home.

    Parameters
    ----------
    found : mapping
        Flights on paper, by name.
    ledger : Ledger
        Takes down the numbers.
    """
    rows = []
    for key, law in PAPER_LAWS.items():
        name = OnPaper(law=key).name
        cells = (
            ledger(f"{name}: {what}", float(value), "rad" if "attitude" in str(what) else "m", runs=[name])
            for what, value in found[name].data_vars.items()
        )
        rows.append((law.label, *cells))
    header = (
        "Case 1",
        "position (norm)",
        "late position (norm)",
        "late attitude (component)",
        "grasp 4 (norm)",
        "late grasp 4, about its mean (norm)",
    )
    return PAPER.format(table=markdown_table(header, rows), settled=f"{LATE_WINDOW:g} s")


def margins_section(found: Mapping[str, xr.Dataset], ledger: Ledger) -> str:
    """Return margins along the flight, with the thrust on.

    Parameters
    ----------
    found : mapping
        Batches of draws, and the nominal truss, by name.
    ledger : Ledger
        Takes down the numbers.
    """
    every = xr.concat(list(found.values()), "seed")
    drawn = every.where(every["seed"] != NOMINAL, drop=True)
    runs = list(found)
    rows = []
    for instant in every["instant"].values:
        cells = [str(instant)]
        for name, sets in (("nominal", every.sel(seed=NOMINAL)), ("worst draw", drawn)):
            at = sets.sel(instant=instant)
            worst = at["growth"].max("seed") if "seed" in at["growth"].dims else at["growth"]
            values = {f"growth, {v}": (float(worst.sel(variation=v)), "1/s") for v in VARIATIONS}
            values |= {"disk": (float(at["disk"].min()), ""), "delay": (1e3 * float(at["delay"].min()), "ms")}
            cells += [
                ledger(f"{instant}, {name}: {what}", value, unit, runs=runs, digits=2, show_unit=False)
                for what, (value, unit) in values.items()
                if name == "nominal" or what in ("growth, nominal", "disk", "delay")
            ]
        rows.append(cells)
    header = ["Case 1", *VARIATIONS, "disk", "delay [ms]", "worst draw: nominal", "disk", "delay [ms]"]
    count = ledger.count("margins: draws", drawn.sizes["seed"], runs)
    ratio = greatest_gain_ratio(BUCKLING, 2 * MeanAxesDesign.shipped().sample_time)
    limit = ledger("margins: greatest ratio of gains", ratio, runs=[], digits=2)
    return MARGINS.format(table=markdown_table(header, rows), count=count, ratio=limit)


def failures_section(found: Mapping[str, xr.Dataset], ledger: Ledger) -> str:
    """Return what became of flights with a loss.

    Parameters
    ----------
    found : mapping
        Batches, by name.
    ledger : Ledger
        Takes down the numbers.
    """
    rows = []
    for name, batch in found.items():
        for flight in batch["flight"].values:
            one = batch.sel(flight=flight)
            cells = [str(flight) + name.removeprefix(name.split(",")[0])]
            if np.isnan(one["position"]):
                rows.append((*cells, "lost", *[""] * 6))
                continue
            shown = [("found_after", "s", 1.0)]
            shown += [(what, *SHOWN[unit]) for what, unit in MEASURES.items()]
            cells += [
                ledger(f"{cells[0]}: {what}", factor * float(one[what]), unit, runs=[name], show_unit=False)
                for what, unit, factor in shown
            ]
            wrong = int(one["false_alarms"])
            rows.append((*cells, str(wrong) if wrong else ""))
    header = ["what dies", "found after [s]"]
    header += [f"{what.replace('_', ' ')} (component) [{SHOWN[unit][0]}]" for what, unit in MEASURES.items()]
    return FAILURES.format(table=markdown_table((*header, "false alarms"), rows))


def edges_section(found: Mapping[str, xr.Dataset], ledger: Ledger) -> str:
    """Return what becomes of flights with actuators of another gain, and with other arms than believed.

    Parameters
    ----------
    found : mapping
        Flights at each edge, by name.
    ledger : Ledger
        Takes down the numbers.
    """
    rows = []
    for name, flown in found.items():
        ends = (flown["position"].values < POSITION) & (flown["joints"].values < JOINTS)
        count = ledger.count(f"{name}: flown", int(ends.sum()), [name])
        cells = [name.removeprefix("edge: "), f"{count} of {len(ends)}"]
        for what in EDGE_MEASURES:
            unit, factor = SHOWN.get(UNITS[what], (UNITS[what], 1.0))
            worst = factor * float(flown[what].max())
            cells.append(ledger(f"{name}: {what}", worst, unit, runs=[name], show_unit=False))
        rows.append(cells)
    heads = (column(what, SHOWN.get(UNITS[what], (UNITS[what],))[0]) for what in EDGE_MEASURES)
    header = ["all that differs", "flown", *heads]
    table = markdown_table(header, rows)
    return EDGES.format(
        table=table, part=f"{PART:.0%}", position=f"{100 * POSITION:g} cm", joints=f"{JOINTS:g} rad"
    )


def limits_section(ledger: Ledger) -> str:
    """Return what of the missions the actuators can do at all, with each single loss.

    Parameters
    ----------
    ledger : Ledger
        Takes down the numbers.
    """
    plant = SpaceTruss.accurate()
    found = {
        case: survey(
            plant.dynamics, path_of(Mission.of_case(case), plant), flown_hardware(case).limits(plant)
        )
        for case in CASES
    }
    rows = []
    for each in zip(*found.values(), strict=True):
        cells = [each[0].failure]
        for case, one in zip(found, each, strict=True):
            note = f"case {case}, {one.failure}"
            cells += [
                ledger(f"{note}: {what}", value, unit, show_unit=False)
                for what, value, unit in (
                    ("margin", one.margin, "1"),
                    ("least duration", one.least_duration, "s"),
                    ("needed torque", one.needed_torque, "N*m"),
                )
            ]
        rows.append(cells)
    header = ["what has failed"]
    for case in found:
        header += [f"Case {case}: margin [1]", "least duration [s]", "needs [N·m]"]
    return LIMITS.format(table=markdown_table(header, rows))


def torque_limit(case: int) -> float:
    """Return the largest torque of bases and joints in a `case` [N·m]."""
    return float(flown_hardware(case).drives(1).maximum[0])


def sparing_section(found: Mapping[str, xr.Dataset], ledger: Ledger) -> str:
    """Return what it brings to spare propellant and wheels.

    Parameters
    ----------
    found : mapping
        Flights, by name.
    ledger : Ledger
        Takes down the numbers.
    """
    rows = []
    for name, flown in found.items():
        cells = [name]
        for base, used in enumerate(flown["used"].values):
            cells.append(
                ledger(f"{name}: base {base + 1} used", 1e3 * used, "g", runs=[name], show_unit=False)
            )
        whole = 1e3 * float(flown["used"].sum())
        cells.append(ledger(f"{name}: used", whole, "g", runs=[name], show_unit=False))
        for axis, held in zip("xyz", flown["held"].values, strict=True):
            cells.append(ledger(f"{name}: held, {axis}", held, "N*m*s", runs=[name], show_unit=False))
        error = 1e3 * float(flown["position"])
        cells.append(ledger(f"{name}: position", error, "mm", runs=[name], show_unit=False))
        rows.append(cells)
    bases = [f"base {k + 1} [g]" for k in range(len(rows[0]) - 6)]
    held = [f"held at the end, {axis} [N·m·s]" for axis in "xyz"]
    header = ["nominal truss", *bases, "all [g]", *held, column("position", "mm")]
    start = ", ".join(f"{each:g}" for each in HELD)
    return SPARING.format(table=markdown_table(header, rows), held=start, spent=f"{SPENT:g} kg")
