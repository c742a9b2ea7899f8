"""Control allocation of the mean-axes law to limited actuators."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.control.bounded_least_squares import bounded_least_squares
from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.library.piecewise import limited
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.linear_algebra import block_diagonal
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock, thrusts_of
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.truss_block import ACTUATOR_UNITS, FORCE_UNITS


class MeanAxesAllocation(MeanAxesBlock):
    r"""Constrained control allocation of the mean-axes law in two steps: slow part, then whole demand.

    .. math::
        Q_s &= \operatorname{argmin}_{|Q| \le \lambda h} \; (P Q - u_s)^T G^{-1} (P Q - u_s)
               + \epsilon \sum_k (c_k (Q - Q_0)_k / h_k)^2 \\
        Q &= \operatorname{argmin}_{|Q| \le h} \; (P Q - u)^T G^{-1} (P Q - u) + n\,|B (Q - Q_s) - f|^2
             + \epsilon \sum_k (r_k c_k (Q - Q_s)_k / h_k)^2

    The weight of errors is the kinetic energy that they cause. By Gauss's principle of least constraint the
    arm of a failed robot then moves freely: its joint errors are not corrected, and the others account for
    its motion. The first priority is the task. The second one is the modal force f of the feedback, zero
    except for damping. The third one is the distance of the actuators from their limits, which are h times
    the health of each. r is the additional weight of thrusts and joint torques in the feedback. The feedback
    always has at least the share :math:`1 - \lambda` of each limit. At rest near the reference, the feedback
    makes no thrust above q unless the slow part does. The excitation :math:`Q_p` by `ActuatorExcitation` is added
    within the limits, also to failed actuators: it shows whether they work again.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    limits : Vector, shape (actuators,)
        Limit of each actuator in either direction, h, positive [N, N·m].
    design : MeanAxesDesign
        Sample time and weights.

    Raises
    ------
    ModelError
        If the truss has fewer modes than the design needs.
    ParameterError
        If a limit is not positive.

    See Also
    --------
    trussflow.blocks.control.allocation.BoundedAllocation : Constrained allocation of one demand.
    """

    slow_force = Input("rigid", unit=FORCE_UNITS, meaning="u_s")
    force = Input("rigid", unit=FORCE_UNITS, meaning="u, slow part and feedback")
    modal_force = Input("neutral", meaning="f")
    actuation_matrix = Input(("rigid", "actuators"), meaning="P")
    inertia = Input(("rigid", "rigid"), meaning="G")
    at_rest = Input(default=0.0, meaning="1 if the reference rests and is near, else 0")
    effectiveness = Input(
        "actuators", default=1.0, meaning="health, factor of the limits: 0 is failed"
    )
    price = Input(
        "actuators", default=1.0, meaning="c, positive cost factor of each actuator"
    )
    preferred = Input(
        "actuators", unit=ACTUATOR_UNITS, default=0.0, meaning="Q_0, without cost"
    )
    probe = Input("actuators", unit=ACTUATOR_UNITS, default=0.0, meaning="Q_p")
    command = Output("actuators", unit=ACTUATOR_UNITS, meaning="Q + Q_p, within h")
    missed = Output("rigid", unit=FORCE_UNITS, meaning="u - P Q")

    limits = Parameter(shape="actuators", above=0.0, meaning="h")
    effort = Parameter(above=0.0, meaning="epsilon, cost of an actuator at its limit")
    reluctance = Parameter(shape="actuators", above=0.0, meaning="r")
    neutrality = Parameter(above=0.0, meaning="n, cost of work on the neutral modes")
    slow_share = Parameter(
        above=0.0, meaning="lambda, share of the limits for the slow part"
    )
    resting_thrust = Parameter(
        above=0.0, unit="N", meaning="q, thrust limit of the feedback at rest"
    )

    def __init__(
        self, dynamics: TrussDynamics, limits: Vector, design: MeanAxesDesign
    ) -> None:
        self.neutral = design.neutral_modes
        self.influence = FreeModes.of(dynamics, self.neutral).influence
        robots = len(dynamics.arms)
        self.thrusts = thrusts_of(dynamics)
        base = np.where(np.arange(6) < 3, design.thrust_reluctance, 1.0)
        super().__init__(
            dynamics,
            design,
            limits=limits,
            reluctance=np.append(
                np.tile(base, robots), np.full(dynamics.joints, design.joint_reluctance)
            ),
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the commands and the unmet demand."""
        reach = p.limits * u.effectiveness
        weights = np.sqrt(p.effort) * u.price / p.limits
        slow, _ = bounded_least_squares(
            u.actuation_matrix,
            u.inertia,
            u.slow_force,
            weights,
            u.preferred,
            -p.slow_share * reach,
            p.slow_share * reach,
        )
        # At rest one thrust step suffices; demands of a second step are noise of the feedback.
        most = np.where(
            self.thrusts * u.at_rest > 0.5, np.minimum(p.resting_thrust, reach), reach
        )
        command, missed = bounded_least_squares(
            np.concatenate([u.actuation_matrix, self.influence]),
            block_diagonal(u.inertia, np.eye(self.neutral) / p.neutrality),
            np.concatenate([u.force, u.modal_force + self.influence @ slow]),
            p.reluctance * weights,
            slow,
            np.maximum(-reach, np.minimum(slow, -most)),
            np.minimum(reach, np.maximum(slow, most)),
        )
        return {
            "command": limited(command + u.probe, -p.limits, p.limits),
            "missed": missed[: self.rigid],
        }
