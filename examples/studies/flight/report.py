"""The report on flying: the jobs it needs, and how it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr
from study_tools.cache import Job, code_digest, write_atomically
from study_tools.evidence import write_evidence
from study_tools.ledger import Ledger

from flight.campaign import TUNED, Draws
from flight.draws import NOMINAL
from flight.edges import Edge, edges
from flight.emergencies import Emergencies, emergencies
from flight.ladder import ladder
from flight.on_paper import PAPER_LAWS, OnPaper
from flight.robustness import Robustness
from flight.sections import (
    draws_section,
    edges_section,
    failures_section,
    ladder_section,
    limits_section,
    margins_section,
    paper_section,
    sparing_section,
)
from flight.sparing import Sparing
from flight.texts import HEAD
from trussflow.models.reporting.metrics import DEFINITIONS
from trussflow.models.transport.mission import CASES

MARGIN_DRAWS = 6
"""Draws whose margins are computed [-]."""


def jobs(count: int) -> list[Job]:
    """Return all that has to be flown, for so many draws of each case."""
    all_draws = [Draws(case=case, count=count) for case in CASES]
    drawn = tuple(range(TUNED, TUNED + MARGIN_DRAWS))
    half = len(drawn) // 2
    margins = [Robustness(seeds=(NOMINAL, *drawn[:half])), Robustness(seeds=drawn[half:])]
    sparing = [Sparing(case=case, spared=spared) for case in CASES for spared in (False, True)]
    paper = [OnPaper(law=law) for law in PAPER_LAWS]
    return [*all_draws, *margins, *emergencies(), *edges(), *sparing, *ladder(), *paper]


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
    draws = {job.case: found[job.name] for job in flown if isinstance(job, Draws)}
    margins, losses, edged, sparing = (
        {job.name: found[job.name] for job in flown if isinstance(job, kind)}
        for kind in (Robustness, Emergencies, Edge, Sparing)
    )
    sections = {
        "Where each law ends": ladder_section(found, ledger),
        "Draws": draws_section(draws, ledger, folder),
        "What can be flown at all": limits_section(ledger),
        "Failures": failures_section(losses, ledger),
        "Margins with the thrust on": margins_section(margins, ledger),
        "At the edge": edges_section(edged, ledger),
        "Propellant and wheels": sparing_section(sparing, ledger),
        "On paper": paper_section(found, ledger),
    }
    parts = [f"## {title}\n\n{text.strip()}" for title, text in sections.items()]
    report = folder / "README.md"
    head = HEAD.format(digest=code_digest(), definitions=DEFINITIONS)
    write_atomically(report, "\n\n".join([head, *parts]) + "\n")
    write_evidence(folder, ledger, {"runs": {job.name: {"what": str(job)} for job in flown}})
    return report
