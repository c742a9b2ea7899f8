"""What a controller knows about the truss: the model behind the control law."""

from __future__ import annotations

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Attribute, Signals
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import seen_from, task_drift, task_force_to_body, to_body, way_to
from trussflow.models.plant.space_truss import SpaceTruss

ACCELERATIONS = Attribute("acceleration_units")


class _BelievedDynamics(Block):
    """What the blocks below share: the dynamics believed in, with its sizes, units and state."""

    coordinates = Input("nq", unit=Attribute("coordinate_units"), meaning="q")
    speeds = Input("n", unit=Attribute("speed_units"), meaning="v")

    def __init__(self, dynamics: TrussDynamics) -> None:
        self.dynamics = dynamics
        plant = SpaceTruss(dynamics)
        self.nq, self.n, self.rigid, self.actuators = plant.nq, plant.n, plant.rigid, plant.actuators
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
        kind, q = self.dynamics.attitude, u.coordinates
        ahead = to_body(kind, q, u.feedforward - task_drift(kind, q, u.speeds[:rigid]))
        correction = to_body(kind, q, u.feedback) - u.disturbance_estimate
        return {
            "generalized_force": c + g @ (ahead + correction),
            "feedforward_force": c + g @ ahead,
            "feedback_force": g @ correction,
            "transformed_task_force": task_force_to_body(kind, q, u.task_force),
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


class TaskErrors(Block):
    r"""Errors in task coordinates, and the reference's acceleration in the same: what a law needs to know.

    Between a law of vectors and positions that are no vectors. With :math:`\epsilon = \bar a \circ a_d` of
    two quaternions and :math:`C = R_t^T R_d` the errors of attitude are, in axes of the truss,

    .. math:: e = -2\,\mathrm{sgn}(\epsilon_w)\,(\epsilon_x, \epsilon_y, \epsilon_z), \qquad
              \dot e \to \omega_t - C\omega_d, \qquad
              \ddot x_d \to C\dot\omega_d - \omega_t \times C\omega_d

    so that a law :math:`\ddot e = -k_p e - k_d \dot e` turns the truss about one axis to the goal, from any
    attitude, by the shorter way. The errors of all else are differences.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots.

    References
    ----------
    Wie, Weiss, Arapostathis (1989), *Quaternion feedback regulator for spacecraft eigenaxis rotations*, J.
    Guidance 12(3); Wen, Kreutz-Delgado (1991), *The attitude control problem*, IEEE TAC 36(10).
    """

    reference_position = Input("rigid_q", unit=Attribute("position_units"), meaning="x_d")
    reference_velocity = Input("rigid", unit=Attribute("task_rate_units"), meaning="its rate")
    reference_acceleration = Input("rigid", unit=ACCELERATIONS, default=0.0, meaning="and acceleration")
    position = Input("rigid_q", unit=Attribute("position_units"), meaning="x_1")
    velocity = Input("rigid", unit=Attribute("task_rate_units"), meaning="J_g x_2")
    error = Output("rigid", unit=Attribute("task_units"), meaning="position minus reference")
    error_rate = Output("rigid", unit=Attribute("task_rate_units"), meaning="velocity minus reference")
    acceleration = Output("rigid", unit=ACCELERATIONS, meaning="of the reference")

    def __init__(self, dynamics: TrussDynamics) -> None:
        plant = SpaceTruss(dynamics)
        self.kind, self.rigid_q, self.rigid = dynamics.attitude, plant.rigid_q, plant.rigid
        self.position_units, self.task_units = plant.position_units, plant.task_units
        self.task_rate_units, self.acceleration_units = plant.task_rate_units, plant.disturbance_units
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return errors and acceleration."""
        reference = u.reference_position, u.reference_velocity, u.reference_acceleration
        rate, acceleration = seen_from(self.kind, u.position, u.velocity, *reference)
        error = way_to(self.kind, u.reference_position, u.position)
        return {"error": error, "error_rate": u.velocity - rate, "acceleration": acceleration}
