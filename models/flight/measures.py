"""What is measured of a flight."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from trussflow.blocks.framework.types import Vector

SETTLED = 10.0
"""What is late: the last seconds of a flight [s]."""

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
"""What is measured of a flight: greatest values, of the root's distance, of any angle, axis or joint."""


def measured(run: xr.Dataset) -> dict[str, float]:
    """Return the greatest values of a flight, as `UNITS` names them.

    Parameters
    ----------
    run : xarray.Dataset
        With `LOG`.
    """
    error, late = tracking(run)
    force, torque, joint = (
        np.abs(run[f"truss.{name}"].values) for name in ("base_force", "base_torque", "joint_torque")
    )
    grasp = run["truss.grasp_displacement"].values[:, 3]
    evidence = run["controller.monitor.evidence"].values
    return {
        "position": longest(error[:, :3]),
        "attitude": error[:, 3:6].max(),
        "joints": error[:, 6:].max(),
        "force": force.max(),
        "torque": torque.max(),
        "joint torque": joint.max(),
        "late position": longest(error[late, :3]),
        "late attitude": error[late, 3:6].max(),
        "late joints": error[late, 6:].max(),
        "late grasp 4": longest(grasp[late]),
        "late force": force[late].max(),
        "propellant": float(run["actuators.used.y"].values[-1].sum()),
        "evidence": evidence.max(),
        "alarms": float((run["controller.monitor.effectiveness"].values[-1] < 1.0).any()),
    }


def tracking(run: xr.Dataset) -> tuple[Vector, NDArray[np.bool_]]:
    """Return how far root and joints are from their path at each time, unsigned, and which times are late.

    Parameters
    ----------
    run : xarray.Dataset
        With task position and trajectory [m, rad].
    """
    error = np.abs(run["truss.task_position"].values - run["trajectory.position"].values)
    return error, run["time"].values >= run["time"].values[-1] - SETTLED


def longest(vectors: Vector) -> float:
    """Return the greatest length of vectors in rows [as given]."""
    return float(np.linalg.norm(vectors, axis=1).max())
