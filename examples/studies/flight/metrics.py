"""Metrics of a run from its logged signals, each defined once, and tables of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsFloat

import numpy as np
import xarray as xr
from study_tools.data_files import data_beside
from study_tools.ledger import Ledger, Note

from trussflow.blocks.framework.units import readable
from trussflow.models.reporting.metrics import (
    largest_component,
    largest_norm,
    late_part,
    tracking_metrics,
)
from trussflow.models.reporting.tables import markdown_table

METRICS = data_beside(__file__, "metrics.toml")
"""Metrics by name: ``unit``; ``kind``, largest norm or component of a vector; ``goal``, upper bound [unit]."""

GOALS: dict[str, float] = {
    name: metric["goal"] for name, metric in METRICS.items() if "goal" in metric
}

MAX_POSITION, MAX_JOINTS, MAX_LATE_POSITION = 0.05, 0.2, 5e-3
"""Limits of the position [m] and joint errors [rad] of runs that are not lost, and of the late error of success [m]."""

LATE_WINDOW = 1.0
"""Length of the late part of a run, at its end [s]."""

SCALED_UNITS = {"m": ("mm", 1e3), "rad": ("mrad", 1e3), "kg": ("g", 1e3)}
"""Smaller units in the tables, with their factors."""


def display_unit(name: str) -> tuple[str, float]:
    """Return unit and factor in tables of a metric, or of a statistic of it after a comma; or no unit."""
    unit = METRICS.get(name.partition(", ")[0], {"unit": ""})["unit"]
    return SCALED_UNITS.get(unit, (readable(unit), 1.0))


def tracking(run: xr.Dataset) -> dict[str, float]:
    """Return the tracking errors among the `METRICS` of a run."""
    error = run["truss.task_position"].values - run["trajectory.position"].values
    parts = {
        "position": error[:, :3],
        "attitude": error[:, 3:6],
        "joints": error[:, 6:],
    }
    found = tracking_metrics(run["time"].values, parts, late=LATE_WINDOW)
    return {
        name: found[
            f"{'' if name.startswith('late') else 'peak '}{name} ({METRICS[name]['kind']})"
        ]
        for name in (*parts, *(f"late {part}" for part in parts))
    }


def run_metrics(run: xr.Dataset) -> dict[str, float]:
    """Return the metrics of a run of the mean-axes loop with the reference hardware."""
    late = late_part(run["time"].values, LATE_WINDOW)
    force = run["truss.base_force"].values
    return {
        **tracking(run),
        **isolation(run),
        "force": largest_component(force),
        "base torque": largest_component(run["truss.base_torque"]),
        "joint torque": largest_component(run["truss.joint_torque"]),
        "late grasp 4": largest_norm(run["truss.grasp_displacement"].values[late, 3]),
        "late force": largest_component(force[late]),
        "propellant": float(run["actuators.used.y"].values[-1].sum()),
    }


def isolation(run: xr.Dataset) -> dict[str, float]:
    """Return false alarms and isolation time of a run.

    A false alarm is the isolation of a base without a fault or before it. The isolation time is that of the faulty
    base that is isolated last: infinite if one is never isolated, NaN without a faulty base.
    """
    time, effect = run["time"].values, run["faults.base_effect"].values
    bases = 6 * effect.shape[1]
    valves = run["faults.valves"].values[:, :bases].reshape(*effect.shape, 6)
    isolated = run["controller.monitor.effectiveness"].values[:, :bases:6] < 1.0
    faulty = (effect < 1.0) | valves.any(axis=-1)
    begin, found = (
        np.where(flags.any(axis=0), time[flags.argmax(axis=0)], np.inf)
        for flags in (faulty, isolated)
    )
    concerned = np.isfinite(begin)
    delays = found[concerned] - begin[concerned]
    return {
        "false alarms": float(np.sum(found < begin)),
        "isolated after": float(delays.max()) if delays.size else np.nan,
    }


def lost(found: xr.Dataset) -> xr.DataArray:
    """Return which samples of a sweep diverged, or exceed the limits of position and joint errors."""
    near = (found["position"] <= MAX_POSITION) & (found["joints"] <= MAX_JOINTS)
    return ~near | (found["status"] != "complete")


def successful(found: xr.Dataset) -> xr.DataArray:
    """Return which samples of a sweep are not `lost`, and have a small late position error."""
    return ~lost(found) & (found["late position"] < MAX_LATE_POSITION)


def heading(name: str) -> str:
    """Return the column head of a metric, or of a statistic of it after a comma, with kind and unit.

    Other names are their own heads.
    """
    metric, _, statistic = name.partition(", ")
    kind, (display, _) = METRICS.get(metric, {}).get("kind"), display_unit(metric)
    head = f"{metric} ({kind})" if kind else metric
    if display:
        head += f" [{display}]"
    return f"{head}: {statistic}" if statistic else head


def displayed(note: Note, name: str, value: SupportsFloat) -> str:
    """Record a value [as in `METRICS`], and return it in the unit of its `heading`."""
    if isinstance(value, int):
        return note(name, value)
    display, factor = display_unit(name)
    return note(name, factor * float(value), display, show_unit=False)


def median_and_worst(data: xr.Dataset) -> dict[str, float]:
    """Return median and largest value of each variable of a dataset, NaN if a run diverged."""
    return {
        f"{name}, {word}": float(statistic(data[name].values))
        for name in map(str, data.data_vars)
        for word, statistic in (("median", np.median), ("worst", np.max))
    }


def table(ledger: Ledger, rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a table in Markdown, and record its numbers.

    Parameters
    ----------
    ledger : Ledger
        Record of the numbers.
    rows : mapping
        Cells of each row by name, keyed by the run: numbers [as in `METRICS`], or text.
    """
    cells = [
        [
            value if isinstance(value, str) else displayed(ledger.of(run), name, value)
            for name, value in row.items()
        ]
        for run, row in rows.items()
    ]
    return markdown_table([heading(name) for name in next(iter(rows.values()))], cells)
