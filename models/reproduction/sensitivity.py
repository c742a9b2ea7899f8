"""How the main results change when an assumption does."""

from __future__ import annotations

import numpy as np

from trussflow.models.reporting.tables import markdown_table
from trussflow.models.reproduction.claims import MOST, NEARLY_NOTHING, SMALL
from trussflow.models.reproduction.context import Context
from trussflow.models.reproduction.measures import force_shares, late, peak
from trussflow.models.reproduction.results import Results
from trussflow.models.transport.mission import CASES
from trussflow.models.transport.summary import TORQUE_CLAIM

VARIANTS = {
    "": "as reported above",
    "-centroid-at-joint": "base: centroid in joint C_{i,7}",
    "-half-mounting": "base: half the mounting height further out",
    "-mounting": "base: the mounting height of the Kinova arm further out",
    "-other-side": "truss on the other side of the grasp plane, z < 0",
    "-inner-edge": "grasp line on the inner longeron of the bend",
    "-jaco": "true arm (jaco): its posture, inertias and mounting height",
    "-jaco-at-joint": "true arm, mounting height left out as in the literal arm",
    "-rigid": "rigid truss, no modes",
    "-2-modes": "two modes",
    "-12-modes": "twelve modes",
    "-20-modes": "twenty modes",
    "-consistent": "consistent plant: exact integrals, actuators work on the modes, damped",
}

RUNS = tuple(f"case{case}{suffix}" for case in CASES for suffix in VARIANTS)

HEADINGS = (
    "peak position error [m]",
    "late position error [m]",
    "peak attitude error [rad]",
    "peak base torque [N·m]",
    "peak joint torque [N·m]",
    "share of Robot 3",
    "share of Robot 4",
    "elastic displacement at Robot 4 [m]",
    "changed verdicts",
)


def section(context: Context) -> str:
    """Return the tables of the report."""
    parts = []
    for case in CASES:
        rows = [[meaning, *_measures(context, case, suffix)] for suffix, meaning in VARIANTS.items()]
        parts.append(markdown_table((f"Case {case}", *HEADINGS), rows))
    return TEXT.format(tables="\n\n".join(parts))


def outcomes(results: Results, run: str) -> dict[str, bool]:
    """Return which of the source's main statements come out in a run, by their subject.

    Parameters
    ----------
    results : Results
        Finished runs.
    run : str
        Its name.
    """
    result, mission = results[run], results.mission(run)
    way = float(np.abs(mission.position).max())
    worst = max(peak(result.base_torque), peak(result.joint_torque))
    found = {
        "small errors": peak(result.position_error) < SMALL * way,
        "bound on the torques": worst <= TORQUE_CLAIM[mission.case],
        "small elastic displacement": peak(result.grasp_displacement) < SMALL * way,
    }
    if mission.case == 1:
        shares = force_shares(result)
        found["Robot 3 idle"] = bool(shares[2] < NEARLY_NOTHING)
        found["Robot 4 most"] = bool(shares[3] > MOST)
    return found


def _measures(context: Context, case: int, suffix: str) -> list[str]:
    results, run = context.results, f"case{case}{suffix}"
    result, note = results[run], context.ledger.of(run)
    shares = force_shares(result)
    values = {
        "peak position error": (peak(result.position_error), "m"),
        "late position error": (peak(late(result).position_error), "m"),
        "peak attitude error": (peak(result.attitude_error), "rad"),
        "peak base torque": (peak(result.base_torque), "N*m"),
        "peak joint torque": (peak(result.joint_torque), "N*m"),
        "share of Robot 3": (shares[2], "%"),
        "share of Robot 4": (shares[3], "%"),
        "peak elastic displacement at Robot 4": (peak(result.grasp_displacement.sel(robot=4)), "m"),
    }
    usual, now = outcomes(results, f"case{case}"), outcomes(results, run)
    changed = [f"{k}: {'holds' if v else 'fails'}" for k, v in now.items() if v != usual[k]]
    shown = [
        note(name, value, unit, digits=2 if unit == "%" else 3, show_unit=unit == "%")
        for name, (value, unit) in values.items()
    ]
    return [*shown, "; ".join(changed) or "none"]


TEXT = """\
One assumption changed at a time, everything else as in the runs above. The last column names the
statements of the source that come out differently than in the first row.

{tables}
"""
