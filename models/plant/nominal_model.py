"""Nominal model of the truss and its robots, as blocks for model-based controllers."""

from __future__ import annotations

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.task_space import (
    seen_from,
    task_drift,
    task_force_to_body,
    to_body,
    way_to,
)
from trussflow.models.plant.truss_block import (
    ACCELERATION_UNITS,
    POSITION_UNITS,
    RATE_UNITS,
    SPEEDS,
    TrussBlock,
)

TASK = Attribute("task_labels")


class NominalModel(TrussBlock):
    r"""Inverse dynamics of the rigid motion, and the actuation matrices.

    With :math:`G = M_{rr}`, :math:`c = F_r^{I,nl}` and :math:`\dot x_1 = J_g x_2`,

    .. math:: u = c + G\,[J_g^{-1}(a - \dot J_g x_2) - \hat d], \qquad
              a = a_\mathrm{ff} + a_\mathrm{fb}

    makes :math:`\ddot x_1 = a + J_g (d - \hat d)`. This is :math:`u_{eq} + u_{sw} + u_{ff}` of
    the paper, if `feedforward` is :math:`a_\mathrm{ff} = \ddot x_{1d}` and `feedback`
    :math:`a_\mathrm{fb}` the sum of the sliding-mode terms.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal model of the controller, usually the plant's own dynamics.

    Notes
    -----
    `nominal_acceleration` is :math:`G^{-1}(u - c)`, an input of the disturbance observer. It
    equals the bracket above, so that no linear system is solved.

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 42–45, 53–55, 63.
    """

    _symbol = Symbol("c + G (J^(−1)(a − J̇ v) − d̂)")
    coordinates = Input("nq", unit=Attribute("coordinate_units"), meaning="q")
    speeds = Input("n", unit=Attribute("speed_units"), meaning="v")
    feedforward = Input(
        "rigid", unit=ACCELERATION_UNITS, default=0.0, meaning="desired d2x_1/dt2"
    )
    feedback = Input(
        "rigid", unit=ACCELERATION_UNITS, default=0.0, meaning="correction of d2x_1/dt2"
    )
    disturbance_estimate = Input(
        "rigid",
        unit=ACCELERATION_UNITS,
        default=0.0,
        meaning="estimate of d",
        labels=SPEEDS,
    )
    task_force = Input(
        "rigid", default=0.0, meaning="force and torque in task axes, e.g. of a PD law"
    )
    generalized_force = Output("rigid", meaning="u", labels=SPEEDS)
    feedforward_force = Output(
        "rigid", meaning="part of u for the desired acceleration"
    )
    feedback_force = Output(
        "rigid", meaning="part of u for feedback and disturbance estimate"
    )
    transformed_task_force = Output(
        "rigid", meaning="J_g^T times the task force", labels=SPEEDS
    )
    nominal_acceleration = Output(
        "rigid", unit=ACCELERATION_UNITS, meaning="G^-1 (u - c)", labels=SPEEDS
    )
    actuation_matrix = Output(
        ("rigid", "actuators"), meaning="P_r, the rigid rows of P_Q"
    )
    full_actuation_matrix = Output(
        ("n", "actuators"), meaning="P_Q, the modal rows included"
    )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return forces, nominal acceleration and actuation matrices."""
        rigid = self.rigid
        terms = self.dynamics.evaluate(u.coordinates, u.speeds)
        G, c = terms.mass_matrix[:rigid, :rigid], terms.bias[:rigid]
        kind, q = self.dynamics.attitude, u.coordinates
        ahead = to_body(kind, q, u.feedforward - task_drift(kind, q, u.speeds[:rigid]))
        correction = to_body(kind, q, u.feedback) - u.disturbance_estimate
        return {
            "generalized_force": c + G @ (ahead + correction),  # Eqs. 53-55
            "feedforward_force": c + G @ ahead,
            "feedback_force": G @ correction,
            "transformed_task_force": task_force_to_body(kind, q, u.task_force),
            "nominal_acceleration": ahead + correction,
            "actuation_matrix": terms.actuation_matrix[:rigid],
            "full_actuation_matrix": terms.actuation_matrix,
        }


class TaskErrors(TrussBlock):
    r"""Tracking errors and reference acceleration in task coordinates, the inputs of a control law.

    The attitude is no vector, but its error is. With :math:`\epsilon = \bar a \circ a_d` of
    two quaternions and :math:`C = R_t^T R_d`, the attitude errors in truss axes are

    .. math:: e = -2\,\mathrm{sgn}(\epsilon_w)\,(\epsilon_x, \epsilon_y, \epsilon_z), \qquad
              \dot e \to \omega_t - C\omega_d, \qquad
              \ddot x_d \to C\dot\omega_d - \omega_t \times C\omega_d

    so that a law :math:`\ddot e = -k_p e - k_d \dot e` turns the truss to the reference about one axis, from
    any attitude, by the smaller angle. All other errors are differences.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.

    References
    ----------
    Wie, Weiss, Arapostathis (1989), *Quaternion feedback regulator for spacecraft eigenaxis rotations*, J.
    Guidance 12(3); Wen, Kreutz-Delgado (1991), *The attitude control problem*, IEEE TAC 36(10).
    """

    _symbol = Symbol("x − x_d")
    reference_position = Input("rigid_q", unit=POSITION_UNITS, meaning="x_d")
    reference_velocity = Input("rigid", unit=RATE_UNITS, meaning="rate of x_d")
    reference_acceleration = Input(
        "rigid", unit=ACCELERATION_UNITS, default=0.0, meaning="acceleration of x_d"
    )
    position = Input("rigid_q", unit=POSITION_UNITS, meaning="x_1")
    velocity = Input("rigid", unit=RATE_UNITS, meaning="J_g x_2")
    error = Output(
        "rigid",
        unit=Attribute("task_units"),
        meaning="position minus reference",
        labels=TASK,
    )
    error_rate = Output(
        "rigid", unit=RATE_UNITS, meaning="velocity minus reference", labels=TASK
    )
    acceleration = Output(
        "rigid", unit=ACCELERATION_UNITS, meaning="reference acceleration", labels=TASK
    )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return errors and acceleration."""
        reference = u.reference_position, u.reference_velocity, u.reference_acceleration
        kind = self.dynamics.attitude
        rate, acceleration = seen_from(kind, u.position, u.velocity, *reference)
        error = way_to(kind, u.reference_position, u.position)
        return {
            "error": error,
            "error_rate": u.velocity - rate,
            "acceleration": acceleration,
        }
