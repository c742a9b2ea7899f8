"""Control law of the mean axes."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import (
    seen_from,
    task_drift,
    task_velocity,
    to_body,
    way_to,
)
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.truss_block import (
    ACCELERATION_UNITS,
    FORCE_UNITS,
    MODAL_RATE_UNIT,
    POSITION_UNITS,
    RATE_UNITS,
)


class MeanAxesLaw(MeanAxesBlock):
    r"""Path tracking with the mean axes, and damping of the lowest free modes.

    .. math::
        u_s &= G J_g^{-1} (\ddot y_d - \dot J_g \nu) + c - w \\
        u_f &= G J_g^{-1} \left[\omega^2 (y_d - y) + 2 \zeta\omega\, (\dot y_d - J_g \nu)\right] \\
        f   &= -2 \zeta_a \Omega \dot\eta

    with G, c and the actuation matrix P at the measured joints, so that joint torques compensate the buckling
    load of the thrust on the arms. The slow part :math:`u_s` does not excite the modes. The modal force of
    the feedback :math:`u_f` on the neutral modes is f, see `MeanAxesAllocation`. `at_rest` is 1 if
    :math:`\dot y_d = \ddot y_d = 0` and the norm of position and attitude error is below the resting error;
    the allocation then saves thrust.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time, bandwidths and damping.

    Raises
    ------
    ModelError
        If the truss has fewer modes than the design needs.
    """

    reference_position = Input("rigid_q", unit=POSITION_UNITS, meaning="y_d")
    reference_velocity = Input("rigid", unit=RATE_UNITS, meaning="dy_d/dt")
    reference_acceleration = Input(
        "rigid", unit=ACCELERATION_UNITS, meaning="d2y_d/dt2"
    )
    mean_position = Input("rigid_q", unit=POSITION_UNITS, meaning="y")
    mean_speeds = Input("rigid", unit=RATE_UNITS, meaning="nu")
    joint_angles = Input(
        "joints", unit=Attribute("joint_units"), meaning="joints while the command acts"
    )
    modal_rate = Input("modes", unit=MODAL_RATE_UNIT, meaning="d eta/dt")
    disturbance = Input("rigid", unit=FORCE_UNITS, default=0.0, meaning="w")
    slow_force = Output("rigid", unit=FORCE_UNITS, meaning="u_s")
    force = Output("rigid", unit=FORCE_UNITS, meaning="u_s + u_f")
    modal_force = Output(
        "neutral", meaning="f of the neutral modes, 0 of undamped ones"
    )
    actuation_matrix = Output(("rigid", "actuators"), meaning="P_r")
    inertia = Output(("rigid", "rigid"), meaning="G")
    at_rest = Output(meaning="1 while the path rests and is close, else 0")

    bandwidth = Parameter(
        shape=("rigid",), minimum=0.0, unit="rad/s", meaning="omega of each coordinate"
    )
    damping = Parameter(minimum=0.0, meaning="zeta")
    modal_damping = Parameter(minimum=0.0, meaning="zeta_a")
    resting_error = Parameter(
        minimum=0.0, unit="m", meaning="error limit of at_rest [m and rad]"
    )

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign) -> None:
        free = FreeModes.of(dynamics, max(design.neutral_modes, design.estimated_modes))
        self.neutral = design.neutral_modes
        self.damped_frequencies = free.frequencies[: design.damped_modes]
        super().__init__(
            dynamics,
            design,
            bandwidth=design.of_groups(design.bandwidth, dynamics.rigid_freedoms),
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the demands, and the matrices of their allocation."""
        y, nu, kind = u.mean_position, u.mean_speeds, self.dynamics.attitude
        terms = self.dynamics.evaluate(
            np.concatenate([y[: kind.end], u.joint_angles]), nu
        )
        inertia = terms.mass_matrix
        reference = u.reference_position, u.reference_velocity, u.reference_acceleration
        rate, acceleration = seen_from(kind, y, nu, *reference)
        rate_error = rate - task_velocity(kind, y, nu)
        way = way_to(kind, y, u.reference_position)
        correction = p.bandwidth**2 * way + 2 * p.damping * p.bandwidth * rate_error
        # dx_1/dt = J_g x_2, so the speeds need the rate J_g^-1 (a - dJ_g/dt x_2).
        wanted = to_body(kind, y, acceleration - task_drift(kind, y, nu))
        damped = len(self.damped_frequencies)
        braking = -2 * p.modal_damping * self.damped_frequencies * u.modal_rate[:damped]
        slow = inertia @ wanted + terms.bias - u.disturbance
        return {
            "slow_force": slow,
            "force": slow + inertia @ to_body(kind, y, correction),
            "modal_force": np.concatenate([braking, np.zeros(self.neutral - damped)]),
            "actuation_matrix": terms.actuation_matrix,
            "inertia": inertia,
            "at_rest": np.where(
                np.logical_or(
                    np.sum(np.concatenate(reference[1:]) ** 2) > 0.0,
                    np.sum(way[:6] ** 2) > p.resting_error**2,
                ),
                0.0,
                1.0,
            ),
        }
