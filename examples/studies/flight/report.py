"""Report on the robustness of the mean-axes controller."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from study_tools.evidence import fingerprint, write_report
from study_tools.ledger import Ledger

from flight import campaigns, metrics, samples, sections, worst_case
from flight.campaigns import Campaign, all_campaigns, loop_fingerprint
from flight.limits import robustness_limits, simulated, trial_simulator
from flight.loops import LAWS
from flight.margins import loop_session, margins_along
from flight.texts import HEAD
from flight.worst_case import Proof
from trussflow.blocks.support.files import replaced
from trussflow.models.reporting.metrics import DEFINITIONS

MARGIN_SEEDS = [
    samples.NOMINAL_SEED,
    *range(campaigns.FIRST_SEED, campaigns.FIRST_SEED + 6),
]
"""Seeds of the trusses whose margins are computed."""

LIMITS, MARGINS = "Robustness limits", "Margins under thrust"

Bounds = Mapping[tuple[str, str], tuple[float, float]]


def make_report(count: int, output: Path, runs: Path, workers: int | None) -> Path:
    """Simulate what is missing, write the report, and return its file.

    Parameters
    ----------
    count : int
        Number of Monte Carlo samples of each case [-].
    output, runs : pathlib.Path
        Folders of the report and of the finished runs.
    workers : int, optional
        Number of parallel runs, as for `sweep` [-].
    """
    simulations = all_campaigns(count)
    # Threads share the simulators, whose preparation takes as long as a run.
    found = {
        one.name: one.run(runs, workers=workers, executor="threads")
        for one in simulations
    }
    bounds = robustness_limits(
        lambda trials, number: simulated(
            trials, runs / f"limits-{number}", workers=workers
        )
    )
    margins = margins_along(MARGIN_SEEDS)
    worst = {
        metric: worst_case.searched(metric, runs, workers=workers, executor="threads")
        for metric in worst_case.SEARCHED
    }
    proof = worst_case.proof()
    recorded = fingerprints()
    return write(simulations, found, bounds, margins, worst, proof, output, recorded)


def fingerprints() -> dict[str, list[float]]:
    """Return the fingerprints of all simulated loops, by campaign, with the first sample of each case."""
    found = {one.name: one.fingerprint() for one in all_campaigns(1)}
    found[LIMITS] = []
    for law in LAWS:
        trial = ("law", law), ("imperfection", "hold"), ("value", 0.0)
        found[LIMITS] += loop_fingerprint(trial_simulator, trial)
    found[campaigns.WORST_CASE] = worst_case.generation(
        "", np.zeros((1, worst_case.DIMENSION))
    ).fingerprint()
    found[MARGINS] = fingerprint(loop_session(backend="numpy"))
    return found


def write(
    simulations: Sequence[Campaign],
    found: Mapping[str, xr.Dataset],
    bounds: Bounds,
    margins: xr.Dataset,
    worst: Mapping[str, Mapping[str, Any]],
    proof: Proof,
    folder: Path,
    recorded: Mapping[str, Sequence[float]],
) -> Path:
    """Write report, details and evidence, and return the file of the report.

    Parameters
    ----------
    simulations : sequence of Campaign
        All campaigns.
    found : mapping
        Results by name of the campaign.
    bounds : mapping
        Result of `robustness_limits`.
    margins : xarray.Dataset
        Result of `margins_along`.
    worst : mapping
        Results of `worst_case.searched` by metric.
    proof : Proof
        Result of `worst_case.proof`.
    folder : pathlib.Path
        Folder of the report.
    recorded : mapping
        Result of `fingerprints`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ledger = Ledger()
    grouped: dict[str, dict[str, xr.Dataset]] = {}
    for one in simulations:
        grouped.setdefault(one.section, {})[one.name] = found[one.name]
    loops = {name: joined(grouped[name].values()) for name in campaigns.LOOPS}
    head = HEAD.format(
        definitions=DEFINITIONS,
        campaigns=campaigns,
        metrics=metrics,
        samples=samples,
        tables=sections.summary_tables(loops, ledger),
    )
    texts = {
        "Feasibility": sections.missions_section(ledger),
        MARGINS: sections.margins_section(margins, ledger),
        campaigns.WORST_CASE: sections.worst_case_section(
            loops[next(iter(loops))], worst, proof, ledger
        ),
        campaigns.PROPELLANT: sections.propellant_section(
            grouped[campaigns.PROPELLANT], ledger
        ),
        campaigns.DAMPING: sections.damping_section(found["damping"], ledger),
        LIMITS: sections.limits_section(bounds, ledger),
        campaigns.EXACT: sections.loops_section(found["exact loops"], ledger),
    }
    parts = [head, *(f"## {title}\n\n{text}\n" for title, text in texts.items())]
    with replaced(folder / "details.md") as partial:
        partial.write_text(sections.details_page(loops), encoding="utf-8")
    return write_report(folder, "\n".join(parts), ledger, recorded)


def joined(found: Iterable[xr.Dataset]) -> xr.Dataset:
    """Return metrics and status of all runs of a loop, NaN in runs without results."""
    parts = [
        one[[name for name in (*metrics.METRICS, "status") if name in one]]
        for one in found
    ]
    return xr.concat(parts, "sample", data_vars="all", join="outer")
