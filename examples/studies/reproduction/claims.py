"""Claims of the paper: their criteria, and the table of verdicts."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from operator import itemgetter

from study_tools.data_files import data_beside
from study_tools.ledger import Ledger

from reproduction.report_numbers import ROBOTS, Measures, Numbers
from reproduction.runs import BANDWIDTH_RUNS
from trussflow.models.transport.mission import CASES

REPRODUCED, COARSE, DIFFERS, OPEN = VERDICTS = (
    "reproduced",
    "reproduced with the paper's step only",
    "differs",
    "cannot be judged",
)

SMALL_PART = 1e-3
"""Bound of a small error relative to the commanded motion [-]; of a small angle [rad]."""

NOTABLE_FACTOR = 2.0
"""Least factor of a remarkable, notable, significant or superior difference [-]."""

IDLE_SHARE, MOST_SHARE = 0.05, 0.5
"""Shares in the sum of the peak forces of the robots [-]."""

SMOOTH_CHANGE = 0.02
"""Largest change of a smooth force between logged instants, relative to its peak [-]."""

ERRORS = ("position error", "attitude error")


def advantages(measures: Measures) -> dict[str, dict[str, float]]:
    """Return the least ratios of the errors of other laws to those of the proposed law.

    Parameters
    ----------
    measures : mapping
        Measures of each run by name.

    Returns
    -------
    dict
        ``advantage`` over peak and late errors, and ``late advantage``, keyed by the pair of runs.
    """
    found = {}
    for case in CASES:
        for rival, proposed in (("-pd", ""), ("-smc", ""), ("-smc-fine", "-fine")):
            theirs, ours = (
                measures[f"case{case}{suffix}"] for suffix in (rival, proposed)
            )
            late, peak = (
                min(
                    theirs[f"{when} {error}"] / ours[f"{when} {error}"]
                    for error in ERRORS
                )
                for when in ("late", "peak")
            )
            pair = f"case{case}{rival} over case{case}{proposed}"
            found[pair] = {"advantage": min(late, peak), "late advantage": late}
    return found


def small_errors(n: Numbers) -> bool:
    """Return whether the peak errors of a case are small against the commanded motion."""
    small = (
        n["case#: peak position error"]
        < SMALL_PART * n["case#: commanded displacement"]
    )
    return small and n["case#: peak attitude error"] < SMALL_PART * (
        n["case#: commanded angle"] or 1.0
    )


def against_smc(n: Numbers, advantage: str) -> str:
    """Return the verdict on the errors of SMC, with the paper's step and with a tenth of it."""
    if n[f"case#-smc over case#: {advantage}"] <= NOTABLE_FACTOR:
        return DIFFERS
    return (
        COARSE
        if n[f"case#-smc-fine over case#-fine: {advantage}"] < 1.0
        else REPRODUCED
    )


def bounded_torques(n: Numbers) -> bool | str:
    """Return the verdict on the bound of the torques, which may depend on where the arms are mounted."""
    worst, *others = (
        n[f"case#{suffix}: claimed torque"]
        for suffix in ("", "-centroid-at-joint", "-mounting")
    )
    bound = n["case#: torque bound"]
    if min(others) <= bound < max(*others, worst):
        return OPEN
    return worst <= bound


def of_robots(n: Numbers, subject: str) -> list[float]:
    """Return the numbers of Robots 1 to 4."""
    return [n[f"{subject} {robot}"] for robot in ROBOTS]


CRITERIA: dict[str, Callable[[Numbers], bool | str]] = {
    "small errors": small_errors,
    "errors small and settled": lambda n: (
        small_errors(n)
        and all(
            n[f"case#: late {error}"] < n[f"case#: peak {error}"] for error in ERRORS
        )
    ),
    "other coordinates held": lambda n: (
        small_errors(n)
        and n["case#: peak sideways error"]
        < SMALL_PART * n["case#: commanded displacement"]
        and n["case#: peak joint error"] < SMALL_PART
    ),
    "less chattering": lambda n: (
        n["case# / case#-no-observer: force ripple"] < 1 / NOTABLE_FACTOR
    ),
    "smooth force": lambda n: (
        n["case#: largest jump of force per peak"] < SMOOTH_CHANGE
    ),
    "nothing to compare with": lambda _n: OPEN,
    "estimation error falls with L": lambda n: all(
        n[f"{wide} / {narrow}: settled estimation error"] < 1.0
        for narrow, wide in pairwise(BANDWIDTH_RUNS)
    ),
    "less vibration": lambda n: (
        n["case#-no-observer / case#: modal ripple"] > NOTABLE_FACTOR
    ),
    "cheaper integrals": lambda n: (
        n["plant: operations with exact integrals"] > n["plant: operations"]
    ),
    "arms of full rank": lambda n: n["plant: rank of the arms"] == 6,
    "uniform load": lambda n: (
        max(of_robots(n, "case#: share of Robot")) < NOTABLE_FACTOR / len(ROBOTS)
    ),
    "most by Robot 4": lambda n: n["case#: share of Robot 4"] > MOST_SHARE,
    "nearly nothing by Robot 3": lambda n: n["case#: share of Robot 3"] < IDLE_SHARE,
    "balance of the others": lambda n: (
        n["case#: share of Robots 1, 2, 4"] > 1 - IDLE_SHARE
    ),
    "Robot 3 nearest the centroid": lambda n: (
        n["truss: distance of grasp 3"] == min(of_robots(n, "truss: distance of grasp"))
    ),
    "weights save input": lambda n: (
        max(
            n["case#-equal-weights / case#: impulse of the base forces"],
            n["case#-equal-weights / case#: peak base torque"],
        )
        > NOTABLE_FACTOR
    ),
    "bounded torques": bounded_torques,
    "Robot 4 bends most": lambda n: (
        n["case#: peak elastic displacement at grasp 4"]
        == max(of_robots(n, "case#: peak elastic displacement at grasp"))
    ),
    "small elastic displacement": lambda n: (
        n["case#: peak elastic displacement at grasp 4"]
        < SMALL_PART * n["case#: commanded displacement"]
    ),
    "joint at rest": lambda n: n["case#: peak angle of C41"] < SMALL_PART,
    "smaller errors than PD": lambda n: (
        n["case#-pd over case#: advantage"] > NOTABLE_FACTOR
    ),
    "smaller errors than SMC": lambda n: against_smc(n, "advantage"),
    "smaller late errors than SMC": lambda n: against_smc(n, "late advantage"),
    "smaller velocity ripple than SMC": lambda n: (
        n["case#-smc / case#: velocity ripple"] > NOTABLE_FACTOR
    ),
}
"""Verdict of each kind of claim, or whether it is reproduced, from the numbers of its case."""


def verdict(criterion: str, n: Numbers) -> str:
    """Return the verdict of a criterion.

    Parameters
    ----------
    criterion : str
        Name, one of `CRITERIA`.
    n : Numbers
        Numbers with the case of the claim.
    """
    found = CRITERIA[criterion](n)
    if isinstance(found, str):
        return found
    return REPRODUCED if found else DIFFERS


def table_of_claims(measures: Measures, ledger: Ledger) -> list[dict[str, str]]:
    """Return the rows of the table of claims by heading, in the order of sections.

    Parameters
    ----------
    measures : mapping
        All numbers of the report, see `Numbers`.
    ledger : Ledger
        Record of the quoted numbers.
    """
    rows = []
    for kind in data_beside(__file__, "claims.toml")["kinds"]:
        for claim in kind["claims"]:
            n = Numbers(measures, ledger, claim["case"])
            row = {
                "section": claim["section"],
                "figure": claim["figure"],
                "the paper states": f"“{claim['quote']}”",
                "we find": n.filled(kind["ours"]),
                "verdict": f"**{verdict(kind['criterion'], n)}**",
                "why": n.filled(kind["why"]),
                "runs": ", ".join(f"`{run}`" for run in n.runs),
            }
            rows.append(row)
    return sorted(rows, key=itemgetter("section"))
