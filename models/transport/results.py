"""Result of a mission, with named variables and axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.framework.call_site import warn
from trussflow.blocks.framework.telling import all_counted
from trussflow.blocks.framework.types import Vector
from trussflow.models.dynamics.task_space import seen_from, way_to
from trussflow.models.geometry.attitude import EULER
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.truss.truss_modes import LINEAR_LIMIT

if TYPE_CHECKING:
    import xarray as xr

AXES = ("x", "y", "z")

JOINT_LIMIT_TOLERANCE = 1e-3
"""Tolerance of joint limits, at which a joint may rest [rad or m]."""

SPLIT_VARIABLES = {
    "error": ("position_error", "attitude_error", "joint_error"),
    "error_rate": ("position_error_rate", "attitude_error_rate", "joint_error_rate"),
    "task_position": ("position", "attitude", "joint_angle"),
    "task_velocity": ("velocity", "attitude_rate", "joint_rate"),
}
"""Variables of position, attitude and joints, keyed by the logged vectors of all task coordinates."""


def tidy(result: xr.Dataset, truss: SpaceTruss) -> xr.Dataset:
    """Split the task vectors into position, attitude and joints, and name the axes.

    Euler angles have the axis ``angle``, a quaternion the axis ``quaternion``. Its errors and rates are small
    rotations and angular velocities about the axes of the truss.

    Parameters
    ----------
    result : xarray.Dataset
        Log of a transport diagram.
    truss : SpaceTruss
        Plant of that diagram.

    Returns
    -------
    xarray.Dataset
        Dataset with the axes robot, axis, angle, joint, mode and coordinate. Joints have the axes robot and
        joint if all robots have equal numbers of joints, otherwise one axis. The attribute `deflection` is
        that of `TrussModes.deflection` [-]. A deflection above `LINEAR_LIMIT`, or a joint beyond its limits,
        causes a `SimulationWarning`.

    Notes
    -----
    The axis ``coordinate`` has the rigid coordinates. The sliding variable is in task space, as the
    labels state. Disturbance, its estimate and generalized force belong to the generalized speeds:
    their first six elements are in truss axes.
    """
    import xarray as xr

    each = [arm.joints for arm in truss.dynamics.arms]
    alike = len(set(each)) == 1  # otherwise robot and joint cannot be two axes
    rows, by_joint = ((truss.robots, each[0]), ("robot", "joint")) if alike else ((sum(each),), ("joint",))
    kinds = set(truss.task_units[6:])
    kind = truss.dynamics.attitude
    if "reference" in result:  # a law without task errors
        at, moving, goal, rate = (
            result[name].values for name in ("task_position", "task_velocity", "reference", "reference_rate")
        )
        way = [way_to(kind, *pair) for pair in zip(goal, at, strict=True)]
        instants = [*zip(at, moving, goal, rate, strict=True)]
        rates = all_counted("computing errors", lambda each: seen_from(kind, *each, each[-1])[0], instants)
        errors = {"error": way, "error_rate": moving - rates}
        result = result.drop_vars(["reference", "reference_rate"])
        along = result["task_velocity"].dims
        result = result.assign({name: (along, np.array(values)) for name, values in errors.items()})
    bent = truss.dynamics.modes.deflection(result["modal_coordinate"].values)
    if bent > LINEAR_LIMIT:
        warn(
            f"the truss bends by {bent:.2g} of its size or rad; above {LINEAR_LIMIT} the errors of linear "
            "shapes exceed 1 %, without foreshortening: do not rely on the results; reduce the forces"
        )
    _warn_of_joints(result["task_position"].values[:, kind.end :], truss)
    found = xr.Dataset(attrs={**result.attrs, "deflection": bent}, coords={"time": result["time"]})
    for name, variable in result.data_vars.items():
        dims, values = ["time", *variable.dims[1:]], variable.values
        if name in SPLIT_VARIABLES:
            suffix = "/s" if name in ("error_rate", "task_velocity") else ""
            placed = name == "task_position"
            first, angular = (kind.end, kind.units[0]) if placed else (6, "rad")
            parts = (values[:, :3], values[:, 3:first], values[:, first:].reshape(len(values), *rows))
            axes = (("axis",), ("quaternion" if first > 6 else "angle",), by_joint)
            units = ("m", angular, kinds.copy().pop() if len(kinds) == 1 else "")
            for part, key, axis, unit in zip(parts, SPLIT_VARIABLES[str(name)], axes, units, strict=True):
                meaning = key.replace("_", " ")
                found[key] = (("time", *axis), part, {"units": unit + suffix, "long_name": meaning})
            continue
        if name == "joint_torque":
            dims, values = ["time", *by_joint], values.reshape(len(values), *rows)
        elif values.ndim == 2 and values.shape[1] == truss.rigid:
            dims = ["time", "coordinate"]
        found[name] = (dims, values, variable.attrs)
    labels = [*AXES, *kind.task_labels]
    labels += [f"theta_{i + 1}_{j + 1}" for i, joints in enumerate(each) for j in range(joints)]
    if kind != EULER:
        found = found.assign_coords(quaternion=list(kind.labels))
    return found.assign_coords(
        robot=np.arange(1, truss.robots + 1),
        axis=list(AXES),
        angle=list(kind.task_labels),
        joint=np.arange(1, each[0] + 1) if alike else labels[6:],
        mode=np.arange(1, truss.modes + 1),
        coordinate=labels,
    )


def _warn_of_joints(angles: Vector, truss: SpaceTruss) -> None:
    """Warn of joints beyond their limits, which the equations of motion ignore."""
    owners = [f"robot {k + 1}" for k, arm in enumerate(truss.dynamics.arms) for _ in arm.joint_data]
    beyond = [
        f"{joint.name!r} of {owner} moves {far:.2g} {joint.unit} beyond its limits"
        for joint, owner, low, high in zip(
            truss.dynamics.joint_data, owners, angles.min(axis=0), angles.max(axis=0), strict=True
        )
        if (far := max(joint.lower - low, high - joint.upper)) > JOINT_LIMIT_TOLERANCE
    ]
    if beyond:
        warn(f"joint {', '.join(beyond)}; there are no end stops: choose other rest angles or another path")
