"""The controller of the mean axes as one block of blocks."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.sum import Sum
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.library.allocation import WeightedAllocation
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesEstimator
from trussflow.models.mean_axes.law import MeanAxesLaw


def mean_axes_controller(
    believed: TrussDynamics,
    weights: Vector,
    design: MeanAxesDesign | None = None,
    start: Vector | None = None,
) -> Diagram:
    """Wire estimator, law and allocation to a controller: from measurements to actuator commands.

    Parameters
    ----------
    believed : TrussDynamics
        What the controller believes the plant to be.
    weights : Vector, shape (actuators,)
        Cost of each actuator, as `WeightedAllocation` takes it; see `Mission.actuator_weights` [-].
    design : MeanAxesDesign, optional
        By default the shipped one.
    start : Vector, optional
        Rigid coordinates at the start [m, rad]; by default those at rest.

    Returns
    -------
    Diagram
        With the inputs position, velocity (measured), reference_position, reference_velocity,
        reference_acceleration and actuation, which takes what acts on the plant from one sample to
        the next: the command itself, or what limits and failures leave of it; and the outputs
        command and those of the estimator. The diagram is named ``mean-axes controller``.

    Raises
    ------
    ModelError
        If the truss has fewer modes than the design needs.
    """
    design = MeanAxesDesign.shipped() if design is None else design
    controller = Diagram("mean-axes controller")
    estimator, law = controller.add(
        estimator=MeanAxesEstimator(believed, design, start), law=MeanAxesLaw(believed, design)
    )
    torque = np.zeros(believed.actuators, dtype=bool)
    torque[: 6 * len(believed.arms)] = np.tile([False] * 3 + [True] * 3, len(believed.arms))
    slow, fast = controller.add(
        slow_allocation=WeightedAllocation(
            law.rigid,
            np.where(torque, design.slow_torque_weight, 1.0) * weights,
            demand_unit=law.force_units,
            command_unit=law.actuator_units,
        ).sampled(design.sample_time),
        fast_allocation=WeightedAllocation(
            law.demands,
            np.where(torque, design.torque_weight, 1.0) * weights,
            command_unit=law.actuator_units,
        ).sampled(design.sample_time),
    )
    for name in ("mean_position", "mean_speeds", "modal_rate", "joint_angles", "disturbance"):
        getattr(estimator, name) >> getattr(law, name)
    law.slow_force >> slow.demand
    law.actuation_matrix >> slow.effectiveness
    law.fast_force >> fast.demand
    law.neutral_matrix >> fast.effectiveness
    total = controller.add(total=Sum("++").sampled(design.sample_time))
    slow.command >> total.u1
    fast.command >> total.u2
    inputs = {"position": estimator, "velocity": estimator, "actuation": estimator}
    inputs |= dict.fromkeys(("reference_position", "reference_velocity", "reference_acceleration"), law)
    outputs = ("mean_position", "mean_speeds", "modal_coordinate", "disturbance")
    for name, block in (inputs | dict.fromkeys(outputs, estimator)).items():
        controller.expose(**{name: block.port(name)})
    controller.expose(command=total.y)
    return controller
