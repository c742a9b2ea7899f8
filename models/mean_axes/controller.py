"""Mean-axes controller as one diagram."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.arithmetic import Operation
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.actuator_costs import ActuatorCosts
from trussflow.models.mean_axes.allocation import MeanAxesAllocation
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesEstimator
from trussflow.models.mean_axes.excitation import ActuatorExcitation
from trussflow.models.mean_axes.fault_detection import FaultDetection
from trussflow.models.mean_axes.law import MeanAxesLaw


def mean_axes_controller(
    believed: TrussDynamics,
    limits: Vector,
    design: MeanAxesDesign | None = None,
    start: Vector | None = None,
    *,
    held_joints: bool = False,
) -> Diagram:
    """Return the mean-axes controller: estimator, law, allocation, fault detection and excitation.

    Parameters
    ----------
    believed : TrussDynamics
        Nominal dynamics of the controller.
    limits : Vector, shape (actuators,)
        Limit of each actuator in either direction, positive [N, N·m].
    design : MeanAxesDesign, optional
        Design parameters, by default the shipped ones.
    start : Vector, optional
        Rigid coordinates at the start [m, rad]; by default those at rest.
    held_joints : bool
        Whether joints with failed drives are held, by power-off brakes, instead of free.

    Returns
    -------
    Diagram
        Diagram ``mean-axes controller``. Inputs: measured position and velocity; reference_position,
        reference_velocity and reference_acceleration; actuation, the actuation of healthy actuators within
        their limits, which the fault detection needs; optionally the propellant used by each base and the
        momentum of its wheels, to reduce both. Outputs: command, missed, effectiveness, mean_position,
        mean_speeds, modal_coordinate and disturbance.

    Raises
    ------
    ModelError
        If the truss has fewer modes than the design needs.
    ParameterError
        If a limit is not positive.
    """
    design = MeanAxesDesign.shipped() if design is None else design
    controller = Diagram("mean-axes controller")
    monitor = FaultDetection(believed, design, held_joints)
    estimator, law, allocation, left, economy, probe, _ = controller.add(
        estimator=MeanAxesEstimator(believed, design, start),
        law=MeanAxesLaw(believed, design),
        allocation=MeanAxesAllocation(believed, limits, design),
        left=Operation(np.multiply).sampled(design.sample_time),
        economy=ActuatorCosts(believed, limits, design),
        probe=ActuatorExcitation(believed, design, monitor),
        monitor=monitor,
    )
    for name in (
        "mean_position",
        "mean_speeds",
        "modal_rate",
        "joint_angles",
        "disturbance",
    ):
        estimator.port(name) >> law.port(name)
    for port in law.outputs():
        port >> allocation.port(port.name)
    estimator.disturbance >> monitor.disturbance
    effectiveness = monitor.effectiveness
    if held_joints:
        # A brake makes the torque that a healthy drive would make to hold its joint.
        held = np.where(np.arange(limits.size) < 6 * len(believed.arms), 0.0, 1.0)
        acting = controller.add(
            acting=Function(
                lambda health: np.maximum(health, held),
                {"health": Input(limits.size)},
                {"y": Output(limits.size)},
            ).sampled(design.sample_time)
        )
        effectiveness >> acting
        effectiveness = acting.y
    effectiveness >> allocation.effectiveness
    effectiveness >> left.u1
    left.y >> estimator.actuation
    probe.probe >> allocation.probe
    economy.price >> allocation.price
    economy.preferred >> allocation.preferred
    controller.expose(
        position=(estimator.position, monitor.position),
        velocity=(estimator.velocity, monitor.velocity),
        actuation=(left.u2, monitor.actuation),
        reference_position=law.reference_position,
        reference_velocity=law.reference_velocity,
        reference_acceleration=law.reference_acceleration,
        propellant=economy.propellant,
        momentum=economy.momentum,
        command=allocation.command,
        missed=allocation.missed,
        mean_position=estimator.mean_position,
        mean_speeds=estimator.mean_speeds,
        modal_coordinate=estimator.modal_coordinate,
        disturbance=estimator.disturbance,
        effectiveness=monitor.effectiveness,
    )
    return controller
