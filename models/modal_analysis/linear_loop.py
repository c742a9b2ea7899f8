r"""The control loop of the truss at rest, as linear models that laws and margins are put to.

Plant, nominal model and allocation are linearized once, exactly, from the diagram that flies
the missions (`transport_diagram`); controller and observer, which come linearized by
themselves, close the loop. So gains, damping and amplitudes change without new tracing.

The loop can be opened at 34 + h *channels*, the plant's inputs:

* the demand u (N, N·m): generalized force on translation, rotation and joints that the
  allocation is asked to produce, ``allocation.demand``, or ``feedback_allocation.demand`` if
  the allocation is mode-neutral;
* the modal force :math:`f = P_f Q` (kg^½·m/s²): work that the actuators, in producing u, do on
  the h modes. No wire carries it; it is taken out of the plant's equations at
  :math:`M \dot v = P_r Q + \ldots + [0; f]`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import control
import numpy as np

from trussflow.blocks.control.disturbance_observer import DisturbanceObserver
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.linearize import Linearizer, linearize
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.geometry.attitude import EULER
from trussflow.models.modal_analysis.linear_laws import Amplitude, linear_law
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.wiring import CONTROLLERS, transport_diagram
from trussflow.models.validation import check_choice


@dataclass(frozen=True, kw_only=True)
class OpenLoop:
    """Plant and controller of one loop, linear, before it is closed.

    Attributes
    ----------
    plant : control.StateSpace
        From demand and modal force to the modal force that the demand causes, the actuator
        commands, and what is measured: position, velocity and rigid speeds.
    controller : control.StateSpace
        From what is measured to the demand, its sign included.
    modal_actuation : bool
        Whether the modal force acts on the plant.
    effectiveness : Vector, shape (n, actuators)
        :math:`P_Q`, from actuators to generalized forces [1, m, kg^-½].
    inertia : Vector, shape (34, 34)
        G, of the rigid coordinates [kg, kg·m, kg·m²].
    rigid, modes, actuators : int
        Numbers of rigid coordinates, modes and actuators [-].
    """

    plant: control.StateSpace
    controller: control.StateSpace
    modal_actuation: bool
    effectiveness: Vector
    inertia: Vector
    rigid: int
    modes: int
    actuators: int

    @cached_property
    def measured_plant(self) -> control.StateSpace:
        """From demand to what is measured, the modal force acting as it does."""
        A, B, C = self._plant_with_modal_force()
        return _state_space(A, B, C[self.modes + self.actuators :])

    @cached_property
    def channels(self) -> control.StateSpace:
        """Everything opened: from (u, f) put in to (u, f) that comes back."""
        p, k = self.plant, self.controller
        f, y = slice(0, self.modes), slice(self.modes + self.actuators, None)
        # The demand is cut, so the controller's answer goes out instead of into the plant.
        A = np.block([[p.A, np.zeros((p.nstates, k.nstates))], [k.B @ p.C[y], k.A]])
        B = np.vstack([p.B, np.zeros((k.nstates, p.ninputs))])
        C = np.block([[k.D @ p.C[y], k.C], [p.C[f], np.zeros((self.modes, k.nstates))]])
        D = np.vstack([np.zeros((self.rigid, p.ninputs)), p.D[f]])
        return _state_space(A, B, C, D)

    @cached_property
    def closed_matrix(self) -> Vector:
        """State matrix of the closed loop; states of the plant, then the controller's."""
        A, B, C = self._plant_with_modal_force()
        k, y = self.controller, slice(self.modes + self.actuators, None)
        return np.block([[A + B @ k.D @ C[y], B @ k.C], [k.B @ C[y], k.A]])

    @cached_property
    def demand_loop(self) -> control.StateSpace:
        """Loop gain L at the demand, all 34 channels opened, for negative feedback."""
        return self.closed_but(range(self.rigid))

    @cached_property
    def modal_loop(self) -> control.StateSpace:
        """Loop gain L at the modal force, all modes opened, for negative feedback."""
        return self.closed_but(range(self.rigid, self.rigid + self.modes))

    def closed_but(self, numbers: Any) -> control.StateSpace:
        """Return the loop gain of some channels, all others closed, for negative feedback.

        Parameters
        ----------
        numbers : sequence of int
            Channels, demand first, then modes [-].
        """
        every, chosen = self.channels, np.asarray(list(numbers), dtype=int)
        acting = self.rigid + (self.modes if self.modal_actuation else 0)
        others = np.setdiff1d(np.arange(acting), chosen)
        A, B, C, D = every.A, every.B, every.C, every.D
        # Signals of the closed channels: s = C_o x + D_oo s + D_oc w, and no loop in D.
        inner = np.linalg.inv(np.eye(others.size) - D[np.ix_(others, others)])
        by_x, by_w = inner @ C[others], inner @ D[np.ix_(others, chosen)]
        back = B[:, others]
        return _state_space(
            A + back @ by_x,
            B[:, chosen] + back @ by_w,
            -(C[chosen] + D[np.ix_(chosen, others)] @ by_x),
            -(D[np.ix_(chosen, chosen)] + D[np.ix_(chosen, others)] @ by_w),
        )

    def _plant_with_modal_force(self) -> tuple[Vector, Vector, Vector]:
        """Return A, B, C of the plant from the demand, the modal force acting as it does."""
        p, u = self.plant, slice(0, self.rigid)
        B = p.B[:, u]
        if self.modal_actuation:
            B = B + p.B[:, self.rigid :] @ p.D[: self.modes, u]
        return p.A, B, p.C

    def channel_names(self) -> list[str]:
        """Return the names of all channels."""
        return channel_names(self.rigid, self.modes)


class HeldTruss:
    """A truss held at rest: plant, nominal model and allocation, linearized.

    Parameters
    ----------
    truss : SpaceTruss
        The plant.
    allocation : str, optional
        As for `transport_diagram`.
    believed : TrussDynamics, optional
        As for `transport_diagram`.
    case : int
        Mission that the gains are taken from [-].

    Attributes
    ----------
    allocation : str
        ``"published"`` or ``"mode-neutral"``.
    static : Vector
        From feedback and disturbance estimate to demand and nominal acceleration.
    static_task_force : Vector
        From the force of the PD law to demand.
    """

    def __init__(
        self,
        truss: SpaceTruss,
        *,
        allocation: str | None = None,
        believed: TrussDynamics | None = None,
        case: int = 1,
    ) -> None:
        if truss.dynamics.attitude != EULER:
            raise ModelError("the loop is taken apart in Euler angles; give the truss without a quaternion")
        self.truss = truss
        self.mission = Mission.of_case(case)
        diagram = transport_diagram(
            self.mission, truss, observer=False, allocation=allocation, believed=believed
        )
        neutral = "feedback_allocation" in diagram.blocks
        self.allocation = "mode-neutral" if neutral else "published"
        demand = f"feedback_allocation.demand[:{truss.rigid}]" if neutral else "allocation.demand"
        inputs = [demand, "model.feedback", "model.disturbance_estimate", "model.task_force"]
        outputs = [
            demand,
            "model.nominal_acceleration",
            "model.transformed_task_force",
            "truss.actuation",
            "controller.position",
            "controller.velocity",
            "truss.rigid_speeds",
        ]
        model = Linearizer(diagram, inputs, outputs, cut=inputs).at()
        self._take_apart(model)

    def _take_apart(self, model: control.StateSpace) -> None:
        """Split the linear model into the plant and what the controller knows of it."""
        truss, rigid, modes = self.truss, self.truss.rigid, self.truss.modes
        # With the demand cut no state but its own moves the truss, and at rest what the nominal model
        # computes (its c is quadratic in the speeds) does not follow the truss's state.
        own = np.array([label.startswith("truss/") for label in model.state_labels])
        A, B, C, D = model.A[np.ix_(own, own)], model.B[own], model.C[:, own], model.D
        if np.abs(model.A[np.ix_(own, ~own)]).max(initial=0.0) > 0 or np.any(C[: 3 * rigid]):
            raise ModelError("cannot separate plant and controller: the truss is not at rest")
        self.static = D[: 2 * rigid, rigid : 3 * rigid]
        self.static_task_force = D[2 * rigid : 3 * rigid, 3 * rigid :]
        q = truss.dynamics.rest
        terms = truss.dynamics.evaluate(q, np.zeros(truss.n))
        self._effectiveness = terms.actuation_matrix
        self._inertia = terms.mass_matrix[:rigid, :rigid]
        effect = terms.actuation_matrix[rigid:]  # P_f
        push = np.zeros((2 * truss.n, modes))
        push[truss.n :] = np.linalg.inv(terms.mass_matrix)[:, rigid:]
        command = D[3 * rigid : 3 * rigid + truss.actuators, :rigid]
        causes = effect @ command
        if truss.modal_actuation:
            B = B.copy()
            B[:, :rigid] -= push @ causes  # what the modal force does comes in by its own input
        self._A, self._B = A, np.hstack([B[:, :rigid], push])
        zero = np.zeros((modes + truss.actuators, 2 * truss.n))
        self._C = np.vstack([zero, C[3 * rigid + truss.actuators :]])
        self._D = np.zeros((len(self._C), rigid + modes))
        self._D[: modes + truss.actuators, :rigid] = np.vstack([causes, command])
        self._push = push

    def plant(self, damping: float | None = None) -> control.StateSpace:
        """Return the linear plant, as `OpenLoop` has it.

        Parameters
        ----------
        damping : float, optional
            Fraction of critical damping of all modes [-]; by default the truss's own.
        """
        A, rigid = self._A, self.truss.rigid
        if damping is not None:
            p = self.truss.parameters
            rate = 2 * (damping - p["damping_ratio"]) * 2 * np.pi * p["frequency"]
            A = A.copy()
            # Damping enters the equations where the modal force does, with the modal rates.
            A[:, self.truss.n + rigid :] -= self._push * rate
        return _state_space(A, self._B, self._C, self._D)

    def loop(
        self,
        controller: str = "ismc",
        *,
        bandwidth: float | None = None,
        amplitude: Amplitude | None = None,
        damping: float | None = None,
        modal_actuation: bool | None = None,
    ) -> OpenLoop:
        """Return the loop with a controller around the plant.

        Parameters
        ----------
        controller : str
            ``"ismc"``, ``"smc"`` or ``"pd"``.
        bandwidth : float, optional
            L of the disturbance observer [1/s]; by default there is none.
        amplitude : Amplitude, optional
            Of the errors, for the describing functions of the law; by default the law is
            linear: exponents one, no switching.
        damping : float, optional
            Fraction of critical damping of all modes [-]; by default the truss's own.
        modal_actuation : bool, optional
            Whether the actuators work on the modes; by default as the truss has it.

        Raises
        ------
        ModelError
            If there is no such controller; or PD with an observer, or with another allocation
            than the published.
        """
        truss = self.truss
        check_choice("controller", controller, CONTROLLERS)
        if controller == "pd" and (bandwidth is not None or self.allocation != "published"):
            raise ModelError(
                "the PD law has no disturbance observer, and its force is allocated by Eq. 64: "
                "leave bandwidth out, and choose the published allocation"
            )
        return OpenLoop(
            plant=self.plant(damping),
            controller=self._controlled(controller, bandwidth, amplitude),
            modal_actuation=truss.modal_actuation if modal_actuation is None else modal_actuation,
            effectiveness=self._effectiveness,
            inertia=self._inertia,
            rigid=truss.rigid,
            modes=truss.modes,
            actuators=truss.actuators,
        )

    def _controlled(
        self, controller: str, bandwidth: float | None, amplitude: Amplitude | None
    ) -> control.StateSpace:
        """Put law, observer and nominal model together: from what is measured to the demand."""
        m = self.truss.rigid
        law = linear_law(self.mission, controller, m, amplitude)
        parts, width = law, 2 * m
        D_u, D_n = self.static[:m], self.static[m:]
        if bandwidth is not None:
            observer = linearize(
                DisturbanceObserver(bandwidth, shape=m),
                ["velocity", "nominal_acceleration"],
                ["disturbance_estimate"],
            )
            parts, width = control.append(law, observer), 4 * m
        else:
            D_u, D_n = D_u[:, :m], D_n[:, :m]
        if controller == "pd":
            D_u = self.static_task_force
        # From position, velocity, rigid speeds and the commands of the parts to the demand, and
        # then to what law (and observer) read: position, velocity, rigid speeds, acceleration.
        commands = D_u.shape[1]
        D = np.zeros((5 * m, 3 * m + commands))
        D[:m, 3 * m :] = D_u
        D[m : 4 * m, : 3 * m] = np.eye(3 * m)
        D[4 * m :, 3 * m :] = D_n if bandwidth is not None else 0.0
        known = control.StateSpace([], [], [], D[: m + width])
        found: control.StateSpace = known.lft(parts, nu=commands, ny=width)
        return found


def channel_names(rigid: int, modes: int, robots: int = 4) -> list[str]:
    """Return names of channels: x ... psi, theta_1_1 ..., mode_1 ...

    Parameters
    ----------
    rigid, modes, robots : int
        Numbers of rigid coordinates, modes and robots [-].
    """
    joints = (rigid - 6) // robots if robots else 0
    names = ["x", "y", "z", "phi", "theta", "psi"]
    names += [f"theta_{i + 1}_{j + 1}" for i in range(robots) for j in range(joints)]
    return names + [f"mode_{k + 1}" for k in range(modes)]


def _state_space(A: Vector, B: Vector, C: Vector, D: Vector | None = None) -> control.StateSpace:
    """Return a model that keeps states without influence: they are someone's all the same."""
    return control.StateSpace(A, B, C, 0 if D is None else D, remove_useless_states=False)
