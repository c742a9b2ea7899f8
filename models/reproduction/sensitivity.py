"""How the main results change when an assumption does."""

from __future__ import annotations

import numpy as np

from trussflow.models.reproduction.ledger import Ledger
from trussflow.models.reproduction.measures import force_shares, late, norm, peak
from trussflow.models.reproduction.results import Results
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

HEADINGS = (
    "peak position error [m]", "late position error [m]", "peak attitude error [rad]",
    "peak base torque [N·m]", "peak joint torque [N·m]", "share of Robot 3", "share of Robot 4",
    "elastic displacement at Robot 4 [m]",
)  # fmt: skip


def section(results: Results, ledger: Ledger) -> str:
    """Return the tables of the report.

    Parameters
    ----------
    results : Results
        Finished runs.
    ledger : Ledger
        Takes down the numbers.
    """
    parts = []
    for case in CASES:
        rows = [f"| Case {case} | " + " | ".join(HEADINGS) + " |", "| --- " * 9 + "|"]
        for suffix, meaning in VARIANTS.items():
            cells = _measures(results, ledger, f"case{case}{suffix}")
            rows.append(f"| {meaning} | " + " | ".join(cells) + " |")
        parts.append("\n".join(rows))
    return "\n\n".join(parts)


def _measures(results: Results, ledger: Ledger, run: str) -> list[str]:
    result = results[run]
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
    return [
        ledger(
            f"{run}: {name}", value, unit, runs=[run], digits=2 if unit == "%" else 3,
            show_unit=unit == "%",
        )
        for name, (value, unit) in values.items()
    ]  # fmt: skip
