"""A rigid body in space."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import ParameterError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array

NORM_CORRECTION_RATE = 1.0
"""Rate at which the length of the quaternion returns to one [1/s]."""


class RigidBody(Block):
    r"""A rigid body with six degrees of freedom, its attitude as a quaternion.

    .. math:: m \dot v = R(q) f + m g, \quad \dot r = v, \qquad
        J \dot\omega = \tau - \omega \times J \omega, \quad \dot q = \tfrac12 q \circ (0, \omega)

    q = (w, x, y, z) rotates vectors from the body frame to the world frame, R is its matrix. Force, torque
    and angular velocity are in the body frame, other vectors in the world frame. The center of mass is the
    origin. An additional term :math:`(1 - q^T q) q` in the rate of q stabilizes its length.

    Parameters
    ----------
    mass : float
        m > 0 [kg].
    inertia : array_like, shape (3, 3)
        J about the center of mass, in the body frame [kg m^2]; three numbers are its diagonal.
    gravity : array_like, shape (3,)
        g [m/s^2].
    position, velocity, attitude, rate : array_like
        r [m], v [m/s], q [-] and ω [rad/s] at time 0.

    Raises
    ------
    ParameterError
        If the inertia is not symmetric and positive definite, or the attitude no unit quaternion.

    References
    ----------
    Stevens, Lewis and Johnson (2016), *Aircraft Control and Simulation*, section 1.8.
    """

    force = Input(
        3, unit="N", frame="body", default=0.0, meaning="f: force at the center of mass"
    )
    torque = Input(3, unit="N*m", frame="body", default=0.0, meaning="τ: torque")
    position = Output(3, unit="m", frame="world", meaning="r: center of mass")
    velocity = Output(3, unit="m/s", frame="world", meaning="v: its velocity")
    attitude = Output(4, unit="1", meaning="q: from body to world, (w, x, y, z)")
    rate = Output(3, unit="rad/s", frame="body", meaning="ω: angular velocity")
    rotation = Output((3, 3), unit="1", meaning="R: from body to world")
    r = State(3, initial="initial_position", unit="m", meaning="center of mass")
    v = State(3, initial="initial_velocity", unit="m/s", meaning="its velocity")
    q = State(4, initial="initial_attitude", meaning="attitude")
    w = State(3, initial="initial_rate", unit="rad/s", meaning="angular velocity")
    mass = Parameter(unit="kg", above=0.0, meaning="m")
    inertia = Parameter(shape=(3, 3), unit="kg m^2", meaning="J")
    gravity = Parameter(0.0, shape=3, unit="m/s^2", meaning="g")
    initial_position = Parameter(0.0, shape=3, unit="m", meaning="r at time 0")
    initial_velocity = Parameter(0.0, shape=3, unit="m/s", meaning="v at time 0")
    initial_attitude = Parameter((1.0, 0.0, 0.0, 0.0), shape=4, meaning="q at time 0")
    initial_rate = Parameter(0.0, shape=3, unit="rad/s", meaning="ω at time 0")

    def __init__(
        self,
        mass: float,
        inertia: npt.ArrayLike,
        *,
        gravity: npt.ArrayLike = 0.0,
        position: npt.ArrayLike = 0.0,
        velocity: npt.ArrayLike = 0.0,
        attitude: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        rate: npt.ArrayLike = 0.0,
    ) -> None:
        J = finite_array("parameter 'inertia' of RigidBody", inertia)
        super().__init__(
            mass=mass,
            inertia=np.diag(J) if J.shape == (3,) else J,
            gravity=gravity,
            initial_position=position,
            initial_velocity=velocity,
            initial_attitude=attitude,
            initial_rate=rate,
        )

    def check_parameters(self, p: Signals) -> None:
        """Check the inertia and the attitude."""
        J = p.inertia
        if abs(J - J.T).max() > 1e-9 * abs(J).max() or np.linalg.eigvalsh(J).min() <= 0:
            raise ParameterError(
                f"the inertia of {p.owner} must be symmetric and positive definite; it is {J.tolist()}"
            )
        if abs(np.linalg.norm(p.initial_attitude) - 1.0) > 1e-6:
            raise ParameterError(
                f"the attitude of {p.owner} must be a unit quaternion (w, x, y, z)"
            )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the motion."""
        return {
            "position": x.r,
            "velocity": x.v,
            "attitude": x.q,
            "rate": x.w,
            "rotation": _matrix(x.q),
        }

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of the motion."""
        momentum = p.inertia @ x.w
        # The product of the quaternions q and (0, ω): scalar part, then vector part.
        spin = np.concatenate(
            [np.stack([-x.q[1:] @ x.w]), x.q[0] * x.w + np.cross(x.q[1:], x.w)]
        )
        return {
            "r": x.v,
            "v": _matrix(x.q) @ u.force / p.mass + p.gravity,
            "q": 0.5 * spin + NORM_CORRECTION_RATE * (1.0 - x.q @ x.q) * x.q,
            "w": np.linalg.solve(p.inertia, u.torque - np.cross(x.w, momentum)),
        }


def _matrix(q: Array) -> Array:
    """Return the rotation matrix of a quaternion of any length."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    rows = [
        np.stack(
            [
                w * w + x * x - y * y - z * z,
                2.0 * (x * y - w * z),
                2.0 * (x * z + w * y),
            ]
        ),
        np.stack(
            [
                2.0 * (x * y + w * z),
                w * w - x * x + y * y - z * z,
                2.0 * (y * z - w * x),
            ]
        ),
        np.stack(
            [
                2.0 * (x * z - w * y),
                2.0 * (y * z + w * x),
                w * w - x * x - y * y + z * z,
            ]
        ),
    ]
    # The length of q may differ from one within a run; the division keeps R orthogonal.
    return np.stack(rows) / (q @ q)
