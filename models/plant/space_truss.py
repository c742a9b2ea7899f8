"""Plant block: a flexible truss carried by space robots."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.energy import EnergyAccount
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.blocks.tracing.memoized import memoized
from trussflow.models.dynamics.assembly import DynamicsTerms
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.dynamics.task_space import task_velocity
from trussflow.models.geometry.attitude import QUATERNION
from trussflow.models.plant.truss_block import (
    ACCELERATION_UNITS,
    ACTUATOR_UNITS,
    MODAL_FORCE_UNIT,
    MODAL_RATE_UNIT,
    MODAL_UNIT,
    POSITION_UNITS,
    RATE_UNITS,
    SPEEDS,
    TrussBlock,
)
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.paper_truss import accurate_modes, printed_modes
from trussflow.models.truss.truss_modes import ModalData, TrussModes
from trussflow.models.validation import check_choice, frozen_array

BASES, MODES = Attribute("base_labels"), Attribute("mode_labels")


STRUCTURES = ("published", "consistent", "accurate")
"""Names of the constructors of the plant of the paper."""
ARMS = {"literal": RobotArm.literal, "jaco": RobotArm.jaco}
"""Constructors of the shipped arms, by name."""


def arm_by_name(name: str) -> RobotArm:
    """Return a shipped arm.

    Parameters
    ----------
    name : str
        ``"literal"`` (Table 2 as printed) or ``"jaco"`` (Kinova JACO2, the arm that Table 2 describes).

    Raises
    ------
    ModelError
        If no arm has that name.
    """
    check_choice("arm", name, ARMS)
    return ARMS[name]()


class SpaceTruss(TrussBlock):
    r"""Flexible truss and space robots, floating freely in inertial space.

    .. math::
        \dot q = N(q)\,v, \qquad
        M(q)\,\dot v = [P_r Q;\ f] - [0;\ \Lambda\tau + 2\zeta\sqrt{\Lambda}\,\dot\tau]
        - F^{I,nl}(q, v)

    with :math:`P_Q = [P_r; P_f]`. The output `modal_demand` is the generalized force of the actuators on the
    modes, :math:`P_f Q`. With `modal_actuation` it is f. Otherwise f is the input `modal_force`: a wire
    ``modal_demand >> modal_force`` gives the same plant; without this wire f is zero, as in the paper.

    Parameters
    ----------
    dynamics : TrussDynamics
        Truss and robots; any number of robots, joints and modes.
    modal_actuation : bool
        Whether f is the modal demand (Eq. 42 in full) or the input `modal_force`.
    start : Vector, optional
        `initial_coordinates` [m, unit of the attitude, rad, kg^½·m]; by default `TrussDynamics.rest`.
    speeds : Vector, optional
        `initial_speeds` [m/s, rad/s, kg^½·m/s]; by default zero.

    Notes
    -----
    :math:`q = (r_t, \Theta_t, \theta, \tau)`, :math:`v = (v_t, \omega_t, \dot\theta,
    \dot\tau)`; see `TrussDynamics`. With n coordinates of which h are modal, the first
    n − h are the paper's :math:`x_1`, and the first n − h speeds its :math:`x_2`. With a quaternion
    the number of coordinates is one more than that of speeds. `task_velocity` then has the velocity in
    inertial axes, the angular velocity in truss axes, and the joint rates.

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 2–45.
    """

    actuation = Input(
        "actuators",
        unit=ACTUATOR_UNITS,
        meaning="Q: force and torque on each base in its own axes, then joint torques",
    )
    modal_demand = Output(
        "modes",
        unit=MODAL_FORCE_UNIT,
        meaning="P_f Q, generalized force of the actuators on the modes",
        labels=MODES,
    )
    coordinates = Output(
        "nq",
        unit=Attribute("coordinate_units"),
        meaning="q",
        labels=Attribute("coordinate_labels"),
    )
    speeds = Output(
        "n",
        unit=Attribute("speed_units"),
        meaning="v",
        labels=Attribute("speed_labels"),
    )
    task_position = Output(
        "rigid_q",
        unit=POSITION_UNITS,
        meaning="x_1",
        labels=Attribute("position_labels"),
    )
    task_velocity = Output(
        "rigid",
        unit=RATE_UNITS,
        meaning="dx_1/dt, J_g x_2",
        labels=Attribute("task_labels"),
    )
    rigid_speeds = Output("rigid", unit=RATE_UNITS, meaning="x_2", labels=SPEEDS)
    modal_coordinate = Output("modes", unit=MODAL_UNIT, meaning="tau", labels=MODES)
    modal_rate = Output("modes", unit=MODAL_RATE_UNIT, meaning="d tau/dt", labels=MODES)
    grasp_displacement = Output(
        ("robots", 3),
        unit="m",
        frame="truss",
        meaning="elastic displacement T_i tau of the grasp points",
        labels=BASES,
    )
    base_force = Output(
        ("robots", 3),
        unit="N",
        frame="base",
        meaning="force on each base",
        labels=BASES,
    )
    base_torque = Output(
        ("robots", 3),
        unit="N*m",
        frame="base",
        meaning="torque on each base",
        labels=BASES,
    )
    joint_torque = Output(
        "joints",
        unit=Attribute("effort_units"),
        meaning="joint torques, robot by robot",
        labels=Attribute("joint_labels"),
    )
    disturbance = Output(
        "rigid",
        unit=ACCELERATION_UNITS,
        meaning="d = -G^-1 M_rf tau'', disturbance acceleration by the flexibility (Eq. 45)",
        labels=SPEEDS,
    )
    energy = Output(unit="J", meaning="kinetic and elastic energy")
    actuator_rates = Output(
        "actuators",
        unit=Attribute("actuator_rate_units"),
        meaning="P_Q^T v, rates conjugate to Q",
    )
    modal_loss = Output(unit="W", meaning="power dissipated by modal damping")
    energy_account = EnergyAccount(
        supplied=[("actuation", "actuator_rates")],
        stored="energy",
        dissipated="modal_loss",
    )

    q = State(
        "nq",
        initial="initial_coordinates",
        meaning="coordinates",
        labels=Attribute("coordinate_labels"),
    )
    v = State(
        "n",
        initial="initial_speeds",
        meaning="speeds",
        labels=Attribute("speed_labels"),
    )

    initial_coordinates = Parameter(shape=("nq",), meaning="q at the start")
    initial_speeds = Parameter(0.0, ("n",), meaning="v at the start")
    frequency = Parameter(
        shape=("modes",), unit="Hz", above=0.0, meaning="natural frequencies"
    )
    damping_ratio = Parameter(
        shape=("modes",), minimum=0.0, meaning="damping ratio of each mode"
    )

    def __init__(
        self,
        dynamics: TrussDynamics,
        *,
        modal_actuation: bool = True,
        start: Vector | None = None,
        speeds: Vector | None = None,
    ) -> None:
        self.dynamics = dynamics  # for `truss_parameters`
        self.modal_actuation = modal_actuation
        if not modal_actuation:
            force = Input(
                "modes",
                unit=MODAL_FORCE_UNIT,
                default=0.0,
                meaning="f, generalized force on the modes",
                labels=MODES,
            )
            self.extra_ports = {"modal_force": force}
        start = dynamics.rest if start is None else start
        moving = {} if speeds is None else {"initial_speeds": speeds}
        super().__init__(
            dynamics,
            initial_coordinates=start,
            **moving,
            **self.truss_parameters(dynamics.modes),
        )

    @classmethod
    def published(cls, *, modes: int = 6, arm: str = "literal") -> Self:
        """Return the paper's system: its equations and printed numbers, without the term P_f Q.

        It has truncated truss integrals, no structural damping and Table 2 as printed. The paper does not
        print the mode shapes; they are reconstructed. The actuators do no work on the modes, although
        Eq. 42 includes it: with that term the published control loop is unstable.

        Parameters
        ----------
        modes : int
            Number of flexible modes [-]; the paper has six.
        arm : str
            ``"literal"`` or ``"jaco"``.
        """
        truss = TrussModes.reconstructed().truncated(modes)
        return cls(
            _dynamics(truss, arm, elastic_integrals=False), modal_actuation=False
        )

    @classmethod
    def consistent(
        cls, *, modes: int = 6, arm: str = "literal", damping: float | None = None
    ) -> Self:
        """Return the physically consistent system of the same structure.

        It has exact truss integrals, actuator work on the modes, and structural damping.

        Parameters
        ----------
        modes : int
            Number of flexible modes [-].
        arm : str
            ``"literal"`` or ``"jaco"``.
        damping : float, optional
            Damping ratio of every mode [-]; 0.5 % by default.
        """
        truss = TrussModes.reconstructed().truncated(modes).damped(_damping(damping))
        return cls(_dynamics(truss, arm, elastic_integrals=True))

    @classmethod
    def accurate(
        cls,
        *,
        modes: int = 20,
        arm: str = "literal",
        damping: float | None = None,
        highest_frequency: float = 100.0,
    ) -> Self:
        """Return the consistent system with a truss that is accurate at the grasp points.

        Attachment shapes at the grasp points are added to the modes. With locked arms the first ten
        frequencies of the floating system are within 0.12 % of those of the full finite-element model.
        The errors of `consistent` are 3 % in the first and 90 % in the fifth and sixth frequency. Use
        this plant for conclusions about feedback.

        Parameters
        ----------
        modes : int
            Number of clamped modes of the truss, besides 18 attachment shapes; six or more [-].
        arm : str
            ``"literal"`` or ``"jaco"``.
        damping : float, optional
            Damping ratio of every mode and shape [-]; 0.5 % by default.
        highest_frequency : float
            Attachment shapes of higher frequencies are condensed [Hz].

        Notes
        -----
        The shapes have frequencies up to 440 Hz. With condensation at 100 Hz the highest frequency of the
        whole system is 155 Hz, for which RK4 is stable up to steps of 2.9 ms. The first ten frequencies
        keep their accuracy. See `trussflow.models.truss.reduction`.
        """
        truss = accurate_modes(modes, highest_frequency).damped(_damping(damping))
        return cls(_dynamics(truss, arm, elastic_integrals=True))

    @property
    def start_position(self) -> Vector:
        """Rigid coordinates at the start [m, unit of the attitude, unit of the joints]."""
        return self.parameters["initial_coordinates"][: self.rigid_q]

    def changed(self, **arguments: Any) -> Self:
        """Return the same plant with other arguments of the constructor.

        Parameters
        ----------
        **arguments
            Arguments of `SpaceTruss` that differ [see there].
        """
        same: dict[str, Any] = {
            "dynamics": self.dynamics,
            "modal_actuation": self.modal_actuation,
            "start": self.parameters["initial_coordinates"],
            "speeds": self.parameters["initial_speeds"],
        }
        return type(self)(**same | arguments)

    def turned(self, attitude: Vector) -> Self:
        """Return the same plant, at rest in another attitude at the start.

        Parameters
        ----------
        attitude : Vector
            3-1-2 Euler angles [rad] or a quaternion, scalar first [1], as `dynamics.attitude` has it.
            `attitude_along` gives the angles for a given direction of the path.

        Raises
        ------
        ModelError
            If the Euler angles are not three finite numbers, or the quaternion is not a unit quaternion.
        """
        kind, rest = self.dynamics.attitude, self.dynamics.rest
        attitude = kind.checked(frozen_array("attitude", attitude, (len(kind.rest),)))
        start = np.concatenate([rest[:3], attitude, rest[kind.end :]])
        return self.changed(start=start, speeds=None)

    def with_quaternion(self) -> Self:
        """Return the same plant in the same initial state, with a quaternion in place of Euler angles."""
        from scipy.spatial.transform import Rotation

        kind, q = self.dynamics.attitude, self.parameters["initial_coordinates"]
        turned = Rotation.from_matrix(kind.rotation(q[3 : kind.end]))
        return self.changed(
            dynamics=replace(self.dynamics, attitude=QUATERNION),
            start=np.concatenate(
                # SciPy has the scalar last.
                [q[:3], turned.as_quat(canonical=True)[[3, 0, 1, 2]], q[kind.end :]]
            ),
        )

    def truss_parameters(self, truss: TrussModes) -> dict[str, Vector]:
        """Return the values of the truss parameters.

        Parameters
        ----------
        truss : TrussModes
            Truss with the same number of modes.
        """
        return {"frequency": truss.frequencies, "damping_ratio": truss.damping_ratios}

    def modal_data(self, p: Signals) -> ModalData:
        """Return the truss data of the equations of motion, here constants.

        Parameters
        ----------
        p : Signals
            Parameters of the run.
        """
        return self.dynamics.modes.data

    def check_parameters(self, p: Signals) -> None:
        """Raise `ModelError` if the initial attitude is invalid."""
        kind = self.dynamics.attitude
        kind.checked(p.initial_coordinates[3 : kind.end])

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return coordinates, speeds and the quantities derived from them."""
        dynamics, rigid, position = self.dynamics, self.rigid, x.q[: self.rigid_q]
        bases = np.reshape(u.actuation[: 6 * self.robots], (self.robots, 6))
        terms, acceleration = self._motion(x, u, p)
        G, M_rf = terms.mass_matrix[:rigid, :rigid], terms.mass_matrix[:rigid, rigid:]
        modal = x.q[self.rigid_q :]
        omega = 2 * np.pi * p.frequency
        return {
            "coordinates": x.q,
            "speeds": x.v,
            "task_position": position,
            "task_velocity": task_velocity(dynamics.attitude, position, x.v[:rigid]),
            "rigid_speeds": x.v[:rigid],
            "modal_demand": terms.actuation_matrix[rigid:] @ u.actuation,
            "modal_coordinate": modal,
            "modal_rate": x.v[rigid:],
            "grasp_displacement": dynamics.grasp_displacement(x.q, self.modal_data(p)),
            "base_force": bases[:, :3],
            "base_torque": bases[:, 3:],
            "joint_torque": u.actuation[6 * self.robots :],
            # Eq. 45
            "disturbance": -solve_positive_definite(G, M_rf @ acceleration[rigid:]),
            # The modes are mass-normalized, so their stiffness is omega^2 (Eq. 28).
            "energy": (x.v @ terms.mass_matrix @ x.v + modal @ (omega**2 * modal)) / 2,
            "actuator_rates": terms.actuation_matrix.T @ x.v,
            "modal_loss": x.v[rigid:] @ (2 * p.damping_ratio * omega * x.v[rigid:]),
        }

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the rates of coordinates and speeds."""
        return {"q": self.dynamics.kinematics(x.q, x.v), "v": self._motion(x, u, p)[1]}

    # Output and derivative use the same terms; they are computed once per evaluation.
    @memoized
    def _motion(
        self, x: Signals, u: Signals, p: Signals
    ) -> tuple[DynamicsTerms, Array]:
        """Return the terms of the equations of motion, and the generalized accelerations."""
        terms = self.dynamics.evaluate(x.q, x.v, self.modal_data(p))
        active = terms.actuation_matrix @ u.actuation
        if not self.modal_actuation:
            # The published plant omits P_f Q of Eq. 42; its f is zero.
            active = np.concatenate([active[: self.rigid], u.modal_force])
        elastic = self.dynamics.elastic_force(x.q, x.v, p.frequency, p.damping_ratio)
        return terms, solve_positive_definite(
            terms.mass_matrix, active + elastic - terms.bias
        )


def _damping(ratio: float | None) -> float:
    """Return the damping ratio of all modes, by default that of ``space_truss.toml``."""
    return printed_modes().scalar("damping_ratio", "1") if ratio is None else ratio


def _dynamics(truss: TrussModes, arm: str, *, elastic_integrals: bool) -> TrussDynamics:
    arms = (arm_by_name(arm),) * truss.grasps
    return TrussDynamics(modes=truss, arms=arms, elastic_integrals=elastic_integrals)
