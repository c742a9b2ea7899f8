"""Validity checks of the controller: gate of the measurements, and hold of the commands."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import way_to
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock
from trussflow.models.plant.truss_block import (
    ACTUATOR_UNITS,
    POSITION_UNITS,
    RATE_UNITS,
)

MAX_MAGNITUDE = 1e6
"""Magnitude above which a measured number is invalid, as NaN is [m, rad, m/s, rad/s]."""

LONGEST_OUTAGE = 1.0
"""Time without a pose within the gate, after which innovations are no longer limited [s]."""


class MeasurementGate(MeanAxesBlock):
    """Replace invalid measurements by the prediction of the estimator.

    Pose and rates of the truss frame are rejected together: if they are marked as invalid, not finite, or if
    an innovation exceeds the gate. Without them the estimator predicts only (coasting). After the longest
    outage all valid poses are accepted until one is within the gate, since the prediction may be wrong.
    Joint measurements are replaced only if they are not finite.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time, noise and gate.
    """

    position = Input("rigid_q", unit=POSITION_UNITS, meaning="measured x_1")
    velocity = Input("rigid", unit=RATE_UNITS, meaning="measured x_2")
    valid = Input(default=1.0, meaning="1 if pose and rates are valid, else 0")
    mean_position = Input("rigid_q", unit=POSITION_UNITS, meaning="predicted y")
    mean_speeds = Input("rigid", unit=RATE_UNITS, meaning="predicted nu")
    checked_position = Output("rigid_q", unit=POSITION_UNITS, meaning="x_1 or y")
    checked_velocity = Output("rigid", unit=RATE_UNITS, meaning="x_2 or nu")
    outage = Output(unit="s", meaning="time without a pose within the gate")

    coasting = State(unit="s", meaning="time without a pose within the gate")

    position_gate = Parameter(above=0.0, unit="m", meaning="largest innovation of pose")
    rate_gate = Parameter(above=0.0, unit="m/s", meaning="largest innovation of rates")

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign) -> None:
        super().__init__(
            dynamics,
            design,
            position_gate=design.innovation_gate * design.position_noise,
            rate_gate=design.innovation_gate * design.rate_noise,
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return measurements, or predictions instead of rejected ones."""
        kind, frame = self.dynamics.attitude, self.dynamics.attitude.end
        position = np.where(
            np.abs(u.position) < MAX_MAGNITUDE, u.position, u.mean_position
        )
        velocity = np.where(
            np.abs(u.velocity) < MAX_MAGNITUDE, u.velocity, u.mean_speeds
        )
        numbers = np.concatenate([u.position[:frame], u.velocity[:6]])
        pose_error = way_to(kind, u.mean_position, position)[:6]
        rate_error = (velocity - u.mean_speeds)[:6]
        near = np.logical_and(
            np.max(np.abs(pose_error)) < p.position_gate,
            np.max(np.abs(rate_error)) < p.rate_gate,
        )
        usable = np.logical_and(_all_valid(numbers), u.valid > 0.5)
        credible = np.logical_or(near, x.coasting > LONGEST_OUTAGE)
        accepted = np.logical_and(usable, credible)
        pose = np.where(accepted, position[:frame], u.mean_position[:frame])
        rates = np.where(accepted, velocity[:6], u.mean_speeds[:6])
        return {
            "checked_position": np.concatenate([pose, position[frame:]]),
            "checked_velocity": np.concatenate([rates, velocity[6:]]),
            "outage": np.where(
                np.logical_and(usable, near), 0.0, x.coasting + self.design.sample_time
            ),
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store the time without an accepted pose."""
        return {"coasting": self.output(t, x, u, p)["outage"]}


class CommandHold(MeanAxesBlock):
    """Pass on finite commands; otherwise hold the last ones and report it.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time.
    """

    request = Input("actuators", unit=ACTUATOR_UNITS, meaning="Q")
    command = Output("actuators", unit=ACTUATOR_UNITS, meaning="Q, or the last finite")
    command_valid = Output(meaning="1 if Q is finite, else 0")

    last = State("actuators", meaning="last finite Q")

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the command, or the last finite one."""
        valid = _all_valid(u.request)
        return {
            "command": np.where(valid, u.request, x.last),
            "command_valid": np.where(valid, 1.0, 0.0),
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store the command."""
        return {"last": self.output(t, x, u, p)["command"]}


def _all_valid(numbers: Array) -> Array:
    """Return whether all `numbers` are finite and of possible magnitude [any]."""
    # A sum, as a maximum may leave out NaN.
    return np.sum(np.where(np.abs(numbers) < MAX_MAGNITUDE, 0.0, 1.0)) < 0.5
