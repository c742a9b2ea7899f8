"""Closed loop of a mission with the control laws of the paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trussflow.blocks.control.allocation import WeightedAllocation
from trussflow.blocks.control.disturbance_observer import DisturbanceObserver
from trussflow.blocks.control.pd import PD
from trussflow.blocks.control.sliding_mode import (
    ConventionalSlidingMode,
    IntegralSlidingMode,
)
from trussflow.blocks.control.time_scaling import RetimedQuintic
from trussflow.blocks.control.trajectory import Quintic, Trajectory
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.units import Unit
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.geometry.attitude import EULER
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.plant.nominal_model import NominalModel, TaskErrors
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.slew import RetimedSlew, Slew
from trussflow.models.validation import check_choice

CONTROLLERS = ("ismc", "smc", "pd")
ALLOCATIONS = ("published", "mode-neutral")


def transport_diagram(
    mission: Mission,
    truss: SpaceTruss,
    *,
    controller: str = "ismc",
    observer: bool | None = None,
    allocation: str | None = None,
    believed: TrussDynamics | None = None,
    hardware: Hardware | None = None,
    seed: int = 0,
    path: Trajectory | None = None,
) -> Diagram:
    """Return the closed loop of plant, trajectory, controller, observer, nominal model and allocation.

    Parameters
    ----------
    mission : Mission
        Displacement, duration and gains.
    truss : SpaceTruss
        Plant. With modal actuation the diagram has an equal plant with the wire ``modal_demand >>
        modal_force``, at which the modal loop can be opened: use ``diagram.truss``.
    controller : str
        ``"ismc"``, the law of the paper; ``"smc"`` and ``"pd"``, its comparisons.
    observer : bool, optional
        Whether to use a disturbance observer; by default with ``"ismc"`` only. PD never uses it.
    allocation : str, optional
        ``"published"``: Eq. 64. ``"mode-neutral"``: feedback without work on the modes. With the
        published one the loop is unstable if the actuators do work on the modes. The default depends
        on the plant; PD always has Eq. 64.
    believed : TrussDynamics, optional
        Nominal dynamics of the controller, with the same robots and no more modes. By default the
        dynamics of the plant.
    hardware : Hardware, optional
        Hardware between controller and truss, by default none. The controller uses the exact modal
        coordinates, although no sensor measures them.
    seed : int
        Seed of the sensor noise, zero or positive [1].
    path : Trajectory, optional
        Path of all rigid coordinates; by default that of the mission.

    Returns
    -------
    Diagram
        Diagram with the blocks trajectory, errors, controller, model and truss. Optional blocks are observer,
        actuators and sensors (with hardware). The allocation is the block allocation or, if mode-neutral,
        feedforward_allocation and feedback_allocation.

    Raises
    ------
    ModelError
        If controller or allocation is unknown, or `believed` has other robots or more modes than the
        plant.
    """
    if allocation is None:
        allocation = "mode-neutral" if truss.modal_actuation else "published"
    if observer is None:
        observer = controller == "ismc"
    check_choice("controller", controller, CONTROLLERS)
    check_choice("allocation", allocation, ALLOCATIONS)
    believed = replace(believed or truss.dynamics, attitude=truss.dynamics.attitude)
    if believed.rigid_freedoms != truss.rigid or believed.freedoms > truss.n:
        raise ModelError(
            f"cannot control a truss of {truss.rigid} rigid coordinates and {truss.modes} modes by "
            f"a model of {believed.rigid_freedoms} and {believed.modes.modes}; the model must "
            "have the same robots and no more modes"
        )
    diagram = Diagram("transport")
    trajectory, errors, law, model = diagram.add(
        trajectory=path_of(mission, truss) if path is None else path,
        errors=TaskErrors(truss.dynamics),
        controller=control_law(mission, controller, unit=truss.task_units),
        model=NominalModel(believed),
    )
    if truss.modal_actuation:
        truss = diagram.add("truss", truss.changed(modal_actuation=False))
        truss.modal_demand >> truss.modal_force
    else:
        diagram.add(truss=truss)
    seen: Block = truss
    acting = truss.actuation
    if hardware is not None:
        actuators, seen = with_hardware(diagram, truss, hardware, seed)
        acting = actuators.command
    seen.task_position >> model.coordinates[: truss.rigid_q]
    seen.rigid_speeds >> model.speeds[: truss.rigid]
    if modes := believed.modes.modes:  # the first modes of the plant
        truss.modal_coordinate[:modes] >> model.coordinates[truss.rigid_q :]
        truss.modal_rate[:modes] >> model.speeds[truss.rigid :]
    compare(errors, trajectory, seen)
    errors.error >> law.position
    errors.error_rate >> law.velocity
    diagram.ground(law.reference_position, law.reference_velocity)
    if controller == "pd":
        law.force >> model.task_force
        demand = model.transformed_task_force
    else:
        errors.acceleration >> law.reference_acceleration
        law.feedforward >> model.feedforward
        law.feedback >> model.feedback
        demand = model.generalized_force
    if observer and controller != "pd":
        estimator = diagram.add(
            observer=DisturbanceObserver(
                mission.observer_bandwidth, unit=truss.task_units
            )
        )
        seen.rigid_speeds >> estimator.velocity
        model.nominal_acceleration >> estimator.nominal_acceleration
        estimator.disturbance_estimate >> model.disturbance_estimate
    weights = mission.actuator_weights(truss.robots, truss.joints)
    if allocation == "published" or controller == "pd":
        sharing = diagram.add(
            allocation=WeightedAllocation(
                truss.rigid, weights, command_unit=truss.actuator_units
            )
        )
        demand >> sharing.demand
        model.actuation_matrix >> sharing.effectiveness
        sharing.command >> acting
        return diagram
    # There are more actuators than coordinates and modes, so that the feedback can be allocated as
    # [u_fb; 0] by the full P_Q, without work on the modes. For the feedforward this would need much
    # larger base torques, so that it is allocated by Eq. 64.
    ahead, back = diagram.add(
        feedforward_allocation=WeightedAllocation(
            truss.rigid, weights, command_unit=truss.actuator_units
        ),
        feedback_allocation=WeightedAllocation(
            model.n, weights, command_unit=truss.actuator_units
        ),
    )
    model.feedforward_force >> ahead.demand
    model.actuation_matrix >> ahead.effectiveness
    model.feedback_force >> back.demand[: truss.rigid]
    diagram.ground(back.demand[truss.rigid :])
    model.full_actuation_matrix >> back.effectiveness
    ahead.command + back.command >> acting
    return diagram


def compare(errors: TaskErrors, trajectory: Trajectory, measured: Block) -> None:
    """Connect the trajectory and the measured task position and velocity to the task errors.

    Parameters
    ----------
    errors : TaskErrors
        Block of the errors.
    trajectory : Trajectory
        Reference.
    measured : Block
        Plant or sensors.
    """
    for name in ("position", "velocity", "acceleration"):
        trajectory.port(name) >> errors.port(f"reference_{name}")
    measured.task_position >> errors.position
    measured.task_velocity >> errors.velocity


def path_of(
    mission: Mission, truss: SpaceTruss, sample_time: float | None = None
) -> Quintic:
    """Return the path of a mission from the initial position of the truss.

    Parameters
    ----------
    mission : Mission
        Displacement and duration.
    truss : SpaceTruss
        Plant with the initial coordinates.
    sample_time : float, optional
        Sample time of the input `share`, which slows down the path under way [s]; by default the path has no
        such input.
    """
    start = truss.start_position
    way, times = mission.displacement(truss.rigid), [mission.duration]
    times += [] if sample_time is None else [sample_time]
    if truss.dynamics.attitude != EULER:
        return (Slew if sample_time is None else RetimedSlew)(truss, way, *times)
    kind = Quintic if sample_time is None else RetimedQuintic
    return kind(way, *times, start=start, unit=truss.task_units)


def with_hardware(
    diagram: Diagram, truss: SpaceTruss, hardware: Hardware, seed: int
) -> tuple[Diagram, Diagram]:
    """Add actuators and sensors to a diagram, connect them to its truss, and return them.

    Parameters
    ----------
    diagram : Diagram
        Diagram with the truss.
    truss : SpaceTruss
        Plant.
    hardware : Hardware
        Hardware between controller and truss.
    seed : int
        Seed of the sensor noise, zero or positive [1].

    Raises
    ------
    ModelError
        If the plant has not the reflected inertia of the drives.
    """
    dynamics = truss.dynamics
    inertias = [joint.inertia for joint in dynamics.joint_data]
    if not np.array_equal(inertias, hardware.drive_inertias(dynamics)):
        raise ModelError(
            "the plant has not the reflected inertia of the drives; use hardware.mounted(truss) as the plant"
        )
    actuators, sensors = diagram.add(
        actuators=hardware.actuators(truss, seed=seed),
        sensors=hardware.sensors(truss, seed=seed),
    )
    truss.coordinates >> sensors.coordinates
    truss.speeds >> sensors.speeds
    if truss.joints:
        truss.rigid_speeds[6:] >> actuators.joint_rates
    if "joint_reference" in actuators.ports:
        joints, trajectory = truss.dynamics.attitude.end, diagram.blocks["trajectory"]
        truss.task_position[joints:] >> actuators.joint_angles
        trajectory.position[joints:] >> actuators.joint_reference
        trajectory.velocity[6:] >> actuators.joint_reference_rate
    if "rates" in actuators.ports:
        truss.actuator_rates >> actuators.rates
    actuators.actuation >> truss.actuation
    return actuators, sensors


def control_law(
    mission: Mission, controller: str, *, unit: Unit = None
) -> IntegralSlidingMode | ConventionalSlidingMode | PD:
    """Return a controller with the gains of a mission.

    Parameters
    ----------
    mission : Mission
        Mission with the gains.
    controller : str
        ``"ismc"``, ``"smc"`` or ``"pd"``.
    unit : str, tuple of str or None
        Unit of the position, or one per element; None disables the check.
    """
    if controller == "pd":
        return PD(mission.proportional_gain, mission.derivative_gain, unit=unit)
    if controller == "smc":
        gain = mission.conventional_switching_gain
        return ConventionalSlidingMode(slope=mission.surface_slope, eta=gain, unit=unit)
    return IntegralSlidingMode(
        gamma=mission.rate_gain,
        mu=mission.error_gain,
        beta=mission.exponent,
        eta=mission.switching_gain,
        sigma=mission.reaching_gain,
        boundary_layer=mission.boundary_layer,
        unit=unit,
    )
