"""Closed loop of truss and mean-axes controller for a transport mission."""

from __future__ import annotations

from dataclasses import replace

from trussflow.blocks.control.trajectory import Trajectory
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.mean_axes.controller import mean_axes_controller
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.nominal_model import TaskErrors
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import compare, path_of, with_hardware


def mean_axes_transport(
    mission: Mission,
    truss: SpaceTruss,
    *,
    design: MeanAxesDesign | None = None,
    believed: TrussDynamics | None = None,
    hardware: Hardware | None = None,
    seed: int = 0,
    path: Trajectory | None = None,
) -> Diagram:
    """Return the closed loop of plant, trajectory and mean-axes controller, without measurement of the modes.

    Parameters
    ----------
    mission : Mission
        Displacement and duration; its gains are not used.
    truss : SpaceTruss
        Plant.
    design : MeanAxesDesign, optional
        Design parameters of the controller, by default the shipped ones.
    believed : TrussDynamics, optional
        Nominal dynamics of the controller, with the same robots and enough modes for the design. By default
        the dynamics of the plant.
    hardware : Hardware, optional
        Hardware between controller and truss. By default there are only the delay of one sample time and the
        limits of `Hardware.flight` with gearless joints. The delay of the hardware includes this sample time.
    seed : int
        Seed of the sensor noise, zero or positive [1].
    path : Trajectory, optional
        Path of all rigid coordinates, for example by `trussflow.models.feasibility.fastest`, with the sample
        time of the controller. By default the path of the mission.

    Returns
    -------
    Diagram
        Diagram with the blocks trajectory, controller, truss, errors of the truss frame and, with hardware,
        actuators and sensors. The optional input `share` of the mission's path scales its acceleration under
        way (see `RetimedQuintic`).

    Raises
    ------
    ModelError
        If `believed` has other robots, or the hardware has another sample time or a smaller delay than the
        design.
    """
    design = MeanAxesDesign.shipped() if design is None else design
    believed = replace(believed or truss.dynamics, attitude=truss.dynamics.attitude)
    if believed.rigid_freedoms != truss.rigid:
        raise ModelError(
            f"cannot control a truss of {truss.rigid} rigid coordinates by a model of "
            f"{believed.rigid_freedoms}; the model must have the same robots"
        )
    given = (
        path_of(mission, truss, design.sample_time)
        if path is None
        else path.sampled(design.sample_time)
    )
    diagram = Diagram("transport by mean axes")
    trajectory, controller = diagram.add(
        trajectory=given,
        controller=mean_axes_controller(
            believed,
            (hardware or Hardware.flight(control="torque")).limits(truss),
            design,
            truss.start_position,
        ),
    )
    diagram.add(truss=truss, errors=TaskErrors(truss.dynamics))
    compare(diagram.errors, trajectory, truss)
    for name in ("position", "velocity", "acceleration"):
        trajectory.port(name) >> controller.port(f"reference_{name}")
    seen: Block = truss
    acting, ordered = truss.actuation, controller.command
    if hardware is not None:
        hold = design.sample_time
        if hardware.sample_time != hold or hardware.delay < hold:
            raise ModelError(
                f"the hardware has a sample time of {hardware.sample_time} s and a delay of {hardware.delay} "
                f"s, the controller a sample time of {hold} s: the sample times must be equal, and the delay "
                "not less"
            )
        hardware = replace(hardware, delay=hardware.delay - hold)
        actuators, seen = with_hardware(diagram, truss, hardware, seed)
        acting, ordered = actuators.command, actuators.ordered
        actuators.propellant >> controller.propellant
        for name in ("momentum", "servo_torque"):
            if name in actuators.ports:
                actuators.port(name) >> controller.port(name)
    seen.task_position >> controller.position
    seen.rigid_speeds >> controller.velocity
    controller.command >> acting
    ordered >> controller.actuation
    return diagram
