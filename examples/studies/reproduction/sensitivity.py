"""How the main results change when an assumption does."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from reproduction.claims import MOST, NEARLY_NOTHING, SMALL
from reproduction.context import Context
from reproduction.measures import TORQUE_BOUNDS, force_shares, late
from reproduction.results import Results
from trussflow.models.reporting.metrics import largest_component as peak
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES

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

COLUMNS: tuple[tuple[str, str, str, Callable[[xr.Dataset], float]], ...] = (
    ("peak position error (component) [m]", "peak position error", "m", lambda r: peak(r.position_error)),
    (
        "late position error (component) [m]",
        "late position error",
        "m",
        lambda r: peak(late(r).position_error),
    ),
    ("peak attitude error (component) [rad]", "peak attitude error", "rad", lambda r: peak(r.attitude_error)),
    ("peak base torque (component) [N·m]", "peak base torque", "N*m", lambda r: peak(r.base_torque)),
    ("peak joint torque (component) [N·m]", "peak joint torque", "N*m", lambda r: peak(r.joint_torque)),
    ("share of Robot 3", "share of Robot 3", "%", lambda r: force_shares(r)[2]),
    ("share of Robot 4", "share of Robot 4", "%", lambda r: force_shares(r)[3]),
    (
        "elastic displacement at Robot 4 (component) [m]",
        "peak elastic displacement at Robot 4",
        "m",
        lambda r: peak(r.grasp_displacement.sel(robot=4)),
    ),
)
"""Heading, name of the number, unit, value."""


def section(context: Context) -> str:
    """Return the tables of the report."""
    parts = []
    for case in CASES:
        rows = [[meaning, *_measures(context, case, suffix)] for suffix, meaning in VARIANTS.items()]
        header = (f"Case {case}", *(heading for heading, *_ in COLUMNS), "changed verdicts")
        parts.append(markdown_table(header, rows))
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
        "bound on the torques": worst <= TORQUE_BOUNDS[mission.case],
        "small elastic displacement": peak(result.grasp_displacement) < SMALL * way,
    }
    if mission.case == 1:
        shares = force_shares(result)
        found["Robot 3 idle"] = bool(shares[2] < NEARLY_NOTHING)
        found["Robot 4 most"] = bool(shares[3] > MOST)
    return found


def _measures(context: Context, case: int, suffix: str) -> list[str]:
    results, run = context.results, f"case{case}{suffix}"
    note = context.ledger.of(run)
    shown = [
        note(name, value(results[run]), unit, digits=2 if unit == "%" else 3, show_unit=unit == "%")
        for _, name, unit, value in COLUMNS
    ]
    usual, now = outcomes(results, f"case{case}"), outcomes(results, run)
    changed = [f"{k}: {'holds' if v else 'fails'}" for k, v in now.items() if v != usual[k]]
    return [*shown, "; ".join(changed) or "none"]


TEXT = """\
One assumption changed at a time, everything else as in the runs above. The last column names the
statements of the source that come out differently than in the first row.

{tables}
"""
