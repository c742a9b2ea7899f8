"""The report: its sections, the runs they need, and how it is written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from study_tools.cache import Job, code_digest, write_atomically
from study_tools.evidence import write_evidence

from reproduction import (
    assumptions,
    claims,
    findings,
    instability,
    instability_section,
    late_error,
    sensitivity,
    theorems,
)
from reproduction.context import Context
from reproduction.figures import PAPER_FIGURES
from reproduction.measures import LATE, RIPPLE_WINDOW
from reproduction.results import Results
from reproduction.runs import MissionRun
from reproduction.statements import STATEMENTS
from trussflow.blocks.framework.telling import counted
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import Mission
from trussflow.models.validation import check_choice

REPORT = "README.md"


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the report.

    Attributes
    ----------
    title : str
        Its heading.
    text : callable
        Returns its text.
    missions : tuple of str
        Names of the mission runs it needs.
    jobs : callable
        Returns the other jobs it needs, given what has been finished.
    """

    title: str
    text: Callable[[Context], str]
    missions: tuple[str, ...] = ()
    jobs: Callable[[Results | None], Sequence[Job]] = lambda _: ()


def _claims(context: Context) -> str:
    rows = []
    for claim in STATEMENTS:
        judgement = claim.judged(context.results, context.ledger)
        rows.append(
            (
                claim.section,
                claim.figures or "–",
                f"“{claim.quote}”",
                judgement.ours,
                f"**{judgement.verdict}**",
                judgement.why,
                ", ".join(f"`{run}`" for run in claim.judge.runs),
            )
        )
        said = {"section": claim.section, "figures": claim.figures, "quote": claim.quote}
        context.claims.append({**said, "runs": claim.judge.runs, **asdict(judgement)})
    header = ("section", "figure", "the source says", "we find", "verdict", "why", "runs")
    n = context.ledger
    counts = {
        word: n.count(f"claims: {word}", sum(c["verdict"] == word for c in context.claims))
        for word in (claims.REPRODUCED, claims.COARSE, claims.DIFFERS, claims.OPEN)
    }
    return CLAIMS.format(
        table=markdown_table(header, rows),
        count=n.count("claims", len(rows)),
        reproduced=counts[claims.REPRODUCED],
        coarse=counts[claims.COARSE],
        differs=counts[claims.DIFFERS],
        open=counts[claims.OPEN],
        small=n("criterion: small", claims.SMALL, digits=1),
        notable=n("criterion: notable", claims.NOTABLE, digits=1),
        nothing=n("criterion: nearly nothing", claims.NEARLY_NOTHING, "%", digits=1),
        most=n("criterion: most", claims.MOST, "%", digits=2),
        smooth=n("criterion: smooth", claims.SMOOTH, "%", digits=1),
        late=n("criterion: late part of a run", LATE, "%", digits=3),
        window=n("criterion: ripple window", RIPPLE_WINDOW, "s", digits=1),
    )


def _figures(context: Context) -> str:
    parts = []
    for figure in counted("drawing figures", PAPER_FIGURES):
        figure.draw(context.results, context.folder)
        names = ", ".join(f"`{run}`" for run in figure.runs)
        caption = f"**Figure {figure.number}.** {figure.caption}. {figure.note} Runs: {names}."
        parts.append(f"![Figure {figure.number}]({figure.file})\n\n{' '.join(caption.split())}")
    return "\n\n".join(parts)


_OF_FIGURES = tuple(dict.fromkeys(run for figure in PAPER_FIGURES for run in figure.runs))
_OF_CLAIMS = tuple(dict.fromkeys(run for claim in STATEMENTS for run in claim.judge.runs))

SECTIONS: dict[str, Section] = {
    "claims": Section("Claims", _claims, _OF_CLAIMS),
    "figures": Section("Figures", _figures, _OF_FIGURES),
    "theorems": Section("Theorems along the trajectories", theorems.section, theorems.RUNS),
    "late": Section(
        "Why the observer leaves a larger late error",
        late_error.section,
        (*late_error.RUNS, *late_error.LONG),
        late_error.jobs,
    ),
    "assumptions": Section("What the source leaves out", assumptions.section, assumptions.RUNS),
    "sensitivity": Section("Sensitivity to the assumptions", sensitivity.section, sensitivity.RUNS),
    "instability": Section(
        "Instability with modal actuation", instability_section.section, jobs=lambda _: instability.jobs()
    ),
    "physics": Section("Independent physics", lambda _: PHYSICS),
}
"""By the names used on the command line, in the order of the report."""


def chosen(names: Iterable[str]) -> dict[str, Section]:
    """Return sections by name, in the order of the report.

    Parameters
    ----------
    names : iterable of str
        None of them: all sections.

    Raises
    ------
    ModelError
        If there is no such section.
    """
    wanted = list(names) or list(SECTIONS)
    for name in wanted:
        check_choice("section of the report", name, SECTIONS)
    return {name: section for name, section in SECTIONS.items() if name in wanted}


def write(sections: Mapping[str, Section], context: Context) -> Path:
    """Write report, figures and evidence; return the report's file.

    Parameters
    ----------
    sections : mapping
        From `chosen`.
    context : Context
        What they are written from.
    """
    context.folder.mkdir(parents=True, exist_ok=True)
    parts = [f"## {s.title}\n\n{s.text(context).strip()}" for s in sections.values()]
    found, head = findings.summary(context.ledger), HEAD.format(digest=code_digest())
    parts[:0] = [head, f"## Findings\n\n{found}"] if found else [head]
    results = context.results
    rows = [(f"`{name}`", _plain(results.run(name)), f"`{results.file(name).stem}`") for name in results]
    step = context.ledger("step of the source", Mission.of_case(1).step, "s", digits=1)
    parts.append(f"## Runs\n\n{RUNS.format(step=step)}\n\n{markdown_table(('run', 'what', 'result'), rows)}")
    report = context.folder / REPORT
    write_atomically(report, "\n\n".join(parts) + "\n")
    evidence = {
        "runs": {n: {"file": results.file(n).name, **asdict(results.run(n))} for n in results},
        "claims": context.claims,
    }
    write_evidence(context.folder, context.ledger, evidence)
    return report


def _plain(run: MissionRun) -> str:
    options = ", ".join(f"`{name} = {value}`" for name, value in run.options().items())
    return f"Case {run.case}" + (f": {options}" if options else "")


HEAD = """\
# The results of Li, Wei and Chen (2026), reproduced and judged

Li, Wei, Chen, *Anti-Disturbance Trajectory Tracking Control of Large Space Flexible Truss by Four
Space Robots*, Actuators 2026, 15(2), 108, Section 4. Written by `make reproduce`: every number and
figure here comes from the runs named beside it, and stands with its full value in
[`evidence.json`](evidence.json). **The loop judged here needs exact modal states and a step of 1 ms**:
held for 2 ms, or 1 ms late, its joints run off within four seconds, and on the consistent plant
everything does. Where it ends, and what flies in its place, is in [docs/flight](../flight/README.md).
Made by the code of digest `{digest}`; `python -m reproduction --check` tells whether
that is the code at hand.

Errors, displacements and torques are largest components over time; forces of single robots, and their
shares, are of largest Euclidean norms."""

CLAIMS = """\
Of {count} statements {reproduced} are reproduced, {coarse} with the source's step only, {differs}
differ, and {open} cannot be judged.
The source gives few numbers in its text; words are read like this. An error or displacement is
*small* below {small} of the commanded motion (angles: {small} rad); *remarkable*, *notable*,
*superior* is a factor of {notable}; *nearly no* force is less than {nothing}, *most* more than
{most} of the sum of the robots' peaks; a force is *smooth* that changes by less than {smooth} of
its peak between logged instants. *Late* is the last {late} of a run. *Chattering* is measured as
ripple: root mean square of what a centred mean over {window} does not follow. The source has no
Section 4.5; a statement of Section 4.1 on the load is added.

{table}"""

PHYSICS = """\
Dynamics, frames and signs are checked against independent codes in the tests, not here: the rigid
tree against Pinocchio (`tests/models/dynamics/test_dynamics_pinocchio.py`), the flexible system
against Exudyn (`tests/models/dynamics/test_dynamics_exudyn.py`), the truss against another
finite-element code (`tests/models/truss/test_truss_fe.py`), momentum and energy
(`tests/models/dynamics/test_dynamics_conservation.py`)."""

RUNS = """\
Fixed step of the source (RK4, {step}) unless another is given, except for PD, which is stiff
(LSODA). Results are kept under the names in the last column, a hash of everything that goes into
them, and reused while that does not change."""
