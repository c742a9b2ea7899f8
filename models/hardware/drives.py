"""The drives of an arm's joints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.errors import BlockError
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.validation import is_whole, shown
from trussflow.blocks.library.piecewise import limited


class JointDrives(Block):
    r"""Joint drives: limited torque, and friction.

    .. math:: \tau = \eta\,\mathrm{lim}(\tau_w, \pm\tau_{max}) - b\,\dot\theta
              - c \tanh(\dot\theta / \dot\theta_c)

    Their encoders are `Measurement.encoder`. A drive of no effectiveness η is limp, not locked.

    Parameters
    ----------
    joints : int
        Number of joints [-].
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
        If there is no joint.
    ParameterError
        If the largest torque or the transition is not above 0, or friction is negative.

    References
    ----------
    Armstrong-Hélouvry, Dupont, Canudas de Wit (1994), *A survey of models, analysis tools and
    compensation methods for the control of machines with friction*, Automatica 30(7).
    """

    command = Input("joints", unit="N*m", meaning="torques wanted")
    rate = Input("joints", unit="rad/s", default=0.0, meaning="joint rates")
    effectiveness = Input("joints", default=1.0, meaning="of the motors: 0 is limp")
    torque = Output("joints", unit="N*m", meaning="joint torques")
    maximum = Parameter(shape="joints", unit="N*m", above=0.0, meaning="largest torque")
    viscous = Parameter(shape="joints", unit="N*m*s/rad", minimum=0.0, meaning="viscous friction")
    coulomb = Parameter(shape="joints", unit="N*m", minimum=0.0, meaning="Coulomb friction")
    transition = Parameter(shape="joints", unit="rad/s", above=0.0, meaning="rate of full friction")

    def __init__(
        self,
        joints: int,
        *,
        torque: npt.ArrayLike,
        viscous: npt.ArrayLike = 0.0,
        coulomb: npt.ArrayLike = 0.0,
        transition: npt.ArrayLike = 1e-3,
    ) -> None:
        if not is_whole(joints) or joints < 1:
            raise BlockError(f"JointDrives needs at least one joint, not {shown(joints)}")
        self.joints = joints
        super().__init__(maximum=torque, viscous=viscous, coulomb=coulomb, transition=transition)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the joint torques."""
        driven = u.effectiveness * limited(u.command, -p.maximum, p.maximum)
        friction = p.viscous * u.rate + p.coulomb * np.tanh(u.rate / p.transition)
        return {"torque": driven - friction}
