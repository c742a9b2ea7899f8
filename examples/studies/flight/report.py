"""Report on the robustness of the mean-axes controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr
from study_tools.evidence import fingerprint, write_report
from study_tools.ledger import Ledger

from flight import sections
from flight.campaigns import (
    EXACT,
    FAILURES,
    FIRST_SEED,
    OFF_NOMINAL,
    PROPELLANT,
    SAMPLES,
    Campaign,
    all_campaigns,
    loop_fingerprint,
)
from flight.limits import robustness_limits, simulated, trial_simulator
from flight.loops import LAWS
from flight.margins import loop_session, margins_along
from flight.samples import NOMINAL_SEED
from flight.texts import HEAD
from trussflow.models.reporting.metrics import DEFINITIONS

MARGIN_SEEDS = [NOMINAL_SEED, *range(FIRST_SEED, FIRST_SEED + 6)]
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
    campaigns = all_campaigns(count)
    found = {one.name: one.run(runs, workers=workers) for one in campaigns}
    bounds = robustness_limits(
        lambda trials, number: simulated(
            trials, runs / f"limits-{number}", workers=workers
        )
    )
    margins = margins_along(MARGIN_SEEDS)
    return write(campaigns, found, bounds, margins, output, fingerprints())


def fingerprints() -> dict[str, list[float]]:
    """Return the fingerprints of all simulated loops, by campaign, with the first sample of each case."""
    found = {one.name: one.fingerprint() for one in all_campaigns(1)}
    found[LIMITS] = []
    for law in LAWS:
        trial = ("law", law), ("imperfection", "hold"), ("value", 0.0)
        found[LIMITS] += loop_fingerprint(trial_simulator, trial)
    found[MARGINS] = fingerprint(loop_session("numpy"))
    return found


def write(
    campaigns: Sequence[Campaign],
    found: Mapping[str, xr.Dataset],
    bounds: Bounds,
    margins: xr.Dataset,
    folder: Path,
    recorded: Mapping[str, Sequence[float]],
) -> Path:
    """Write report, figure and evidence, and return the file of the report.

    Parameters
    ----------
    campaigns : sequence of Campaign
        All campaigns.
    found : mapping
        Results by name of the campaign.
    bounds : mapping
        Result of `robustness_limits`.
    margins : xarray.Dataset
        Result of `margins_along`.
    folder : pathlib.Path
        Folder of the report.
    recorded : mapping
        Result of `fingerprints`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    ledger = Ledger()
    grouped: dict[str, dict[str, xr.Dataset]] = {}
    for one in campaigns:
        grouped.setdefault(one.section, {})[one.name] = found[one.name]
    samples = sections.samples_section(grouped[SAMPLES], ledger, folder)
    texts = {
        LIMITS: sections.limits_section(bounds, ledger),
        SAMPLES: samples,
        "Feasibility": sections.missions_section(ledger),
        FAILURES: sections.failures_section(grouped[FAILURES], ledger),
        MARGINS: sections.margins_section(margins, ledger),
        OFF_NOMINAL: sections.off_nominal_section(grouped[OFF_NOMINAL], ledger),
        PROPELLANT: sections.propellant_section(grouped[PROPELLANT], ledger),
        EXACT: sections.loops_section(found["exact loops"], ledger),
    }
    parts = [HEAD.format(definitions=DEFINITIONS)]
    parts += [f"## {title}\n\n{text}\n" for title, text in texts.items()]
    count = len(found["case 1"]["sample"])
    return write_report(folder, "\n".join(parts), ledger, recorded, samples=count)
