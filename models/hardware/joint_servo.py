"""Local servo of the joints: position and rate control by the electronics of the drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.library.sources import Constant
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.hardware.measurement import Measurement, derived_seed
from trussflow.models.hardware.motors import JointBlock
from trussflow.models.robots.joint import Joint

EFFORT, PLACE, RATE = (
    Attribute(name) for name in ("effort_units", "joint_units", "rate_units")
)


class JointServo(JointBlock):
    r"""Position and rate control of joints with torque feedforward; sampled, one sample late.

    .. math::
        \tau_{k+1} = \mathrm{lim}\left(\tau_{ff} + k_p (\theta_r - \theta)
        + k_d (\dot\theta_r - \dot\theta), \pm\tau_{max}\right)

    Each joint has its own loop; the feedforward comes from a controller that knows the whole system.

    Parameters
    ----------
    joints : sequence of Joint
        All joints, at least one. Sliding joints have the units N and m.
    sample_time : float
        Sample time T_s [s].
    torque : array_like
        Maximum torque [N·m]; one value for all joints or one each.

    Raises
    ------
    BlockError
        If there is no joint, or the sample time is not positive.
    ParameterError
        If the maximum torque is not positive.
    """

    reference = Input("joints", unit=PLACE, meaning="theta_r")
    reference_rate = Input("joints", unit=RATE, default=0.0, meaning="d theta_r/dt")
    feedforward = Input("joints", unit=EFFORT, default=0.0, meaning="tau_ff")
    angle = Input("joints", unit=PLACE, meaning="theta, measured")
    rate = Input("joints", unit=RATE, meaning="d theta/dt, measured")
    proportional_gain = Input("joints", meaning="k_p [N·m/rad]")
    derivative_gain = Input("joints", meaning="k_d [N·m·s/rad]")
    torque = Output(
        "joints", unit=EFFORT, meaning="tau, commanded torque of the drives"
    )
    impulse = Output("joints", meaning="time integral of tau [N·m·s]")
    late = State("joints", meaning="torque until the next sample")
    total = State("joints", meaning="time integral of the torque")
    maximum = Parameter(shape="joints", unit="N*m", above=0.0, meaning="tau_max")

    def __init__(
        self, joints: Sequence[Joint], sample_time: float, *, torque: npt.ArrayLike
    ) -> None:
        self.set_joints(joints)
        super().__init__(maximum=torque)
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the torque of the previous sample, and the integral of all before."""
        return {"torque": x.late, "impulse": x.total}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the torque by the measurements of this sample."""
        wanted = (
            u.feedforward
            + u.proportional_gain * (u.reference - u.angle)
            + u.derivative_gain * (u.reference_rate - u.rate)
        )
        return {
            "late": limited(wanted, -p.maximum, p.maximum),
            "total": x.total + self.sample_time * x.late,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoDesign:
    """Local servo of all joints: sample time, gains, and the encoders and tachometers of the drives.

    Attributes
    ----------
    sample_time : float
        Sample time [s].
    proportional_gain, derivative_gain : array_like
        Gains, one for all joints or one each [N·m/rad, N·m·s/rad].
    encoder, tachometer : Measurement
        Measurements of joint angles [rad] and rates [rad/s] for the servo alone.
    """

    sample_time: float
    proportional_gain: npt.ArrayLike
    derivative_gain: npt.ArrayLike
    encoder: Measurement
    tachometer: Measurement

    def diagram(
        self, joints: Sequence[Joint], torque: npt.ArrayLike, rest: Vector, *, seed: int
    ) -> Diagram:
        """Return servo, sensors and gains as a diagram.

        Parameters
        ----------
        joints : sequence of Joint
            All joints, at least one.
        torque : array_like
            Maximum torque [N·m].
        rest : Vector, shape (joints,)
            Joint coordinates at the start [rad; m].
        seed : int
            Seed of the noise of the sensors, zero or positive [1].

        Returns
        -------
        Diagram
            Inputs: `reference`, `reference_rate`, `feedforward`, and the true `angle` and `rate`. Outputs:
            `torque` and `impulse`. The gains are the parameters ``stiffness.value`` and ``damping.value``.
        """
        size = rest.shape
        diagram = Diagram("servo")
        servo, stiffness, damping, encoder, tachometer = diagram.add(
            servo=JointServo(joints, self.sample_time, torque=torque),
            stiffness=Constant(np.broadcast_to(self.proportional_gain, size)),
            damping=Constant(np.broadcast_to(self.derivative_gain, size)),
            encoder=self.encoder.sensor(
                size, seed=derived_seed(seed, 0), initial_value=rest
            ),
            tachometer=self.tachometer.sensor(size, seed=derived_seed(seed, 1)),
        )
        stiffness.y >> servo.proportional_gain
        damping.y >> servo.derivative_gain
        encoder.y >> servo.angle
        tachometer.y >> servo.rate
        diagram.expose(
            reference=servo.reference,
            reference_rate=servo.reference_rate,
            feedforward=servo.feedforward,
            angle=encoder.u,
            rate=tachometer.u,
            torque=servo.torque,
            impulse=servo.impulse,
        )
        return diagram
