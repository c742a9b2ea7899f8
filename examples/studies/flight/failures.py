"""Actuators that die in flight: which flights show what becomes of it, and their measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.reporting.metrics import largest_component, tracking_metrics
from trussflow.models.validation import check_choice

PARTS = {"base": ("base",), "drives": ("drives",), "robot": ("base", "drives")}
"""What of a robot may die, and what belongs to it."""

SIGNALS = (
    "trajectory.position",
    "truss.task_position",
    "truss.base_force",
    "truss.base_torque",
    "truss.joint_torque",
    "controller.monitor.effectiveness",
)
"""What a simulator has to log for `fly`."""


BRAKE = 40.0
"""Natural frequency of an arm against its brakes [rad/s]: far above the loop's, far below the solver's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """What dies in a flight; as text, the flight's label.

    Attributes
    ----------
    part : str
        ``"base"``, ``"drives"`` of the arm, or ``"robot"``, which is both.
    robot : int
        Whose, from 1 on [-].
    time : float
        When [s].

    Raises
    ------
    ModelError
        If there is no such part.
    """

    part: str
    robot: int
    time: float

    def __post_init__(self) -> None:
        check_choice("part", self.part, PARTS)

    def __str__(self) -> str:
        return f"{self.part} {self.robot} dead at {self.time:g} s"

    def parameters(self, dynamics: TrussDynamics) -> dict[str, Any]:
        """Return the parameters of a flight with it, for a diagram that `with_loss` has been at.

        Parameters
        ----------
        dynamics : TrussDynamics
            The robots.

        Raises
        ------
        ModelError
            If there is no such robot.
        """
        check_choice("robot", self.robot, range(1, len(dynamics.arms) + 1))
        owner = np.repeat(np.arange(len(dynamics.arms)) + 1, [arm.joints for arm in dynamics.arms])
        lost = {"base": np.arange(len(dynamics.arms)) + 1 == self.robot, "drives": owner == self.robot}
        left = {name: np.where(lost[name] & (name in PARTS[self.part]), 0.0, 1.0) for name in lost}
        return {"loss.time": self.time, "loss.bases": left["base"], "loss.drives": left["drives"]}


class SuddenLoss(Block):
    """Effectiveness of bases and joints: 1, and from an instant on what is left of it.

    Parameters
    ----------
    dynamics : TrussDynamics
        The robots.
    """

    base_effectiveness = Output("robots", meaning="of each base")
    joint_effectiveness = Output("joints", meaning="of the drive of each joint")
    time = Parameter(unit="s", meaning="when")
    bases = Parameter(shape="robots", minimum=0.0, meaning="what is left of each base")
    drives = Parameter(shape="joints", minimum=0.0, meaning="what is left of each drive")

    def __init__(self, dynamics: TrussDynamics) -> None:
        self.robots, self.joints = len(dynamics.arms), dynamics.joints
        super().__init__(time=0.0, bases=np.ones(self.robots), drives=np.ones(self.joints))

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what is left at this time."""
        return {
            "base_effectiveness": np.where(t >= p.time, p.bases, 1.0),
            "joint_effectiveness": np.where(t >= p.time, p.drives, 1.0),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a flight with a loss.

    Attributes
    ----------
    label : str
        What died.
    delays : mapping of str to float
        How long each part that died went unnoticed; infinite if for good [s].
    false_alarms : tuple of str
        What was believed dead and was not.
    position, attitude : float
        Largest component of the error of the root [m, rad].
    joints, limp_joints : float
        Of the joints that have drives, and of those without; 0 if there are none [rad].
    late_position : float
        Largest component of the position error in the last 10 s [m].
    force, base_torque, joint_torque : float
        The largest on an axis [N, N·m].
    """

    label: str
    delays: Mapping[str, float]
    false_alarms: tuple[str, ...]
    position: float
    attitude: float
    joints: float
    limp_joints: float
    late_position: float
    force: float
    base_torque: float
    joint_torque: float

    @property
    def flown(self) -> bool:
        """Whether all dead parts were named, no other, and errors are within 1 cm and 0.2 rad."""
        named = np.isfinite(list(self.delays.values())).all() and not self.false_alarms
        return bool(named and self.position < 0.01 and self.joints < 0.2)


def losses(
    parts: Sequence[str] = ("base", "robot"),
    robots: Sequence[int] = (1, 2, 3),
    times: Sequence[float] = (10.0, 30.0, 50.0),
) -> tuple[Loss, ...]:
    """Return all combinations: in Case 1 those that can be survived along body z, at thrust and coasting.

    Parameters
    ----------
    parts : sequence of str
        Some of `PARTS`.
    robots : sequence of int
        From 1 on [-].
    times : sequence of float
        When [s].

    Raises
    ------
    ModelError
        If there is no such part.
    """
    return tuple(Loss(part=p, robot=i, time=t) for p, i, t in product(parts, robots, times))


def with_loss(diagram: Diagram, dynamics: TrussDynamics, *, brakes: bool = False) -> Diagram:
    r"""Add a block named loss to a transport with hardware, and return the diagram; nothing dies yet.

    Brakes are stiff critically damped springs, :math:`\tau_b = -G (\omega^2\theta + 2\omega\dot\theta)` with
    the inertia G of the arms at rest. They act where the controller believes drives dead, and bring their
    joints back to zero.

    Parameters
    ----------
    diagram : Diagram
        Such as `mean_axes_transport` returns.
    dynamics : TrussDynamics
        The robots.
    brakes : bool
        Whether joints have brakes; without, dead drives are limp.
    """
    loss, actuators = diagram.add(loss=SuddenLoss(dynamics)), diagram.blocks["actuators"]
    for port in loss.outputs():
        port >> actuators.port(port.name)
    if brakes:
        joints, truss, controller = dynamics.joints, diagram.blocks["truss"], diagram.blocks["controller"]
        inertia = dynamics.evaluate(dynamics.rest).mass_matrix[6 : 6 + joints, 6 : 6 + joints]

        def held(angles: Array, rates: Array, effectiveness: Array) -> Array:
            on = 1.0 - effectiveness[-joints:]
            return -on * (inertia @ (on * (BRAKE**2 * angles + 2.0 * BRAKE * rates)))

        inputs = {"angles": Input(joints), "rates": Input(joints), "effectiveness": Input(dynamics.actuators)}
        block = diagram.add(brakes=Function(held, inputs, {"torques": Output(joints)}))
        truss.port("task_position")[6:] >> block.port("angles")
        truss.port("rigid_speeds")[6:] >> block.port("rates")
        controller.port("effectiveness") >> block.port("effectiveness")
        block.port("torques") >> actuators.port("brake")
    return diagram


def fly(
    simulator: Simulator,
    dynamics: TrussDynamics,
    loss: Loss,
    *,
    duration: float = 80.0,
    parameters: Mapping[str, Any] | None = None,
) -> Outcome:
    """Fly with a loss, and measure.

    Parameters
    ----------
    simulator : Simulator
        Of a diagram that `with_loss` has been at; it logs `SIGNALS`.
    dynamics : TrussDynamics
        The robots.
    loss : Loss
        What dies.
    duration : float
        How long to fly [s].
    parameters : mapping, optional
        Others of this run, such as those of a draw [as declared].

    Raises
    ------
    ModelError
        If there is no such robot.
    SimulationError
        If the flight is lost altogether.
    """
    given = {**(parameters or {}), **loss.parameters(dynamics)}
    log = simulator.run(duration, parameters=given, progress=False, not_finite="ignore")
    time, robots = log["time"].values, len(dynamics.arms)
    known = log["controller.monitor.effectiveness"].values
    error = log["truss.task_position"].values - log["trajectory.position"].values
    owner = np.repeat(np.arange(robots), [arm.joints for arm in dynamics.arms])
    limp = (owner == loss.robot - 1) & ("drives" in PARTS[loss.part])
    delays, wrong = {}, []
    for i in range(robots):
        first = {"base": 6 * i, "drives": 6 * robots + int(np.argmax(owner == i))}
        for name, column in first.items():
            when = np.append(time[known[:, column] < 1.0], np.inf)[0]
            dies = i == loss.robot - 1 and name in PARTS[loss.part]
            if dies:
                delays[name] = float(when - loss.time)
            if when < (loss.time if dies else np.inf):
                wrong.append(f"{name} {i + 1}")

    joints = error[:, 6:]
    parts = {"position": error[:, :3], "attitude": error[:, 3:6]}
    found = tracking_metrics(time, {**parts, "joints": joints[:, ~limp], "limp joints": joints[:, limp]})
    return Outcome(
        label=str(loss),
        delays=delays,
        false_alarms=tuple(wrong),
        position=found["peak position (component)"],
        attitude=found["peak attitude (component)"],
        joints=found["peak joints (component)"],
        limp_joints=found["peak limp joints (component)"],
        late_position=found["late position (component)"],
        force=largest_component(log["truss.base_force"]),
        base_torque=largest_component(log["truss.base_torque"]),
        joint_torque=largest_component(log["truss.joint_torque"]),
    )
