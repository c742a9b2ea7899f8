"""What a transport run logs."""

from __future__ import annotations

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port

TRUSS = (
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
    """Return the ports to log, by the names they have in the result."""
    truss, law, model = diagram.blocks["truss"], diagram.blocks["controller"], diagram.blocks.get("model")
    ports = {name: truss.port(name) for name in TRUSS}
    if model is None:  # the law of the mean axes sees no errors of the truss itself
        trajectory = diagram.blocks["trajectory"]
        references = {"reference": "position", "reference_rate": "velocity"}
        return ports | {name: trajectory.port(port) for name, port in references.items()}
    ports |= {name: law.port(name) for name in ("error", "error_rate")}
    if "sliding_variable" in law.ports:
        ports["sliding_variable"] = law.port("sliding_variable")
        ports["generalized_force"] = model.port("generalized_force")
    else:
        ports["generalized_force"] = model.port("transformed_task_force")
    # Without an observer the law uses an estimate of zero, which the model's input then reads.
    ports["disturbance_estimate"] = model.port("disturbance_estimate")
    return ports
