"""What a controller knows about the truss: the model behind the control law."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.geometry.rotation import (
    euler_rate_matrix,
    euler_rate_matrix_derivative,
    euler_rate_matrix_inverse,
    euler_rotation,
)
from trussflow.models.plant.space_truss import SpaceTruss

ACCELERATIONS = Attribute("acceleration_units")


class _BelievedDynamics(Block):
    """What the blocks below share: the dynamics believed in, with its sizes, units and state."""

    coordinates = Input("n", unit=Attribute("coordinate_units"), meaning="q")
    speeds = Input("n", unit=Attribute("speed_units"), meaning="v")

    def __init__(self, dynamics: TrussDynamics) -> None:
        self.dynamics = dynamics
        self.n, self.actuators = dynamics.coordinates, dynamics.actuators
        self.rigid = dynamics.rigid_coordinates
        plant = SpaceTruss(dynamics)
        self.coordinate_units, self.speed_units = plant.coordinate_units, plant.speed_units
        self.acceleration_units, self.actuator_units = plant.disturbance_units, plant.actuator_units
        super().__init__()


class NominalModel(_BelievedDynamics):
    r"""Inverse dynamics of the rigid motion, and the actuation matrices.

    With :math:`G = M_{rr}`, :math:`c = F_r^{I,nl}` and :math:`\dot x_1 = J_g x_2`,

    .. math:: u = c + G\,[J_g^{-1}(a - \dot J_g x_2) - \hat d], \qquad
              a = a_\mathrm{ff} + a_\mathrm{fb}

    makes :math:`\ddot x_1 = a + J_g (d - \hat d)`. This is :math:`u_{eq} + u_{sw} + u_{ff}` of
    the source, with `feedforward` :math:`a_\mathrm{ff} = \ddot x_{1d}` and `feedback`
    :math:`a_\mathrm{fb}` the sliding-mode terms.

    Parameters
    ----------
    dynamics : TrussDynamics
        The model that the controller believes in; usually the plant's own.

    Notes
    -----
    `nominal_acceleration` is :math:`G^{-1}(u - c)`, which the disturbance observer needs. Since
    :math:`u` is made from it, it is the bracket above and costs no solution of equations;
    `NominalAcceleration` computes it from any actuation.

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 42–45, 53–55, 63.
    """

    feedforward = Input("rigid", unit=ACCELERATIONS, default=0.0, meaning="desired d2x_1/dt2")
    feedback = Input("rigid", unit=ACCELERATIONS, default=0.0, meaning="correction of d2x_1/dt2")
    disturbance_estimate = Input("rigid", unit=ACCELERATIONS, default=0.0, meaning="estimate of d")
    task_force = Input("rigid", default=0.0, meaning="force and torque in task axes, for laws such as PD")
    generalized_force = Output("rigid", meaning="u")
    feedforward_force = Output("rigid", meaning="part of u that moves along the desired path")
    feedback_force = Output("rigid", meaning="part of u that corrects errors and disturbances")
    transformed_task_force = Output("rigid", meaning="J_g^T times the task force")
    nominal_acceleration = Output("rigid", unit=ACCELERATIONS, meaning="G^-1 (u - c)")
    actuation_matrix = Output(("rigid", "actuators"), meaning="P_r, the rigid rows of P_Q")
    full_actuation_matrix = Output(("n", "actuators"), meaning="P_Q, the modal rows included")

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return forces, nominal acceleration and actuation matrices."""
        rigid = self.rigid
        terms = self.dynamics.evaluate(u.coordinates, u.speeds)
        g, c = terms.mass_matrix[:rigid, :rigid], terms.bias[:rigid]
        attitude, speeds = u.coordinates[3:6], u.speeds[:rigid]
        ahead = to_body(attitude, u.feedforward - task_drift(attitude, speeds))
        correction = to_body(attitude, u.feedback) - u.disturbance_estimate
        return {
            "generalized_force": c + g @ (ahead + correction),
            "feedforward_force": c + g @ ahead,
            "feedback_force": g @ correction,
            "transformed_task_force": task_force_to_body(attitude, u.task_force),
            "nominal_acceleration": ahead + correction,
            "actuation_matrix": terms.actuation_matrix[:rigid],
            "full_actuation_matrix": terms.actuation_matrix,
        }


class NominalAcceleration(_BelievedDynamics):
    r"""Forward nominal dynamics :math:`G^{-1}(P_r Q - c)` for any actuation.

    Use it for the disturbance observer where the actuation is not what the inverse dynamics
    asked for: behind saturations, or with another control law.

    Parameters
    ----------
    dynamics : TrussDynamics
        The model that the controller believes in.

    References
    ----------
    Li, Wei, Chen (2026), Eq. 46.
    """

    actuation = Input("actuators", unit=Attribute("actuator_units"), meaning="Q")
    nominal_acceleration = Output("rigid", unit=ACCELERATIONS, meaning="G^-1 (P_r Q - c)")

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the nominal acceleration."""
        rigid = self.rigid
        terms = self.dynamics.evaluate(u.coordinates, u.speeds)
        force = terms.actuation_matrix[:rigid] @ u.actuation - terms.bias[:rigid]
        return {"nominal_acceleration": solve_positive_definite(terms.mass_matrix[:rigid, :rigid], force)}


def to_body(attitude: Array, task: Array) -> Array:
    r"""Return :math:`J_g^{-1} y`, task-space rates in the axes of the generalized speeds.

    Parameters
    ----------
    attitude : array, shape (3,)
        3-1-2 Euler angles [rad].
    task : array, shape (m,)
        Components along inertial axes, of Euler angles, and of joints; of a rate or, without
        the drift, of an acceleration.
    """
    linear = euler_rotation(attitude).T @ task[:3]
    angular = euler_rate_matrix(attitude) @ task[3:6]
    return np.concatenate([linear, angular, task[6:]])


def task_drift(attitude: Array, speeds: Array) -> Array:
    r"""Return :math:`\dot J_g x_2`, the task acceleration at constant generalized speeds.

    .. math:: \frac{d}{dt}(R_t) v_t = R_t (\omega_t \times v_t), \qquad
              \frac{d}{dt}(A^{-1})\,\omega_t = -A^{-1} \dot A\, \dot\Theta_t

    Parameters
    ----------
    attitude : array, shape (3,)
        3-1-2 Euler angles [rad].
    speeds : array, shape (m,)
        :math:`x_2`, truss velocities in truss axes [m/s, rad/s].
    """
    inverse = euler_rate_matrix_inverse(attitude)
    rates = inverse @ speeds[3:6]
    linear = euler_rotation(attitude) @ np.cross(speeds[3:6], speeds[:3])
    angular = -(inverse @ (euler_rate_matrix_derivative(attitude, rates) @ rates))
    return np.concatenate([linear, angular, np.zeros(speeds.shape[0] - 6)])


def task_force_to_body(attitude: Array, force: Array) -> Array:
    r"""Return :math:`J_g^T f`, the generalized force that does the same work as a task force.

    Parameters
    ----------
    attitude : array, shape (3,)
        3-1-2 Euler angles [rad].
    force : array, shape (m,)
        Inertial force [N], moments conjugate to Euler angles [N·m], joint torques [N·m].
    """
    linear = euler_rotation(attitude).T @ force[:3]
    angular = euler_rate_matrix_inverse(attitude).T @ force[3:6]
    return np.concatenate([linear, angular, force[6:]])
