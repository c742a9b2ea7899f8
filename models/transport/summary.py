"""Figures of merit of a mission, compared with the paper."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.units import readable
from trussflow.models.reporting.metrics import largest_component, largest_norm, tracking_metrics
from trussflow.models.reporting.tables import text_table
from trussflow.models.transport.mission import Mission

if TYPE_CHECKING:
    import xarray as xr

TORQUE_BOUNDS: dict[int | None, float] = {1: 0.25, 2: 0.8}
"""Bound on the control torques of each case in the paper, Figures 7 (Robot 4 only) and 14 [N·m]."""

CLAIMS: dict[int | None, dict[str, str]] = {
    1: {
        "final position error": "converges to a small neighbourhood of zero",
        "peak attitude error": "desired: remains at its initial state",
        "peak joint error": "C_4,1 remains near its initial value",
        "peak base force, Robot 3": "nearly no control force",
        "peak base force, Robot 4": "most of the control force",
    },
    2: {"peak position error": "small", "peak attitude error": "small"},
}
"""Statements of the paper on each case, keyed by the name of the figure of merit."""


@dataclass(frozen=True, slots=True)
class FigureOfMerit:
    """Figure of merit of a mission.

    Attributes
    ----------
    name : str
        Name of the quantity.
    value : float
        Value of the quantity [unit].
    unit : str
        Unit of the value.
    claim : str
        Statement of the paper; empty if there is none.
    verdict : str
        Comparison with that statement; empty if it has no number.
    """

    name: str
    value: float
    unit: str
    claim: str = ""
    verdict: str = ""


def summarize(result: xr.Dataset, mission: Mission) -> list[FigureOfMerit]:
    """Return the figures of merit of a mission.

    Parameters
    ----------
    result : xarray.Dataset
        Result by `tidy`.
    mission : Mission
        Simulated mission.
    """
    claims = CLAIMS.get(mission.case, {})
    errors = {f"{name} error": result[f"{name}_error"].values for name in ("position", "attitude")}
    found = tracking_metrics(result["time"].values, errors)
    figures = [
        FigureOfMerit(name, found[f"{name} (component)"], unit, claims.get(name, ""))
        for name, unit in (
            ("peak position error", "m"),
            ("final position error", "m"),
            ("peak attitude error", "rad"),
            ("final attitude error", "rad"),
        )
    ]
    joints = result["joint_error"]
    if joints.size:
        peak, unit = largest_component(joints), joints.attrs.get("units", "rad")
        figures.append(FigureOfMerit("peak joint error", peak, unit, claims.get("peak joint error", "")))
    torque, claim, verdict = largest_component(result["base_torque"]), "", ""
    if bound := TORQUE_BOUNDS.get(mission.case):
        claim = f"within {bound:g} N*m"
        verdict = "holds" if torque <= bound else f"exceeded by {torque / bound - 1:.0%}"
    figures += [*_forces(result, mission), FigureOfMerit("peak base torque", torque, "N*m", claim, verdict)]
    if joints.size:
        torques = largest_component(result["joint_torque"])
        figures.append(FigureOfMerit("peak joint torque", torques, "N*m"))
    last = largest_component(result["grasp_displacement"].values[:, -1])
    claim = "small" if claims else ""
    figures.append(FigureOfMerit("peak elastic displacement, last grasp", last, "m", claim))
    figures += _observer(result, mission)
    status, end = result.attrs.get("status"), float(result["time"][-1])
    if status == "complete" and end >= mission.duration:
        return figures
    # The paper's statements are about whole missions, not about partial or failed ones.
    return [replace(f, claim="", verdict="") for f in figures]


def _forces(result: xr.Dataset, mission: Mission) -> list[FigureOfMerit]:
    """Return the robots' peak forces; for Case 1 the paper states their distribution."""
    forces = np.abs(result["base_force"].values).max(axis=(0, 2))
    figures, total = [], forces.sum()
    for i, force in enumerate(forces, 1):
        name = f"peak base force, Robot {i}"
        claim = CLAIMS.get(mission.case, {}).get(name, "")
        share = f"{force / total:.0%} of the sum" if claim and total > 0 else ""
        figures.append(FigureOfMerit(name, float(force), "N", claim, share))
    return figures


def _observer(result: xr.Dataset, mission: Mission) -> list[FigureOfMerit]:
    """Return the estimation error of Theorem 1 if there is an observer.

    As in the theorem, the norms are over all channels, with m/s^2 and rad/s^2 mixed.
    """
    time, d = result["time"].values, result["disturbance"].values
    if not result.attrs.get("observer", 0) or len(time) < 3:
        return []
    xi = np.linalg.norm(np.diff(d, axis=0) / np.diff(time)[:, None], axis=1).max()
    bound = float(xi / mission.observer_bandwidth)
    # The initial error decays as exp(-L t); of a very short run the second half is evaluated.
    late = time >= min(5 / mission.observer_bandwidth, time[-1] / 2)
    error = largest_norm((result["disturbance_estimate"].values - d)[late])
    claim, verdict = f"at most xi/L = {bound:.1e}", "holds" if error <= bound else "fails"
    return [FigureOfMerit("peak disturbance estimation error (norm)", error, "m/s^2", claim, verdict)]


TITLES = ("figure (largest component)", "value", "unit", "the paper states", "verdict")


def cells(figures: list[FigureOfMerit]) -> list[tuple[str, ...]]:
    """Return the figures as rows of a table under `TITLES`."""
    return [(f.name, f"{f.value:.3e}", readable(f.unit), readable(f.claim), f.verdict) for f in figures]


def table(figures: list[FigureOfMerit]) -> str:
    """Return the figures as a text table."""
    return text_table(TITLES, cells(figures))
