"""Logged signals of a mission, and the range in which the equations of motion hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.support.call_site import warn
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.truss.truss_modes import LINEAR_LIMIT

if TYPE_CHECKING:
    import xarray as xr

JOINT_LIMIT_TOLERANCE = 1e-3
"""Tolerance of joint limits, at which a joint may rest [rad or m]."""

TRUSS_PORTS = (
    "modal_coordinate",
    "modal_rate",
    "grasp_displacement",
    "base_force",
    "base_torque",
    "joint_torque",
    "disturbance",
    "energy",
)


def logged(diagram: Diagram) -> dict[str, Port]:
    """Return the ports to log, keyed by their names in the result.

    Vectors of all task coordinates are split into position, attitude and joints. With a quaternion the errors
    and rates of the attitude are small rotations and angular velocities about the axes of the truss.

    Parameters
    ----------
    diagram : Diagram
        Closed loop of a mission.
    """
    truss, errors, law = (
        diagram.blocks[name] for name in ("truss", "errors", "controller")
    )
    model = diagram.blocks.get("model")
    ports: dict[str, Port] = {}
    for port, position, attitude, joints in (
        (truss.task_position, "position", "attitude", "joint_angle"),
        (truss.task_velocity, "velocity", "attitude_rate", "joint_rate"),
        (errors.error, "position_error", "attitude_error", "joint_error"),
        (
            errors.error_rate,
            "position_error_rate",
            "attitude_error_rate",
            "joint_error_rate",
        ),
    ):
        end = port.size - truss.joints
        ports |= {position: port[:3], attitude: port[3:end]}
        if truss.joints:
            ports[joints] = port[end:]
    ports |= {name: truss.port(name) for name in TRUSS_PORTS}
    if model is None:  # the mean-axes law has no nominal model of the rigid motion
        return ports
    force = "transformed_task_force"
    if "sliding_variable" in law.ports:
        force, ports["sliding_variable"] = "generalized_force", law.sliding_variable
    # Without an observer the input of the model has its default, zero.
    return ports | {
        "generalized_force": model.port(force),
        "disturbance_estimate": model.disturbance_estimate,
    }


def check_run(result: xr.Dataset, truss: SpaceTruss) -> xr.Dataset:
    """Return a result with its `deflection`, and warn if it exceeds the range of the equations of motion.

    Parameters
    ----------
    result : xarray.Dataset
        Result with the signals of `logged`.
    truss : SpaceTruss
        Plant of the run.

    Returns
    -------
    xarray.Dataset
        Result with the attribute `deflection`, that of `TrussModes.deflection` [-]. A deflection above
        `LINEAR_LIMIT`, or a joint beyond its limits, causes a `SimulationWarning`.
    """
    bent = truss.dynamics.modes.deflection(result["modal_coordinate"].values)
    if bent > LINEAR_LIMIT:
        warn(
            f"the truss bends by {bent:.2g} of its size or rad; above {LINEAR_LIMIT} the errors of linear "
            "shapes exceed 1 %, without foreshortening: do not rely on the results; reduce the forces"
        )
    beyond = []
    arms = enumerate(truss.dynamics.arms, 1)
    owners = [(robot, joint) for robot, arm in arms for joint in arm.joint_data]
    for i, (robot, joint) in enumerate(owners):
        angle = result["joint_angle"].values[:, i]
        far = max(joint.lower - angle.min(), angle.max() - joint.upper)
        if far > JOINT_LIMIT_TOLERANCE:
            beyond.append(
                f"{joint.name!r} of robot {robot} moves {far:.2g} {joint.unit} beyond its limits"
            )
    if beyond:
        warn(
            f"joint {', '.join(beyond)}; there are no end stops: choose other rest angles or another path"
        )
    return result.assign_attrs(deflection=bent)
