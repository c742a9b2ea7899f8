"""Metrics of a flight, from its log."""

from __future__ import annotations

import xarray as xr

from trussflow.models.reporting.metrics import largest_component, largest_norm, late_part, tracking_metrics

UNITS = {
    "position": "m",
    "attitude": "rad",
    "joints": "rad",
    "force": "N",
    "torque": "N*m",
    "joint torque": "N*m",
    "late position": "m",
    "late attitude": "rad",
    "late joints": "rad",
    "late grasp 4": "m",
    "late force": "N",
    "propellant": "kg",
    "evidence": "1",
    "alarms": "1",
}
"""Metrics of a flight."""

TRACKING = {
    "position": "peak position (norm)",
    "attitude": "peak attitude (component)",
    "joints": "peak joints (component)",
    "late position": "late position (norm)",
    "late attitude": "late attitude (component)",
    "late joints": "late joints (component)",
}
"""Definitions of the errors among them, by `tracking_metrics`."""

NORMS = ("position", "late position", "late grasp 4")
"""Metrics that are largest norms; those of other vectors are largest components."""


def measured(run: xr.Dataset) -> dict[str, float]:
    """Return the metrics of a flight, as `UNITS` names them.

    Parameters
    ----------
    run : xarray.Dataset
        With `LOG`.
    """
    late, force = late_part(run["time"].values), run["truss.base_force"].values
    found = tracking(run) | {
        "force": largest_component(force),
        "torque": largest_component(run["truss.base_torque"]),
        "joint torque": largest_component(run["truss.joint_torque"]),
        "late grasp 4": largest_norm(run["truss.grasp_displacement"].values[late, 3]),
        "late force": largest_component(force[late]),
        "propellant": float(run["actuators.used.y"].values[-1].sum()),
        "evidence": float(run["controller.monitor.evidence"].values.max()),
        "alarms": float((run["controller.monitor.effectiveness"].values[-1] < 1.0).any()),
    }
    return {name: found[name] for name in UNITS}


def tracking(run: xr.Dataset) -> dict[str, float]:
    """Return the errors of root and joints, as `TRACKING` names them [m, rad].

    Parameters
    ----------
    run : xarray.Dataset
        With task position and trajectory [m, rad].
    """
    error = run["truss.task_position"].values - run["trajectory.position"].values
    parts = {"position": error[:, :3], "attitude": error[:, 3:6], "joints": error[:, 6:]}
    found = tracking_metrics(run["time"].values, parts)
    return {name: found[metric] for name, metric in TRACKING.items()}


def column(name: str, unit: str) -> str:
    """Return the head of a column: the `name` of a metric of `UNITS`, its kind, and the `unit` shown."""
    kind = "norm" if name in NORMS else "component"
    return f"{name} [{unit}]" if UNITS[name] in ("kg", "1") else f"{name} ({kind}) [{unit}]"
