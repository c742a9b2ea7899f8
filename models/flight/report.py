"""The report on flying: its sections, the jobs they need, and how it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from trussflow.models.flight.campaign import TUNED, Draws, all_draws
from trussflow.models.flight.draws import HEAVIEST_DAMPING, HEAVIEST_PAYLOAD, LIGHTEST_DAMPING, UNCERTAIN
from trussflow.models.flight.emergencies import MEASURES, Emergencies, emergencies
from trussflow.models.flight.flights import DURATION, flown_hardware
from trussflow.models.flight.ladder import IMPERFECTIONS, JOINTS, LATE, LAWS, POSITION, Rung, ladder
from trussflow.models.flight.margins import VARIATIONS
from trussflow.models.flight.measures import SETTLED, UNITS
from trussflow.models.flight.on_paper import PAPER_LAWS, OnPaper
from trussflow.models.flight.robustness import NOMINAL, Robustness
from trussflow.models.reporting.cache import Job, code_digest, write_atomically
from trussflow.models.reporting.evidence import write_evidence
from trussflow.models.reporting.figures import Curve, Panel, drawing, save
from trussflow.models.reporting.ledger import Ledger
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES

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


MARGIN_DRAWS = 6
"""Draws whose margins are computed [-]."""

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
                goal = float(flown_hardware(case).drives(1).maximum[0])
            cells += [
                ledger(f"case {case}: {name}, {word}", value, plain, runs=runs, show_unit=False)
                for word, value in (("median", np.nanmedian(values)), ("greatest", np.nanmax(values)))
            ]
            if goal is None:
                cells += ["", ""]
            else:
                beyond = int(np.sum(~(values < factor * goal * (1.0 - 1e-9))))
                count = ledger.count(f"case {case}: {name}, not below", beyond, runs)
                cells += [f"{factor * goal:.3g}", count]
            curves.append(Curve(f"Case {case}", np.sort(values), np.arange(1, len(values) + 1) / len(values)))
        rows.append((f"{name} [{unit}]", *cells))
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
        settled=f"{SETTLED:g} s",
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
        "greatest error",
        "late",
        "late, attitude",
        "grasp 4, greatest",
        "late, about its mean",
    )
    return PAPER.format(table=markdown_table(header, rows), settled=f"{SETTLED:g} s")


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
    return MARGINS.format(table=markdown_table(header, rows), count=count)


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
    header += [f"{what.replace('_', ' ')} [{SHOWN[unit][0]}]" for what, unit in MEASURES.items()]
    return FAILURES.format(table=markdown_table((*header, "false alarms"), rows))


def jobs(count: int) -> list[Job]:
    """Return all that has to be flown, for so many draws of each case."""
    batches = [batch for case in CASES for batch in all_draws(case, count)]
    drawn = tuple(range(TUNED, TUNED + MARGIN_DRAWS))
    half = len(drawn) // 2
    margins = [Robustness(seeds=(NOMINAL, *drawn[:half])), Robustness(seeds=drawn[half:])]
    return [*batches, *margins, *emergencies(), *ladder(), *(OnPaper(law=law) for law in PAPER_LAWS)]


def write(found: Mapping[str, xr.Dataset], flown: Sequence[Job], folder: Path) -> Path:
    """Write report, figures and evidence; return the report's file.

    Parameters
    ----------
    found : mapping
        What the jobs found, by name.
    flown : sequence of Job
        From `jobs`.
    folder : pathlib.Path
        Of the report.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ledger = Ledger()
    batches = {
        case: xr.concat([found[j.name] for j in flown if isinstance(j, Draws) and j.case == case], "seed")
        for case in CASES
    }
    margins, losses = (
        {job.name: found[job.name] for job in flown if isinstance(job, kind)}
        for kind in (Robustness, Emergencies)
    )
    sections = {
        "Where each law ends": ladder_section(found, ledger),
        "Draws": draws_section(batches, ledger, folder),
        "Failures": failures_section(losses, ledger),
        "Margins with the thrust on": margins_section(margins, ledger),
        "On paper": paper_section(found, ledger),
    }
    parts = [f"## {title}\n\n{text.strip()}" for title, text in sections.items()]
    report = folder / "README.md"
    write_atomically(report, "\n\n".join([HEAD.format(digest=code_digest()), *parts]) + "\n")
    write_evidence(folder, ledger, {"runs": {job.name: {"what": str(job)} for job in flown}})
    return report


HEAD = """\
# A loop that flies

What the source's loop needs, where it ends, and what flies in its place: the loop of the mean axes
([models/mean_axes](../../models/mean_axes/README.md)). Written by `make flight`; every number stands with
its full value in [`evidence.json`](evidence.json). Made by the code of digest `{digest}`;
`python -m trussflow.models.flight --check` tells whether that is the code at hand."""

LADDER = """\
How much of each imperfection a loop takes, alone, while all else is exact: the worst value that it flies
Case 1 with (bold), and the next at which it is lost, found by bisection. The source's law and its
mode-neutral form know the six modes of their own plant and their exact states, and begin with 1 ms of hold;
the mean axes fly the accurate plant (38 modal coordinates), see root and joints only, and begin with 20 ms
of hold and 20 ms of delay. Lost is what errs by more than {position} at the root or {joints} in a joint, or
ends with more than {late}.

{table}"""

DRAWS = """\
{counts}. The accurate nonlinear plant behind `Hardware.flight`: a command every 20 ms, 20 ms late; noise of
1e-4 m, rad, m/s and rad/s on root and joints; steps of 0.1 N; at most 5 N, and 0.3 N·m (Case 2: 1 N·m) for
each axis of a base and each joint. The controller knows the nominal truss; flown are draws of it: mass and
frequencies within {mass}, shapes at the grasps by a deviation of up to {mass}, damping {damping}, and up to
{payload} at the tip. Seeds begin at {tuned}: those below were tuned on. Flights last {duration}; *late* are
the last {settled}. Position is the root's distance from its path, late grasp 4 its elastic deflection.

{table}

![How the draws are spread](draws.png)"""

PAPER = """\
All is exact and held for 1 ms, as the source's loop needs it. The mean axes take another millisecond to
compute, and see no modes. *Late* are the last {settled} of 80 s, after the motion.

{table}"""

FAILURES = """\
Case 1 on the nominal accurate plant behind `Hardware.flight`, 80 s. What dies does so at once and for
good; nobody tells the controller. Along body z base 4 cannot be lost at these limits
(`trussflow.models.feasibility.survey` says so before the flight), so there robots 1 to 3 lose something;
*turned* is the attitude that `best_attitude` finds by turns about body x, in which every single loss can
be survived. With brakes the joints of a dead robot are held where the controller believes its drives
dead; without, its arm swings.

{table}"""

MARGINS = """\
Plant and controller, linear at instants of a flight without noise and steps of thrust, commands held;
growth of the slowest motion, in 1/s: below 0 it decays. Gains multiply all that the actuators do beyond
what they did at that instant, +20 ms delays it. *Disk* is the least symmetric disk margin of a single
actuator or sensor with all others closed, *delay* what further delay is stood (∞: 0.2 s and more). Last,
the worst of {count} draws. Under thrust an arm leaves at 21 1/s: gains that change then, at unchanged
thrust, are lost, and no linear controller stands more than 2/21 s = 95 ms of delay in all (Middleton,
Miller 2007, *On the achievable delay margin using LTI control for unstable plants*, IEEE Transactions on
Automatic Control 52 (7)), of which hold, computing and measuring take 50.

{table}"""
