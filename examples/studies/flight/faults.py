"""Faults of actuators and sensors as parameters of a loop, and the faults of the report."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.feasibility import ActuatorFailure
from trussflow.models.plant.space_truss import SpaceTruss

TIMES = (10.0, 30.0, 50.0)
"""Times of the faults: acceleration, coasting, braking [s]."""

FEASIBLE = {1: (1, 2, 3), 2: (1, 2)}
"""Numbers of the robots without which a case is feasible."""

PARTIAL_EFFECTS = (0.3, 0.5, 0.9)
VALVE_FORCES = (0.3, 2.0)  # N
ENCODER_BIAS = 3e-3  # rad
OUTAGE = 1.0  # s
FRICTION = 0.05  # N·m
NEVER = 1e9  # s
STUCK_JOINT = 1
"""Index of the joint in its arm whose encoder sticks [-]."""


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
            end=NEVER,
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


def unit(size: int, index: int) -> Vector:
    """Return a vector of zeros with a one at an index.

    Parameters
    ----------
    size, index : int
        Number of elements, and index of the one [-].
    """
    found: Vector = np.eye(size)[index]
    return found


class Condition(NamedTuple):
    """Condition of a run.

    Attributes
    ----------
    kind, label : str
        Kind of the condition, and name of the run.
    parameters : dict
        Parameters of the loop.
    """

    kind: str
    label: str
    parameters: dict[str, Any]


def fault_conditions(
    dynamics: TrussDynamics, case: int, sample_time: float
) -> list[Condition]:
    """Return the runs with faults in Case 1 or 2, all with the same names of parameters.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    case : int
        Case 1 or 2 of the paper.
    sample_time : float
        Sample time of the controller [s].
    """
    robots, joints = len(dynamics.arms), dynamics.joints
    rigid, bases, found = 6 + joints, 6 * robots, list[Condition]()

    def add(kind: str, label: str, begin: float = 0.0, **changes: Any) -> None:
        friction = changes.pop("friction", 0.0)
        values = {
            "begin": begin,
            "end": NEVER,
            "bases": np.ones(robots),
            "drives": np.ones(joints),
            "forces": np.zeros(dynamics.actuators),
            "bias": np.zeros(rigid),
            "stuck": np.zeros(rigid),
            "invalid": 0.0,
            "late": 0.0,
        }
        parameters = {f"faults.{k}": v for k, v in (values | changes).items()}
        parameters["actuators.drives.coulomb"] = np.full(joints, friction)
        when = f" at {begin:g} s" if begin else ""
        found.append(Condition(kind, label + when, parameters))

    for effect in (0.0, *PARTIAL_EFFECTS):
        state = f"at {effect:.0%}" if effect else "fails"
        for robot, time in product(FEASIBLE[case], TIMES):
            lost = unit(robots, robot - 1)
            left = 1.0 - (1.0 - effect) * lost
            add(f"base {state}", f"base {robot} {state}", time, bases=left)
    for robot, time in product(FEASIBLE[case], TIMES):
        health = ActuatorFailure.of(dynamics, robot, joints="limp").health
        add(
            "robot fails, braked",
            f"robot {robot} fails",
            time,
            bases=health[:bases:6],
            drives=health[bases:],
        )
    for force in VALVE_FORCES:
        for robot, (axis, time) in product(
            range(robots), zip((2, 0, 1), TIMES, strict=True)
        ):
            add(
                f"valve open, {force:g} N",
                f"valve of base {robot + 1} along −{'xyz'[axis]} open, {force:g} N",
                time,
                forces=-force * unit(dynamics.actuators, 6 * robot + axis),
            )
    random = np.random.default_rng(0)
    for name, errors in (
        ("all joints", np.ones(joints)),
        ("random", random.standard_normal(joints)),
        ("random, again", random.standard_normal(joints)),
    ):
        bias = np.append(np.zeros(6), ENCODER_BIAS * errors)
        kind = f"encoder bias, {1e3 * ENCODER_BIAS:g} mrad"
        add(kind, f"{kind}, {name}", bias=bias)
    own = joints // robots
    for robot, time in zip((1, 2, 3), TIMES, strict=True):
        joint = own * (robot - 1) + STUCK_JOINT
        label = f"encoder of joint {STUCK_JOINT + 1} of robot {robot} stuck"
        add("encoder stuck", label, time, stuck=unit(rigid, 6 + joint))
    pose = np.append(np.ones(6), np.zeros(joints))
    for time in TIMES:
        kind = f"no valid pose for {OUTAGE:g} s"
        add(kind, kind, time, end=time + OUTAGE, stuck=pose, invalid=1.0)
    for number in range(3):
        kind = f"Coulomb friction, {FRICTION:g} N·m"
        add(kind, f"{kind}, run {number + 1}", friction=FRICTION)
    for number in range(3):
        kind = f"commands late by further {2e3 * sample_time:g} ms"
        add(kind, f"{kind}, run {number + 1}", late=1.0)
    return found
