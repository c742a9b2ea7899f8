"""Motors: joint drives of the arms with their brakes, and reaction wheels of a base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import finite_array, shown
from trussflow.models.errors import ModelError
from trussflow.models.robots.joint import Joint
from trussflow.models.validation import unit_vectors


class JointBlock(Block):
    """Base of the blocks with one element per joint: their number and units."""

    def set_joints(self, joints: Sequence[Joint]) -> None:
        """Set the number and the units of the joints.

        Parameters
        ----------
        joints : sequence of Joint
            All joints.

        Raises
        ------
        BlockError
            If there is no joint.
        """
        if not (
            isinstance(joints, list | tuple)
            and joints
            and all(isinstance(joint, Joint) for joint in joints)
        ):
            raise BlockError(
                f"{type(self).__name__} needs a sequence of at least one Joint, not {shown(joints)}"
            )
        self.joint_data, self.joints = tuple(joints), len(joints)
        self.joint_units = tuple(joint.unit for joint in joints)
        self.rate_units = tuple(f"{joint.unit}/s" for joint in joints)
        self.effort_units = tuple(joint.effort_unit for joint in joints)


class JointDrives(JointBlock):
    r"""Geared joint drives with limited torque, friction and a power-off brake.

    .. math:: \tau = (1 - e)\,\eta\,\mathrm{lim}(\tau_w, \pm\tau_{max}) - b\,\dot\theta
              - c \tanh(\dot\theta / \dot\theta_c) - e\,[k_b (\theta - \theta_b) + d_b \dot\theta]

    A drive with health η = 0 makes no torque; its joint is free unless the brake is engaged, e = 1. The brake
    is a spring and a damper about the joint coordinate :math:`\theta_b` at its engagement, see `BrakeLatch`.

    Parameters
    ----------
    joints : sequence of Joint
        All joints, at least one. Sliding joints have the units N and m. The `effort` of a joint also limits
        its drive.
    torque : array_like
        Maximum torque [N·m]; one value for all joints or one each, as for all parameters below.
    viscous : array_like
        Viscous friction, b [N·m·s/rad].
    coulomb : array_like
        Coulomb friction, c [N·m].
    transition : array_like
        Rate at which Coulomb friction changes its sign [rad/s]. Below it c / transition acts like viscous
        friction. Choose it by the inertia of the joints and the step of the solver.
    reflected_inertia : array_like
        Square of the gear ratio times the inertia of the rotor [kg·m²; kg of sliding joints].
    brake_stiffness, brake_damping : array_like
        Stiffness k_b [N·m/rad] and damping d_b [N·m·s/rad] of the engaged brake.

    Attributes
    ----------
    reflected_inertia : array, shape (joints,)
        Inertia of the drives. It belongs into the equations of motion: `TrussDynamics.with_drives`.

    Raises
    ------
    BlockError
        If there is no joint, or the effort of a joint is 0.
    ParameterError
        If maximum torque or transition is not positive, or friction, stiffness or damping is negative.

    References
    ----------
    Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), *A survey of models, analysis tools and
    compensation methods for the control of machines with friction*, Automatica 30(7).
    """

    command = Input(
        "joints", unit=Attribute("effort_units"), meaning="commanded torques"
    )
    angle = Input(
        "joints",
        unit=Attribute("joint_units"),
        default=0.0,
        meaning="joint coordinates",
    )
    rate = Input(
        "joints", unit=Attribute("rate_units"), default=0.0, meaning="joint rates"
    )
    effectiveness = Input(
        "joints", default=1.0, meaning="health of the motors: 0 is failed"
    )
    engaged = Input(
        "joints", default=0.0, meaning="e, 1 for engaged brakes, otherwise 0"
    )
    held = Input(
        "joints",
        unit=Attribute("joint_units"),
        default=0.0,
        meaning="theta_b, joint coordinates that the brakes hold",
    )
    torque = Output("joints", unit=Attribute("effort_units"), meaning="joint torques")
    maximum = Parameter(shape="joints", unit="N*m", above=0.0, meaning="maximum torque")
    viscous = Parameter(
        shape="joints", unit="N*m*s/rad", minimum=0.0, meaning="viscous friction"
    )
    coulomb = Parameter(
        shape="joints", unit="N*m", minimum=0.0, meaning="Coulomb friction"
    )
    transition = Parameter(
        shape="joints",
        unit="rad/s",
        above=0.0,
        meaning="rate of the friction's sign change",
    )
    brake_stiffness = Parameter(
        shape="joints", unit="N*m/rad", minimum=0.0, meaning="k_b"
    )
    brake_damping = Parameter(
        shape="joints", unit="N*m*s/rad", minimum=0.0, meaning="d_b"
    )

    def __init__(
        self,
        joints: Sequence[Joint],
        *,
        torque: npt.ArrayLike,
        viscous: npt.ArrayLike = 0.0,
        coulomb: npt.ArrayLike = 0.0,
        transition: npt.ArrayLike = 1e-3,
        reflected_inertia: npt.ArrayLike = 0.0,
        brake_stiffness: npt.ArrayLike = 0.0,
        brake_damping: npt.ArrayLike = 0.0,
    ) -> None:
        self.set_joints(joints)
        limp = [joint.name for joint in joints if not joint.effort]
        if limp:
            raise BlockError(
                f"JointDrives: joint {limp[0]!r} has an effort limit of 0; increase it, or make the "
                "joint a fixed one"
            )
        sizes = (self.joints,)
        given = finite_array("JointDrives: torque", torque, sizes)
        self.reflected_inertia = finite_array(
            "JointDrives: reflected_inertia", reflected_inertia, sizes
        )
        super().__init__(
            maximum=np.minimum(given, [joint.effort for joint in joints]),
            viscous=viscous,
            coulomb=coulomb,
            transition=transition,
            brake_stiffness=brake_stiffness,
            brake_damping=brake_damping,
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the joint torques."""
        driven = u.effectiveness * limited(u.command, -p.maximum, p.maximum)
        # A smooth sign function, since the solver needs derivatives at standstill.
        friction = p.viscous * u.rate + p.coulomb * np.tanh(u.rate / p.transition)
        brake = p.brake_stiffness * (u.angle - u.held) + p.brake_damping * u.rate
        return {"torque": driven - friction + u.engaged * (-brake - driven)}


class BrakeLatch(JointBlock):
    """Power-off brakes: engagement, and the joint coordinates that the brakes hold; sampled.

    A brake is engaged while its drive has no power (health 0) or its command is above 0.5. It holds the joint
    where it is at the first such sample.

    Parameters
    ----------
    joints : sequence of Joint
        All joints, at least one.
    sample_time : float
        Sample time [s].

    Raises
    ------
    BlockError
        If there is no joint, or the sample time is not positive.
    """

    angle = Input("joints", unit=Attribute("joint_units"), meaning="joint coordinates")
    effectiveness = Input("joints", default=1.0, meaning="health of the motors")
    command = Input("joints", default=0.0, meaning="above 0.5 engages the brake")
    engaged = Output("joints", meaning="1 for engaged brakes, otherwise 0")
    held = Output(
        "joints", unit=Attribute("joint_units"), meaning="coordinates at engagement"
    )
    before = State("joints", meaning="engagement at the previous sample")
    place = State("joints", meaning="coordinates at engagement")

    def __init__(self, joints: Sequence[Joint], sample_time: float) -> None:
        self.set_joints(joints)
        super().__init__()
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return engagement and held coordinates."""
        off = np.logical_or(u.effectiveness <= 0.0, u.command > 0.5)
        return {
            "engaged": np.where(off, 1.0, 0.0),
            "held": np.where(x.before > 0.5, x.place, u.angle),
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Store engagement and held coordinates."""
        now = self.output(t, x, u, p)
        return {"before": now["engaged"], "place": now["held"]}


class ReactionWheels(Block):
    r"""Reaction wheels: torque on the base, and momentum of the wheels.

    With the axes as columns of A, momenta h and the commanded torque :math:`\tau_w`, the motor torques are

    .. math:: m = \mathrm{lim}(\eta\,[-A^+ \tau_w - u h], \pm m_{max}), \quad
              \dot h = \frac{m - d h}{1 + d T_s} - s, \quad \tau = -A \dot h

    u is the rate of unloading, for which another actuator must compensate. s is Coulomb friction: it
    reduces the momentum after the sample towards zero, by a torque of at most c. Saturation of the
    momentum reduces the motor torque.

    Parameters
    ----------
    axes : array_like, shape (m, 3)
        Unit vectors along the axes of the wheels, in base axes [1].
    sample_time : float
        Time for which a torque is held [s]; with it these equations are exact.
    torque, momentum : array_like
        Maximum torque of a motor [N·m], and momentum of a wheel [N·m·s]; one value for all, or one each.
    viscous : array_like
        Viscous friction divided by the inertia of the wheel, d [1/s].
    coulomb : array_like
        Coulomb friction, c [N·m].

    Raises
    ------
    ModelError
        If an axis is not a unit vector, or the axes do not span three dimensions.
    ParameterError
        If a limit is not positive, or friction is negative.
    BlockError
        If the sample time is not positive.

    Notes
    -----
    Friction uses the absolute momentum of a wheel instead of that relative to the base.
    The health η, from 0 to 1, is that of the motors; a failed wheel still has friction.
    The torque -ω × A h of a base with the rate ω is not included: a hold of this term would add energy to
    the nutation of the base. `Hardware` adds it continuously.

    References
    ----------
    Sidi (1997), *Spacecraft Dynamics and Control*, chapter 7; Moreau (1988), *Unilateral contact
    and dry friction in finite freedom dynamics* (the friction of one sample).
    """

    demand = Input(3, unit="N*m", frame="base", meaning="commanded torque on the base")
    unloading = Input(unit="1/s", default=0.0, meaning="rate of unloading")
    effectiveness = Input(default=1.0, meaning="health of the motors: 0 is failed")
    torque = Output(3, unit="N*m", frame="base", meaning="torque on the base")
    unloading_torque = Output(
        3, unit="N*m", frame="base", meaning="part of it for unloading"
    )
    momentum = Output("wheels", unit="N*m*s", meaning="momentum of each wheel")
    stored = Output(
        3, unit="N*m*s", frame="base", meaning="A h, total momentum of the wheels"
    )
    h = State("wheels", unit="N*m*s", meaning="momentum of each wheel")
    maximum_torque = Parameter(
        shape="wheels", unit="N*m", above=0.0, meaning="maximum torque of a motor"
    )
    maximum_momentum = Parameter(
        shape="wheels", unit="N*m*s", above=0.0, meaning="maximum momentum"
    )
    viscous = Parameter(
        shape="wheels", unit="1/s", minimum=0.0, meaning="viscous friction / inertia"
    )
    coulomb = Parameter(
        shape="wheels", unit="N*m", minimum=0.0, meaning="Coulomb friction"
    )

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
            # The last right singular vector is the direction that the axes span least.
            blind = np.linalg.svd(directions)[2][-1]
            raise ModelError(
                f"reaction wheels: none has a torque along {blind.round(3).tolist()}; add a wheel"
            )
        self.axes, self.wheels = directions.T, len(directions)
        self.sharing = np.linalg.pinv(self.axes)
        super().__init__(
            maximum_torque=torque,
            maximum_momentum=momentum,
            viscous=viscous,
            coulomb=coulomb,
        )
        self.sampled(sample_time)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return torques and momenta."""
        return {
            "torque": -(self.axes @ self._rate(x, u, p)),
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
        # Implicit Euler, which is stable for any friction and sample time.
        free = (motor - p.viscous * x.h) / (1.0 + p.viscous * step)
        # Coulomb friction can stop a wheel within the sample, but never reverse it.
        rate = free - limited(x.h / step + free, -p.coulomb, p.coulomb)
        # The momentum at the end of the sample is within its limits.
        return limited(
            rate, (-p.maximum_momentum - x.h) / step, (p.maximum_momentum - x.h) / step
        )
