"""The result of a mission: what was logged, under the names and axes that people look for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trussflow.models.plant.space_truss import SpaceTruss

if TYPE_CHECKING:
    import xarray as xr

AXES = ("x", "y", "z")
ANGLES = ("phi", "theta", "psi")

SPLIT = {
    "error": ("position_error", "attitude_error", "joint_error"),
    "error_rate": ("position_error_rate", "attitude_error_rate", "joint_error_rate"),
    "task_position": ("position", "attitude", "joint_angle"),
    "task_velocity": ("velocity", "attitude_rate", "joint_rate"),
}
"""Logged vectors of all task coordinates, and the variables they are split into."""


def tidy(result: xr.Dataset, truss: SpaceTruss) -> xr.Dataset:
    """Split the task vectors into position, attitude and joints, and name the axes.

    Parameters
    ----------
    result : xarray.Dataset
        As logged from a transport diagram.
    truss : SpaceTruss
        The plant, for its numbers of robots and joints.

    Returns
    -------
    xarray.Dataset
        With axes robot, axis, angle, joint, mode and coordinate.

    Notes
    -----
    The axis ``coordinate`` counts the rigid coordinates. Along it the sliding variable is in
    task space, as the labels say; disturbance, its estimate and generalized force belong to
    the generalized speeds, so that their first six elements are along the truss axes.
    """
    import xarray as xr

    joints = truss.joints // truss.robots
    found = xr.Dataset(attrs=result.attrs, coords={"time": result["time"]})
    for name, variable in result.data_vars.items():
        dims, values = ["time", *variable.dims[1:]], variable.values
        if name in SPLIT:
            suffix = "/s" if name in ("error_rate", "task_velocity") else ""
            parts = (values[:, :3], values[:, 3:6], values[:, 6:].reshape(-1, truss.robots, joints))
            axes = (("axis",), ("angle",), ("robot", "joint"))
            units = ("m", "rad", "rad")
            for part, key, axis, unit in zip(parts, SPLIT[str(name)], axes, units, strict=True):
                meaning = key.replace("_", " ")
                found[key] = (("time", *axis), part, {"units": unit + suffix, "long_name": meaning})
            continue
        if name == "joint_torque":
            dims, values = ["time", "robot", "joint"], values.reshape(-1, truss.robots, joints)
        elif values.ndim == 2 and values.shape[1] == truss.rigid:
            dims = ["time", "coordinate"]
        found[name] = (dims, values, variable.attrs)
    labels = [*AXES, *ANGLES]
    labels += [f"theta_{i + 1}_{j + 1}" for i in range(truss.robots) for j in range(joints)]
    return found.assign_coords(
        robot=np.arange(1, truss.robots + 1),
        axis=list(AXES),
        angle=list(ANGLES),
        joint=np.arange(1, joints + 1),
        mode=np.arange(1, truss.modes + 1),
        coordinate=labels,
    )
