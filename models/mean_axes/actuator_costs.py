"""Actuator costs and preferred torques, to balance propellant use and to unload the wheels."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock
from trussflow.models.plant.truss_block import ACTUATOR_UNITS


class ActuatorCosts(MeanAxesBlock):
    r"""Costs of thrust by propellant use, and preferred base torques that unload the wheels.

    .. math::
        c_i = 1 + \frac{\max(0,\ m_i - \bar m)}{m_0}, \qquad
        \tau_{0,i} = \mathrm{lim}\!\left(\frac{h_i}{T_u},\ \pm\tfrac12 \tau_{max,i}\right)

    for the three forces and the three torques of base i. m is the propellant used by the base,
    :math:`\bar m` its mean over all bases, and h the momentum of its wheels in base axes. The base torque
    :math:`h / T_u` unloads the wheels with the time constant :math:`T_u`. The allocation prefers it among
    all commands with the same effect on the truss, so that other actuators compensate for it. So no base
    needs torque thrusters.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    limits : Vector, shape (actuators,)
        Limit of each actuator in either direction [N, N·m].
    design : MeanAxesDesign
        Sample time, m_0 and T_u.

    See Also
    --------
    trussflow.models.mean_axes.allocation.MeanAxesAllocation : Allocation with these costs.
    """

    propellant = Input(
        "robots", unit="kg", default=0.0, meaning="m, propellant used by each base"
    )
    momentum = Input(
        "stored",
        unit="N*m*s",
        default=0.0,
        meaning="h, momentum of the wheels of each base",
    )
    price = Output("actuators", unit="1", meaning="c, 1 for torques and joints")
    preferred = Output(
        "actuators", unit=ACTUATOR_UNITS, meaning="Q_0, 0 except base torques"
    )

    limits = Parameter(shape="actuators", above=0.0, meaning="limit of each actuator")
    propellant_spread = Parameter(
        above=0.0, unit="kg", meaning="m_0, excess propellant use with c = 2"
    )
    unloading_time = Parameter(above=0.0, unit="s", meaning="T_u")

    def __init__(
        self, dynamics: TrussDynamics, limits: Vector, design: MeanAxesDesign
    ) -> None:
        self.stored = 3 * len(dynamics.arms)
        super().__init__(dynamics, design, limits=limits)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return costs and preferred commands."""
        more = np.maximum(0.0, u.propellant - np.sum(u.propellant) / self.robots)
        ones, zeros = np.ones(3), np.zeros(3)
        price, preferred = [], []
        for i in range(self.robots):
            half = 0.5 * p.limits[6 * i + 3 : 6 * i + 6]
            torque = np.clip(
                u.momentum[3 * i : 3 * i + 3] / p.unloading_time, -half, half
            )
            price += [(1.0 + more[i] / p.propellant_spread) * ones, ones]
            preferred += [zeros, torque]
        return {
            "price": np.concatenate([*price, np.ones(self.joints)]),
            "preferred": np.concatenate([*preferred, np.zeros(self.joints)]),
        }
