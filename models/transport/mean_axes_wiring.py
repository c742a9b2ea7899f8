"""The loop of the mean axes around a truss: a transport as it can be flown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trussflow.blocks.control.trajectory import Trajectory
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.library.algebra import Function
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.mean_axes.controller import mean_axes_controller
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import path_of, with_hardware
from trussflow.models.validation import frozen_array


def mean_axes_transport(
    mission: Mission,
    truss: SpaceTruss,
    *,
    design: MeanAxesDesign | None = None,
    believed: TrussDynamics | None = None,
    hardware: Hardware | None = None,
    shares: Vector | None = None,
    seed: int = 0,
    path: Trajectory | None = None,
) -> Diagram:
    """Wire plant, trajectory, and the controller of the mean axes, which sees root and joints only.

    Parameters
    ----------
    mission : Mission
        Where to; gains and weights are those of the source's laws.
    truss : SpaceTruss
        The plant.
    design : MeanAxesDesign, optional
        By default the shipped one.
    believed : TrussDynamics, optional
        What the controller believes the plant to be: the same robots, and any number of modes that the design
        can do with. By default the plant's own dynamics.
    hardware : Hardware, optional
        What lies between controller and truss; by default nothing but the sample time that the controller
        takes to compute, and the limits of `Hardware.flight`. That time is part of the hardware's delay.
    shares : Vector, shape (robots,), optional
        What is left of the path's peak acceleration when the base of each robot is dead, above 0 [1]; see
        `trussflow.models.feasibility.shares_left`. When the monitor finds one dead, the path becomes that
        slow, where the share is below 1; by default it stays as it is.
    seed : int
        Which noise the sensors have, at least 0 [1].
    path : Trajectory, optional
        Of all rigid coordinates, such as `trussflow.models.feasibility.fastest` returns; sampled as the
        controller is. By default that of the mission.

    Returns
    -------
    Diagram
        With blocks named trajectory, controller, truss, and, if there is hardware, actuators and sensors. The
        input `share` of the mission's path may stay open; wired to what is left of its acceleration after a
        failure, it makes the path slower under way (see `RetimedQuintic`).

    Raises
    ------
    ModelError
        If `believed` has other robots, the hardware another sample time or less delay than the design, or
        there are shares beside a path that is not the mission's.
    """
    design = MeanAxesDesign.shipped() if design is None else design
    believed = replace(believed or truss.dynamics, attitude=truss.dynamics.attitude)
    if believed.rigid_freedoms != truss.rigid:
        raise ModelError(
            f"cannot control a truss of {truss.rigid} rigid coordinates by a model of "
            f"{believed.rigid_freedoms}; the model must have the same robots"
        )
    given = path_of(mission, truss, design.sample_time) if path is None else path.sampled(design.sample_time)
    diagram = Diagram(f"{mission.name} by its mean axes")
    trajectory, controller = diagram.add(
        trajectory=given,
        controller=mean_axes_controller(
            believed,
            (hardware or Hardware.flight()).limits(truss),
            design,
            truss.parameters["initial_coordinates"][: truss.rigid_q],
        ),
    )
    diagram.add(truss=truss)
    for name in ("position", "velocity", "acceleration"):
        trajectory.port(name) >> controller.port(f"reference_{name}")
    if shares is not None:
        if path is not None:
            raise ModelError("shares make the mission's own path slower; leave them, or the path, out")
        each = frozen_array("transport by mean axes: shares", shares, (truss.robots,))

        def smallest(effectiveness: Array) -> Array:
            return np.min(np.where(effectiveness[: 6 * truss.robots : 6] < 1.0, each, 1.0))

        left = diagram.add(
            left=Function(smallest, {"effectiveness": Input(truss.actuators)}, {"share": Output()})
        )
        controller.effectiveness >> left.effectiveness
        left.share >> trajectory.share
    if hardware is None:
        truss.task_position >> controller.position
        truss.rigid_speeds >> controller.velocity
        controller.command >> truss.actuation
        controller.command >> controller.actuation
        return diagram
    if hardware.sample_time != design.sample_time or hardware.delay < design.sample_time:
        raise ModelError(
            f"the hardware takes a command every {hardware.sample_time} s and {hardware.delay} s after the "
            f"measurements, the controller computes it in {design.sample_time} s: the first must be the same "
            "time, and the second not less"
        )
    hardware = replace(hardware, delay=hardware.delay - design.sample_time)
    actuators, sensors = with_hardware(diagram, truss, hardware, seed)
    sensors.task_position >> controller.position
    sensors.rigid_speeds >> controller.velocity
    controller.command >> actuators.command
    actuators.ordered >> controller.actuation
    actuators.propellant >> controller.propellant
    if "momentum" in actuators.ports:
        actuators.momentum >> controller.momentum
    return diagram
