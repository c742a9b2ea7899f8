"""Sparing propellant and wheels: what the allocation is to pay for each actuator, and to prefer."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array, Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock


class ActuatorEconomy(MeanAxesBlock):
    r"""Make the thrust of bases that have used more propellant dearer, and unload the wheels by thrust.

    .. math::
        c_i = 1 + \frac{\max(0,\ m_i - \bar m)}{m_0}, \qquad
        \tau_{0,i} = \mathrm{lim}\!\left(\frac{h_i}{T_u},\ \pm\tfrac12 \tau_{max,i}\right)

    for the three forces and the three torques of base i, with the propellant m that it has used, the mean
    over all bases, and the momentum h that its wheels hold, in its axes. A base that gets the torque
    :math:`h / T_u` takes h back in :math:`T_u`. The allocation prefers it among all commands that do the
    same to the truss, so other actuators make up for it: the wheels are unloaded without a thruster of
    their own, and nothing else feels it.

    Parameters
    ----------
    dynamics : TrussDynamics
        Which robots there are.
    limits : Vector, shape (actuators,)
        Of each actuator in either direction [N, N·m].
    design : MeanAxesDesign
        Sample time, m_0 and T_u.

    See Also
    --------
    trussflow.models.mean_axes.allocation.MeanAxesAllocation : What it makes of both.
    """

    propellant = Input("robots", unit="kg", default=0.0, meaning="m: used by each base")
    momentum = Input("stored", unit="N*m*s", default=0.0, meaning="h: held by the wheels of each base")
    price = Output("actuators", unit="1", meaning="c, 1 for torques and joints")
    preferred = Output("actuators", unit=Attribute("actuator_units"), meaning="Q_0, 0 but for base torques")

    limits = Parameter(shape="actuators", above=0.0, meaning="of each actuator")
    propellant_spread = Parameter(above=0.0, unit="kg", meaning="m_0: what is used more, where c is 2")
    unloading_time = Parameter(above=0.0, unit="s", meaning="T_u")

    def __init__(self, dynamics: TrussDynamics, limits: Vector, design: MeanAxesDesign) -> None:
        self.robots, self.stored = len(dynamics.arms), 3 * len(dynamics.arms)
        super().__init__(
            dynamics,
            design,
            limits=limits,
            propellant_spread=design.propellant_spread,
            unloading_time=design.unloading_time,
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return prices and preferences."""
        more = np.maximum(0.0, u.propellant - np.sum(u.propellant) / self.robots)
        ones, zeros = np.ones(3), np.zeros(3)
        price, preferred = [], []
        for i in range(self.robots):
            half = 0.5 * p.limits[6 * i + 3 : 6 * i + 6]
            torque = np.clip(u.momentum[3 * i : 3 * i + 3] / p.unloading_time, -half, half)
            price += [(1.0 + more[i] / p.propellant_spread) * ones, ones]
            preferred += [zeros, torque]
        return {
            "price": np.concatenate([*price, np.ones(self.joints)]),
            "preferred": np.concatenate([*preferred, np.zeros(self.joints)]),
        }
