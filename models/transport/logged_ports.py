"""Logged ports of a transport run."""

from __future__ import annotations

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port

TRUSS_PORTS = (
    "task_position",
    "task_velocity",
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
    """Return the ports to log, keyed by their names in the result."""
    truss, law, model = diagram.blocks["truss"], diagram.blocks["controller"], diagram.blocks.get("model")
    ports = {name: truss.port(name) for name in TRUSS_PORTS}
    if model is None:  # the mean-axes law has no errors of the truss frame
        trajectory = diagram.blocks["trajectory"]
        references = {"reference": "position", "reference_rate": "velocity"}
        return ports | {name: trajectory.port(port) for name, port in references.items()}
    ports |= {name: law.port(name) for name in ("error", "error_rate")}
    if "sliding_variable" in law.ports:
        ports["sliding_variable"] = law.port("sliding_variable")
        ports["generalized_force"] = model.port("generalized_force")
    else:
        ports["generalized_force"] = model.port("transformed_task_force")
    # Without an observer the input of the model has its default, zero.
    ports["disturbance_estimate"] = model.port("disturbance_estimate")
    return ports
