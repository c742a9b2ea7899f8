"""Figures of merit of a mission, beside what the source says."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.models.transport.mission import Mission

if TYPE_CHECKING:
    import xarray as xr

TORQUE_CLAIM = {1: 0.25, 2: 0.8}
"""Bound on the control torques that the source reads off its Figures 7 and 14 [N·m]."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of merit.

    Attributes
    ----------
    name : str
        What it is.
    value : float
        Its value [unit].
    unit : str
        Its unit.
    claim : str
        What the source says; empty where it says nothing.
    """

    name: str
    value: float
    unit: str
    claim: str = ""


def summarize(result: xr.Dataset, mission: Mission) -> list[Figure]:
    """Return the figures of merit of a mission.

    Parameters
    ----------
    result : xarray.Dataset
        From `tidy`.
    mission : Mission
        What was flown.
    """
    torque = np.abs(result["base_torque"].values).max(axis=(0, 2))
    force = np.abs(result["base_force"].values).max(axis=(0, 2))
    bound = TORQUE_CLAIM[mission.case]
    figures = [
        Figure("peak position error", _peak(result, "position_error"), "m",
               "converges to a small neighbourhood of zero"),
        Figure("final position error", _final(result, "position_error"), "m"),
        Figure("peak attitude error", _peak(result, "attitude_error"), "rad",
               "small" if mission.case == 2 else "stays at its initial state"),
        Figure("final attitude error", _final(result, "attitude_error"), "rad"),
        Figure("peak joint error", _peak(result, "joint_error"), "rad",
               "C_4,1 stays near its start" if mission.case == 1 else ""),
    ]  # fmt: skip
    share = {3: "nearly none (Case 1)", 4: "most (Case 1)"} if mission.case == 1 else {}
    figures += [
        Figure(f"peak base force, Robot {i}", float(f), "N", share.get(i, ""))
        for i, f in enumerate(force, 1)
    ]
    figures += [
        Figure("peak base torque", float(torque.max()), "N*m", f"within {bound:g} N*m"),
        Figure("peak joint torque", _peak(result, "joint_torque"), "N*m"),
    ]
    if "grasp_displacement" in result:
        last = result["grasp_displacement"].isel(robot=-1).values
        figures.append(
            Figure("peak elastic displacement, last grasp", float(np.abs(last).max()), "m", "small")
        )
    return figures + _observer(result, mission)


def _observer(result: xr.Dataset, mission: Mission) -> list[Figure]:
    """Return what Theorem 1 is about, where there is an observer."""
    if not result.attrs.get("observer", 0):
        return []
    time, d = result["time"].values, result["disturbance"].values
    if len(time) < 3:
        return []
    xi = np.linalg.norm(np.diff(d, axis=0) / np.diff(time)[:, None], axis=1).max()
    late = time >= min(5 / mission.observer_bandwidth, time[-1] / 2)
    error = np.linalg.norm(result["disturbance_estimate"].values - d, axis=1)[late].max()
    bound = float(xi / mission.observer_bandwidth)
    return [
        Figure(
            "peak disturbance estimation error", float(error), "m/s^2", "at most xi/L (Theorem 1)"
        ),
        Figure("xi/L, xi from the logged disturbance", bound, "m/s^2"),
    ]


def _peak(result: xr.Dataset, name: str) -> float:
    return float(np.abs(result[name].values).max())


def _final(result: xr.Dataset, name: str) -> float:
    return float(np.abs(result[name].values[-1]).max())


def table(figures: list[Figure]) -> str:
    """Return the figures as a table for people."""
    rows = [(f.name, f"{f.value:.3e}", f.unit, f.claim) for f in figures]
    rows.insert(0, ("figure", "value", "unit", "the source says"))
    widths = [max(len(row[i]) for row in rows) for i in range(4)]
    lines = [
        "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    lines.insert(1, "  ".join("-" * w for w in widths))
    return "\n".join(lines)


def as_json(figures: list[Figure], attributes: dict[str, Any]) -> dict[str, Any]:
    """Return figures and provenance as plain data."""
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in attributes.items()}
    return {"figures": [asdict(f) for f in figures], "run": plain}
