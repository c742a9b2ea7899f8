"""Motors: the drives of an arm's joints, and reaction wheels on a base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.validation import finite_array, is_whole, shown
from trussflow.blocks.library.piecewise import limited
from trussflow.models.errors import ModelError
from trussflow.models.robots.joint import Joint
from trussflow.models.validation import unit_vectors


class JointDrives(Block):
    r"""Joint drives: limited torque, and friction.

    .. math:: \tau = \eta\,\mathrm{lim}(\tau_w, \pm\tau_{max}) - b\,\dot\theta
              - c \tanh(\dot\theta / \dot\theta_c) + \tau_b

    Their encoders are `Measurement.encoder`. A drive of no effectiveness η is limp, not locked.

    Parameters
    ----------
    joints : int or sequence of Joint
        Number of joints that turn, or all joints [-]; of those that slide all is in N and m. No drive gives
        more than the `effort` of its joint.
    torque : array_like
        Largest torque [N·m]; one for all, or one for each, as all below.
    viscous : array_like
        b: viscous friction [N·m·s/rad].
    coulomb : array_like
        c: Coulomb friction [N·m].
    transition : array_like
        Rate at which Coulomb friction turns round [rad/s]: below, a joint creeps, and
        c / transition acts like viscous friction. It must suit the joints' inertia and the
        solver's step.

    Raises
    ------
    BlockError
        If there is no joint, or one whose effort is 0.
    ParameterError
        If the largest torque or the transition is not above 0, or friction is negative.

    References
    ----------
    Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), *A survey of models, analysis tools and
    compensation methods for the control of machines with friction*, Automatica 30(7).
    """

    command = Input("joints", unit=Attribute("effort_units"), meaning="torques wanted")
    rate = Input("joints", unit=Attribute("rate_units"), default=0.0, meaning="joint rates")
    effectiveness = Input("joints", default=1.0, meaning="of the motors: 0 is limp")
    brake = Input(
        "joints", unit=Attribute("effort_units"), default=0.0, meaning="torques of brakes, beyond all limits"
    )
    torque = Output("joints", unit=Attribute("effort_units"), meaning="joint torques")
    maximum = Parameter(shape="joints", unit="N*m", above=0.0, meaning="largest torque")
    viscous = Parameter(shape="joints", unit="N*m*s/rad", minimum=0.0, meaning="viscous friction")
    coulomb = Parameter(shape="joints", unit="N*m", minimum=0.0, meaning="Coulomb friction")
    transition = Parameter(shape="joints", unit="rad/s", above=0.0, meaning="rate of full friction")

    def __init__(
        self,
        joints: int | Sequence[Joint],
        *,
        torque: npt.ArrayLike,
        viscous: npt.ArrayLike = 0.0,
        coulomb: npt.ArrayLike = 0.0,
        transition: npt.ArrayLike = 1e-3,
    ) -> None:
        self.effort_units: str | tuple[str, ...] = "N*m"
        self.rate_units: str | tuple[str, ...] = "rad/s"
        if isinstance(joints, Sequence) and joints and all(isinstance(joint, Joint) for joint in joints):
            self.joints = len(joints)
            limp = [joint.name for joint in joints if not joint.effort]
            if limp:
                raise BlockError(
                    f"JointDrives: joint {limp[0]!r} has a limit of effort of 0, so nothing drives it; raise "
                    "it, or make the joint a fixed one"
                )
            given = finite_array("JointDrives: torque", torque, (self.joints,))
            torque = np.minimum(given, [joint.effort for joint in joints])
            self.effort_units = tuple(joint.effort_unit for joint in joints)
            self.rate_units = tuple(f"{joint.unit}/s" for joint in joints)
        elif not isinstance(joints, Sequence) and is_whole(joints) and joints > 0:
            self.joints = joints
        else:
            raise BlockError(f"JointDrives needs at least one joint, not {shown(joints)}")
        super().__init__(maximum=torque, viscous=viscous, coulomb=coulomb, transition=transition)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the joint torques."""
        driven = u.effectiveness * limited(u.command, -p.maximum, p.maximum)
        friction = p.viscous * u.rate + p.coulomb * np.tanh(u.rate / p.transition)
        return {"torque": driven - friction + u.brake}


class ReactionWheels(Block):
    r"""Reaction wheels: torque on the base against the momentum of the wheels.

    With the axes as columns of A, momenta h and the wanted torque :math:`\tau_w`, the motors turn the
    wheels with

    .. math:: m = \mathrm{lim}(\eta\,[-A^+ \tau_w - u h], \pm m_{max}), \quad
              \dot h = \frac{m - d h}{1 + d T_s} - s, \quad \tau = -A \dot h - \omega \times A h

    u being the rate of unloading, which another actuator has to make up for, and s Coulomb
    friction: it takes what would turn the wheel after a sample, but at most c. The momentum stays
    within its limit: there the motor gives way.

    Parameters
    ----------
    axes : array_like, shape (m, 3)
        Unit vectors along the wheels' axes, base axes [1].
    sample_time : float
        Time for which a torque is held [s]; so all of this is exact.
    torque, momentum : array_like
        Largest torque of a motor [N·m], and momentum of a wheel [N·m·s]; one for all, or one for each.
    viscous : array_like
        d: viscous friction, divided by the wheel's inertia [1/s].
    coulomb : array_like
        c: Coulomb friction [N·m].

    Raises
    ------
    ModelError
        If an axis is no unit vector, or there is a direction about which no wheel turns.
    ParameterError
        If a limit is not above 0, or friction is negative.
    BlockError
        If the sample time is not above 0.

    Notes
    -----
    Friction takes the absolute momentum of a wheel for the one relative to the base.
    The effectiveness η, from 0 to 1, is that of the motors; a dead wheel still has friction.
    ω × A h is held for a sample like all of it. On a base that is free to nutate, at A h over its inertia,
    that gives the motion energy: leave the input open there, and add it continuously, as `Hardware` does.

    References
    ----------
    Sidi (1997), *Spacecraft Dynamics and Control*, chapter 7; Moreau (1988), *Unilateral contact
    and dry friction in finite freedom dynamics* (the friction of one sample).
    """

    demand = Input(3, unit="N*m", frame="base", meaning="torque wanted on the base")
    unloading = Input(unit="1/s", default=0.0, meaning="rate at which to give momentum away")
    effectiveness = Input(default=1.0, meaning="of the motors: 0 is dead")
    angular_velocity = Input(3, unit="rad/s", frame="base", default=0.0, meaning="of the base")
    torque = Output(3, unit="N*m", frame="base", meaning="torque on the base")
    unloading_torque = Output(3, unit="N*m", frame="base", meaning="part of it wanted for unloading")
    momentum = Output("wheels", unit="N*m*s", meaning="momentum of each wheel")
    stored = Output(3, unit="N*m*s", frame="base", meaning="A h: momentum of all together")
    h = State("wheels", unit="N*m*s", meaning="momentum of each wheel")
    maximum_torque = Parameter(shape="wheels", unit="N*m", above=0.0, meaning="largest torque of a motor")
    maximum_momentum = Parameter(shape="wheels", unit="N*m*s", above=0.0, meaning="largest momentum")
    viscous = Parameter(shape="wheels", unit="1/s", minimum=0.0, meaning="viscous friction / inertia")
    coulomb = Parameter(shape="wheels", unit="N*m", minimum=0.0, meaning="Coulomb friction")

    def __init__(
        self,
        axes: npt.ArrayLike,
        sample_time: float,
        *,
        torque: npt.ArrayLike,
        momentum: npt.ArrayLike,
        viscous: npt.ArrayLike = 0.0,
        coulomb: npt.ArrayLike = 0.0,
    ) -> None:
        directions = unit_vectors("reaction wheels: axis", axes)
        if np.linalg.matrix_rank(directions) < 3:
            blind = np.linalg.svd(directions)[2][-1]
            raise ModelError(
                f"reaction wheels: none turns about the direction {blind.round(3).tolist()}; add a wheel"
            )
        self.axes, self.wheels = directions.T, len(directions)
        self.sharing = np.linalg.pinv(self.axes)
        super().__init__(maximum_torque=torque, maximum_momentum=momentum, viscous=viscous, coulomb=coulomb)
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return torques and momenta."""
        gyroscopic = np.cross(u.angular_velocity, self.axes @ x.h)
        return {
            "torque": -(self.axes @ self._rate(x, u, p)) - gyroscopic,
            "unloading_torque": self.axes @ (u.unloading * x.h),
            "momentum": x.h,
            "stored": self.axes @ x.h,
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the momenta one sample later."""
        return {"h": x.h + self.sample_time * self._rate(x, u, p)}

    def _rate(self, x: Signals, u: Signals, p: Signals) -> Array:
        """Return the mean rate of momentum over the sample."""
        step = self.sample_time
        wanted = u.effectiveness * (-(self.sharing @ u.demand) - u.unloading * x.h)
        motor = limited(wanted, -p.maximum_torque, p.maximum_torque)
        free = (motor - p.viscous * x.h) / (1.0 + p.viscous * step)
        rate = free - limited(x.h / step + free, -p.coulomb, p.coulomb)
        return limited(rate, (-p.maximum_momentum - x.h) / step, (p.maximum_momentum - x.h) / step)
