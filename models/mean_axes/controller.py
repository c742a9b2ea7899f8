"""Mean-axes controller as one diagram."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.arithmetic import Operation
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.support.types import Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.actuator_costs import ActuatorCosts
from trussflow.models.mean_axes.allocation import MeanAxesAllocation
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesEstimator
from trussflow.models.mean_axes.excitation import ActuatorExcitation
from trussflow.models.mean_axes.fault_detection import FaultDetection
from trussflow.models.mean_axes.law import MeanAxesLaw
from trussflow.models.mean_axes.slowdown import PathSlowdown
from trussflow.models.mean_axes.validity import CommandHold, MeasurementGate


def mean_axes_controller(
    believed: TrussDynamics,
    limits: Vector,
    design: MeanAxesDesign | None = None,
    start: Vector | None = None,
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

    Returns
    -------
    Diagram
        Diagram ``mean-axes controller``. Inputs: measured position and velocity; reference_position,
        reference_velocity and reference_acceleration; actuation, the actuation of healthy actuators within
        their limits. Optional inputs: valid, 1 if the measured pose is valid; servo_torque, the mean torques
        of joint servos in the last sample, which the fault detection needs; the propellant used by each base
        and the momentum of its wheels, to reduce both. Outputs: command; command_valid, 0 while the last
        finite command is held; missed; share, the available share of the path's acceleration (`PathSlowdown`);
        effectiveness; held, 1 for joints of arms that do not follow their drives; unexplained; outage, the time
        without an accepted pose; mean_position, mean_speeds, modal_coordinate and disturbance.

    Raises
    ------
    ModelError
        If the truss has fewer modes than the design needs.
    ParameterError
        If a limit is not positive.
    """
    design = MeanAxesDesign.shipped() if design is None else design
    controller = Diagram("mean-axes controller")
    monitor = FaultDetection(believed, design)
    (gate, estimator, law, allocation, left, economy, probe, _, hold, slowdown) = (
        controller.add(
            gate=MeasurementGate(believed, design),
            estimator=MeanAxesEstimator(believed, design, start),
            law=MeanAxesLaw(believed, design),
            allocation=MeanAxesAllocation(believed, limits, design),
            left=Operation(np.multiply).sampled(design.sample_time),
            economy=ActuatorCosts(believed, limits, design),
            probe=ActuatorExcitation(believed, design, monitor),
            monitor=monitor,
            hold=CommandHold(believed, design),
            slowdown=PathSlowdown(believed, limits, design),
        )
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
    for name in ("mean_position", "mean_speeds"):
        estimator.port(name) >> gate.port(name)
    for block in (estimator, monitor):
        gate.checked_position >> block.position
        gate.checked_velocity >> block.velocity
    monitor.effectiveness >> allocation.effectiveness
    monitor.effectiveness >> left.u1
    left.y >> estimator.actuation
    probe.probe >> allocation.probe
    allocation.command >> hold.request
    allocation.missed >> slowdown.missed
    economy.price >> allocation.price
    economy.preferred >> allocation.preferred
    controller.expose(
        position=gate.position,
        velocity=gate.velocity,
        valid=gate.valid,
        actuation=(left.u2, monitor.actuation),
        servo_torque=monitor.servo_torque,
        reference_position=law.reference_position,
        reference_velocity=law.reference_velocity,
        reference_acceleration=law.reference_acceleration,
        propellant=economy.propellant,
        momentum=economy.momentum,
        command=hold.command,
        command_valid=hold.command_valid,
        outage=gate.outage,
        missed=allocation.missed,
        share=slowdown.share,
        mean_position=estimator.mean_position,
        mean_speeds=estimator.mean_speeds,
        modal_coordinate=estimator.modal_coordinate,
        disturbance=estimator.disturbance,
        effectiveness=monitor.effectiveness,
        held=monitor.held,
        unexplained=monitor.unexplained,
    )
    return controller
