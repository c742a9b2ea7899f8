"""Faults of actuators and sensors as parameters of a loop, and the faults of the report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from study_tools.data_files import data_beside

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.models.hardware.hardware import Hardware
from trussflow.models.plant.space_truss import SpaceTruss

FAULTS = data_beside(__file__, "faults.toml")
"""Faults of the report by kind, and default values."""

TIMES = (10.0, 30.0, 50.0)
"""Times of the faults: acceleration, coasting, braking [s]."""

FEASIBLE: dict[tuple[str, int], tuple[int, ...]] = {
    ("literal", 1): (1, 2, 3),
    ("literal", 2): (1, 2),
    ("jaco", 1): (1, 2, 3),
    ("jaco", 2): (),
}
"""Numbers of the robots without whose bases a case is feasible, by arm and case."""

VALVE_AXES = (2, 0, 1)
"""Axis of the force by an open valve, by the number of the time."""


class Faults(Block):
    """Effects of a fault between two times on bases, joint drives, valves and measurements; sampled.

    Parameters
    ----------
    truss : SpaceTruss
        Plant.
    sample_time : float
        Sample time [s].
    """

    measured_position = Input("rigid", meaning="position by the sensors")
    measured_rates = Input("rigid", meaning="rates by the sensors")
    position = Output("rigid", meaning="position for the controller")
    rates = Output("rigid", meaning="rates for the controller")
    valid = Output(meaning="0 if the pose is marked as invalid, otherwise 1")
    base_effect = Output("robots", meaning="share of its effect that each base has")
    drive_effect = Output("joints", meaning="share of its effect that each drive has")
    valves = Output("actuators", meaning="forces by open valves, otherwise 0")
    request = Input("actuators", meaning="commands of the controller")
    command = Output("actuators", meaning="commands for the actuators")
    last_position = State("rigid", meaning="position at the sample before")
    last_rates = State("rigid", meaning="rates at the sample before")
    last_request = State("actuators", meaning="commands at the sample before")
    older_request = State("actuators", meaning="commands two samples before")
    begin = Parameter(unit="s", meaning="begin of the fault")
    end = Parameter(unit="s", meaning="end of the fault")
    bases = Parameter(shape="robots", minimum=0.0, meaning="effects of the bases")
    drives = Parameter(shape="joints", minimum=0.0, meaning="effects of the drives")
    forces = Parameter(shape="actuators", meaning="forces by open valves")
    bias = Parameter(shape="rigid", meaning="error of the measured position")
    stuck = Parameter(shape="rigid", meaning="1 for sensors that repeat their output")
    invalid = Parameter(meaning="1 if the pose is marked as invalid")
    late = Parameter(meaning="1 if the commands are late by two samples")

    def __init__(self, truss: SpaceTruss, sample_time: float) -> None:
        self.rigid, self.robots = truss.rigid, truss.robots
        self.joints, self.actuators = truss.joints, truss.actuators
        nothing = np.zeros(self.rigid)
        super().__init__(
            begin=0.0,
            end=0.0,
            bases=np.ones(self.robots),
            drives=np.ones(self.joints),
            forces=np.zeros(self.actuators),
            bias=nothing,
            stuck=nothing,
            invalid=0.0,
            late=0.0,
        )
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return effects, forces and measurements at time `t`."""
        on = np.logical_and(t >= p.begin, t < p.end)
        stuck = np.logical_and(on, p.stuck > 0.0)
        position = u.measured_position + np.where(on, p.bias, 0.0)
        return {
            "position": np.where(stuck, x.last_position, position),
            "rates": np.where(stuck, x.last_rates, u.measured_rates),
            "valid": np.where(on, 1.0 - p.invalid, 1.0),
            "base_effect": np.where(on, p.bases, 1.0),
            "drive_effect": np.where(on, p.drives, 1.0),
            "valves": np.where(on, p.forces, 0.0),
            "command": np.where(
                np.logical_and(on, p.late > 0.0), x.older_request, u.request
            ),
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store measurements and commands."""
        now = self.output(t, x, u, p)
        return {
            "last_position": now["position"],
            "last_rates": now["rates"],
            "last_request": u.request,
            "older_request": x.last_request,
        }


def add_faults(diagram: Diagram, truss: SpaceTruss, sample_time: float) -> None:
    """Add `Faults` named faults to a mean-axes loop with hardware.

    Parameters
    ----------
    diagram : Diagram
        Loop by `mean_axes_transport`.
    truss : SpaceTruss
        Plant of the loop.
    sample_time : float
        Sample time of the controller [s].
    """
    faults = diagram.add(faults=Faults(truss, sample_time))
    actuators, sensors, controller = (
        diagram.blocks[name] for name in ("actuators", "sensors", "controller")
    )
    command = actuators.port("command")
    for port in (
        truss.actuation,
        command,
        controller.port("position"),
        controller.port("velocity"),
    ):
        diagram.disconnect(port)
    controller.port("command") >> faults.request
    faults.command >> command
    actuators.port("actuation") + faults.valves >> truss.actuation
    faults.base_effect >> actuators.port("base_effectiveness")
    faults.drive_effect >> actuators.port("joint_effectiveness")
    sensors.port("task_position") >> faults.measured_position
    sensors.port("rigid_speeds") >> faults.measured_rates
    faults.position >> controller.port("position")
    faults.rates >> controller.port("velocity")
    faults.valid >> controller.port("valid")


def fault_runs(
    hardware: Hardware, plant: SpaceTruss, feasible: Sequence[int]
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield kind, name and parameters of each run with one of the `FAULTS`.

    Parameters
    ----------
    hardware : Hardware
        Hardware of the loop.
    plant : SpaceTruss
        Plant.
    feasible : sequence of int
        Numbers of the robots whose bases may fail, one of `FEASIBLE`.
    """
    for kind, fault in FAULTS["kinds"].items():
        runs = product(fault.get("robots", (1, 2, 3)), fault.get("times", TIMES))
        for robot, time in runs:
            if fault.get("base", 1.0) < 0.5 and robot not in feasible:
                continue
            name = f"{kind} ({robot}, {time:g} s)"
            yield kind, name, fault_parameters(hardware, plant, robot, time, fault)


def fault_parameters(
    hardware: Hardware,
    plant: SpaceTruss,
    robot: int,
    time: float,
    fault: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the parameters of a run with a fault, the same ones for all faults.

    Parameters
    ----------
    hardware : Hardware
        Hardware of the loop.
    plant : SpaceTruss
        Plant.
    robot : int
        Number of the robot with the fault, from 1.
    time : float
        Begin of the fault, one of `TIMES` for open valves [s].
    fault : mapping
        Values as in ``faults.toml``, where they differ from the default.
    """
    f = {**FAULTS["default"], **fault}
    robots, joints = plant.robots, plant.joints
    own, place = np.eye(robots)[robot - 1], np.arange(joints)
    # Wheels have their limits behind the gain, thrusters before it.
    limits = hardware.limits(plant)
    limits[: 6 * robots] /= f["gain"]
    forces = np.zeros((robots, 6))
    if f["force"]:
        forces[robot - 1, VALVE_AXES[TIMES.index(time)]] = -f["force"]
    bias = f["bias"] * np.cos((robot - 1.0) * place)
    second = place == joints // robots * (robot - 1) + 1
    drives = np.repeat(1.0 - (1.0 - f["drives"]) * own, joints // robots)
    return {
        "faults.begin": time,
        "faults.end": time + f["lasting"],
        "faults.bases": f["gain"] * (1.0 - (1.0 - f["base"]) * own),
        "faults.drives": drives,
        "faults.forces": np.append(forces, np.zeros(joints)),
        "faults.bias": np.append(np.zeros(6), bias),
        "faults.stuck": np.append(np.full(6, f["pose"]), f["encoder"] * second),
        "faults.invalid": f["pose"],
        "faults.late": f["late"],
        "actuators.drives.coulomb": np.full(joints, f["friction"]),
        "controller.allocation.limits": limits,
        "controller.economy.limits": limits,
        **{
            f"actuators.thrusters_{i + 1}.limit.upper": np.full(6, limits[0])
            for i in range(robots)
        },
    }
