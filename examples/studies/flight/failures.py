"""Sudden actuator failures: the block that applies them, brakes, and metrics of a run with a failure."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

from flight.metrics import torques, tracking
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.algebra import Function
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.feasibility import ActuatorFailure

PARTS: dict[str, dict[str, Any]] = {
    "base": {},
    "drives": {"axes": (), "joints": "limp"},
    "robot": {"joints": "limp"},
}
"""Parts of a robot that may fail, with their arguments of `ActuatorFailure.of`."""

FAILURE_METRICS = (
    "isolated after",
    "position",
    "attitude",
    "joints",
    "late position",
    "base torque",
    "joint torque",
    "false alarms",
)
"""Metrics of a run with a failure."""

BRAKE_FREQUENCY = 40.0
"""Natural frequency of a braked arm [rad/s]: above that of the loop, below the limit of the solver."""


def failure_parameters(
    dynamics: TrussDynamics, part: str, robot: int, time: float
) -> dict[str, Any]:
    """Return the parameters of a run in which a part of a robot fails.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    part : str
        ``"base"``, ``"drives"``, or ``"robot"`` for both.
    robot : int
        Number of the robot, from 1.
    time : float
        Time of the failure [s].
    """
    health = ActuatorFailure.of(dynamics, robot, **PARTS[part]).health
    bases = 6 * len(dynamics.arms)
    return {
        "failure.time": time,
        "failure.bases": health[:bases:6],
        "failure.drives": health[bases:],
    }


class SuddenFailure(Block):
    """Health of bases and joint drives: 1 before the failure, then as in the parameters.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.
    """

    base_effectiveness = Output("robots", meaning="health of each base")
    joint_effectiveness = Output("joints", meaning="health of each joint drive")
    time = Parameter(unit="s", meaning="time of the failure")
    bases = Parameter(
        shape="robots", minimum=0.0, meaning="health of each base after the failure"
    )
    drives = Parameter(
        shape="joints", minimum=0.0, meaning="health of each drive after the failure"
    )

    def __init__(self, dynamics: TrussDynamics) -> None:
        self.robots, self.joints = len(dynamics.arms), dynamics.joints
        super().__init__(
            time=0.0, bases=np.ones(self.robots), drives=np.ones(self.joints)
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the health at time `t`."""
        return {
            "base_effectiveness": np.where(t >= p.time, p.bases, 1.0),
            "joint_effectiveness": np.where(t >= p.time, p.drives, 1.0),
        }


def with_failures(
    diagram: Diagram, dynamics: TrussDynamics, *, brakes: bool
) -> Diagram:
    r"""Add a `SuddenFailure` named failure to a mean-axes loop with hardware, and return the diagram.

    Brakes are stiff critically damped springs, :math:`\tau_b = -G (\omega^2\theta + 2\omega\dot\theta)` with
    the inertia G of the arms at rest. They return the joints of arms to zero that do not follow their
    drives, as the controller reports.

    Parameters
    ----------
    diagram : Diagram
        Loop by `mean_axes_transport`.
    dynamics : TrussDynamics
        Truss and robots.
    brakes : bool
        Whether joints have brakes; without brakes, joints with failed drives move freely.
    """
    failure = diagram.add(failure=SuddenFailure(dynamics))
    actuators = diagram.blocks["actuators"]
    for port in failure.outputs():
        port >> actuators.port(port.name)
    if brakes:
        truss, joints = diagram.blocks["truss"], dynamics.joints
        own = slice(6, 6 + joints)
        inertia = dynamics.evaluate(dynamics.rest).mass_matrix[own, own]

        def braked(angles: Array, rates: Array, on: Array) -> Array:
            stiffness, damping = BRAKE_FREQUENCY**2, 2.0 * BRAKE_FREQUENCY
            return -on * (inertia @ (on * (stiffness * angles + damping * rates)))

        inputs = {"angles": Input(joints), "rates": Input(joints), "on": Input(joints)}
        block = diagram.add(
            brakes=Function(braked, inputs, {"torques": Output(joints)})
        )
        truss.port("task_position")[6:] >> block.port("angles")
        truss.port("rigid_speeds")[6:] >> block.port("rates")
        diagram.blocks["controller"].port("held") >> block.port("on")
        # The drives of the hardware are gearless, without brakes of their own.
        acting, driven = truss.port("actuation"), actuators.port("actuation")
        bases = dynamics.actuators - joints
        diagram.disconnect(acting)
        driven[:bases] >> acting[:bases]
        driven[bases:] + block.port("torques") >> acting[bases:]
    return diagram


def failure_metrics(run: xr.Dataset) -> dict[str, float]:
    """Return the `FAILURE_METRICS` of a run.

    Joints with failed drives do not count. Drives are isolated if their arm is held. The detection delay is that
    of the part that is isolated last, infinite if one is never isolated. All arms must have the same number of
    joints.
    """
    parameters = json.loads(run.attrs["parameters"])
    bases, drives = (
        np.array(parameters[f"failure.{name}"]) for name in ("bases", "drives")
    )
    health, held = (
        run[f"controller.monitor.{name}"].values for name in ("effectiveness", "held")
    )
    count, joints = bases.size, drives.size // bases.size
    # One column for each base, then one for each arm: all actuators of a part are isolated together.
    isolated = np.hstack([health[:, : 6 * count : 6] < 1.0, held[:, ::joints] > 0.5])
    instants = np.where(
        isolated.any(axis=0), run["time"].values[isolated.argmax(axis=0)], np.inf
    )
    failed = np.r_[bases, drives[::joints]] < 1.0
    begin = float(np.ravel(parameters["failure.time"])[0])
    found = {
        "isolated after": instants[failed].max() - begin,
        **tracking(run, drives == 1.0),
        **torques(run),
        "false alarms": float(np.sum(instants < np.where(failed, begin, np.inf))),
    }
    return {name: found[name] for name in FAILURE_METRICS}
