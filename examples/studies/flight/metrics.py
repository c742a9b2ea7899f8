"""Metrics of a run, from its logged signals."""

from __future__ import annotations

import xarray as xr

from trussflow.models.reporting.metrics import (
    largest_component,
    largest_norm,
    late_part,
    tracking_metrics,
)

METRICS = {
    "position": ("m", "norm"),
    "attitude": ("rad", "component"),
    "joints": ("rad", "component"),
    "force": ("N", "component"),
    "torque": ("N*m", "component"),
    "joint torque": ("N*m", "component"),
    "late position": ("m", "norm"),
    "late attitude": ("rad", "component"),
    "late joints": ("rad", "component"),
    "late grasp 4": ("m", "norm"),
    "late force": ("N", "component"),
    "propellant": ("kg", ""),
    "evidence": ("1", ""),
    "alarms": ("1", ""),
}
"""Units of all metrics, and whether they are the largest norm or the largest component of a vector."""

GOALS = {
    "position": 3e-3,
    "attitude": 3e-3,
    "late position": 70e-6,
    "late joints": 20e-3,
    "late grasp 4": 35e-6,
    "late force": 0.2,
    "alarms": 1.0,
}
"""Upper bounds of the metrics [unit of the metric]; torques must also be below their limits."""

MAX_POSITION, MAX_JOINTS, MAX_LATE_POSITION = 0.05, 0.2, 5e-3
"""A run fails if its position [m] or joint error [rad] exceeds these, or its late position error does [m]."""

DISPLAY_UNITS = {
    "m": ("mm", 1e3),
    "rad": ("mrad", 1e3),
    "N": ("N", 1.0),
    "N*m": ("N·m", 1.0),
    "kg": ("g", 1e3),
    "1": ("1", 1.0),
}
"""Units in the tables, with their factors."""


def tracking(run: xr.Dataset) -> dict[str, float]:
    """Return the tracking errors among the `METRICS` of a run."""
    error = run["truss.task_position"].values - run["trajectory.position"].values
    parts = {
        "position": error[:, :3],
        "attitude": error[:, 3:6],
        "joints": error[:, 6:],
    }
    found = tracking_metrics(run["time"].values, parts)
    return {
        name: found[
            f"{'' if name.startswith('late') else 'peak '}{name} ({METRICS[name][1]})"
        ]
        for name in (*parts, *(f"late {part}" for part in parts))
    }


def run_metrics(run: xr.Dataset) -> dict[str, float]:
    """Return all `METRICS` of a run of the mean-axes loop with the reference hardware."""
    late, force = late_part(run["time"].values), run["truss.base_force"].values
    found = tracking(run) | {
        "force": largest_component(force),
        "torque": largest_component(run["truss.base_torque"]),
        "joint torque": largest_component(run["truss.joint_torque"]),
        "late grasp 4": largest_norm(run["truss.grasp_displacement"].values[late, 3]),
        "late force": largest_component(force[late]),
        "propellant": float(run["actuators.used.y"].values[-1].sum()),
        "evidence": float(run["controller.monitor.evidence"].values.max()),
        "alarms": float(
            (run["controller.monitor.effectiveness"].values[-1] < 1.0).any()
        ),
    }
    return {name: found[name] for name in METRICS}


def successful(found: xr.Dataset) -> xr.DataArray:
    """Return which samples of a sweep are complete and within the limits of the errors."""
    near = (found["position"] <= MAX_POSITION) & (found["joints"] <= MAX_JOINTS)
    return (
        near
        & (found["late position"] < MAX_LATE_POSITION)
        & (found["status"] == "complete")
    )


def heading(name: str) -> str:
    """Return the column head of a metric, with its kind and displayed unit."""
    unit, kind = METRICS[name]
    return (
        f"{name} ({kind}) [{DISPLAY_UNITS[unit][0]}]"
        if kind
        else f"{name} [{DISPLAY_UNITS[unit][0]}]"
    )
