"""What is measured on a finished mission; one definition for the whole report."""

from __future__ import annotations

import numpy as np
import xarray as xr

from trussflow.blocks.framework.types import Vector
from trussflow.models.reporting.metrics import late_part, tracking_metrics

LATE = 1 / 8
"""The late part of a run, a fraction of it: of 80 s the last 10 s."""

RIPPLE_WINDOW = 0.2  # s
"""Ripple is what a centred mean over this time takes away: all above some 2 Hz."""

TORQUE_BOUNDS: dict[int | None, float] = {1: 0.25, 2: 0.8}
"""Bound on the control torques of each case in the paper, Figures 7 (Robot 4 only) and 14 [N·m]."""


def of_robot(result: xr.Dataset, robot: int) -> xr.Dataset:
    """Return the signals of a robot alone.

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    robot : int
        Number of the robot, from 1 [-].
    """
    joints = [name for name in result["joint"].values if name.startswith(f"theta_{robot}_")]
    return result.sel(robot=robot, joint=joints)


def late(result: xr.Dataset) -> xr.Dataset:
    """Return the late part of a run.

    Parameters
    ----------
    result : xarray.Dataset
        Any, over time.
    """
    time = result["time"].values
    return result.isel(time=late_part(time, LATE * time[-1]))


def error_size(result: xr.Dataset, error: str, when: str) -> float:
    """Return the largest component of an error in the whole run, or in its late part [its unit].

    Parameters
    ----------
    result : xarray.Dataset
        The run.
    error : str
        Name of the variable, such as ``"position_error"``.
    when : str
        ``"peak"`` or ``"late"``.
    """
    time = result["time"].values
    found = tracking_metrics(time, {error: result[error].values}, late=LATE * time[-1])
    return found[f"{when} {error} (component)"]


def norm(values: xr.DataArray) -> Vector:
    """Return the Euclidean norm at each instant.

    Parameters
    ----------
    values : xarray.DataArray, shape (time, n)
        A vector over time [any].
    """
    return np.asarray(np.linalg.norm(values.values, axis=1))


def ripple(values: xr.DataArray) -> float:
    """Return the root mean square of what a moving mean does not follow, all axes together.

    Parameters
    ----------
    values : xarray.DataArray, shape (time, n)
        A vector over time [any].
    """
    time = values["time"].values
    half = round(RIPPLE_WINDOW / (time[1] - time[0]) / 2)
    # Differences of sums: a window of many instants costs no more than one of few.
    sums = np.cumsum(np.pad(values.values, ((1, 0), (0, 0))), axis=0)
    mean = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    rest = values.values[half:-half] - mean
    return float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))


def largest_jump(values: xr.DataArray) -> float:
    """Return the largest change between two logged instants.

    Parameters
    ----------
    values : xarray.DataArray, shape (time, n)
        A vector over time [any].
    """
    return float(np.abs(np.diff(values.values, axis=0)).max())


def force_shares(result: xr.Dataset) -> Vector:
    """Return each robot's share in the sum of the robots' peak base forces [-].

    Parameters
    ----------
    result : xarray.Dataset
        Result of a run.
    """
    peaks = np.linalg.norm(result["base_force"].values, axis=2).max(axis=0)
    return np.asarray(peaks / peaks.sum())


def rates(values: xr.DataArray) -> Vector:
    r"""Return :math:`\|\dot d\|` as differences between logged instants.

    Differences can only be smaller than the largest rate between them.

    Parameters
    ----------
    values : xarray.DataArray, shape (time, n)
        A vector over time [any].
    """
    steps = np.diff(values["time"].values)[:, None]
    return np.asarray(np.linalg.norm(np.diff(values.values, axis=0) / steps, axis=1))
