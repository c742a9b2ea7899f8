r"""Equations of motion of a flexible truss carried by space robots."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.tracing.kernels import repeated, shape_of
from trussflow.models.dynamics.assembly import DynamicsTerms, assembled
from trussflow.models.errors import ModelError
from trussflow.models.geometry.attitude import EULER, AttitudeCoordinates
from trussflow.models.geometry.rotation import stacked
from trussflow.models.robots.arm_recursion import ArmTerms, arm_terms
from trussflow.models.robots.hand_motion import HandMotion, hand_motion
from trussflow.models.robots.joint import Joint
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.truss_modes import ModalData, TrussModes
from trussflow.models.truss.truss_terms import truss_terms
from trussflow.models.validation import set_fields


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrussDynamics:
    r"""Equations of motion of a free-floating flexible truss with one robot at each grasp point, if any.

    .. math:: M(q)\,\dot v = P_Q(q)\,Q + F^E - F^{I,nl}(q, v), \qquad \dot q = N(q)\,v

    Coordinates :math:`q = (r_t, \Theta_t, \theta, \tau)`: position of :math:`O_t` in the
    inertial frame [m], attitude (3-1-2 Euler angles [rad] or a quaternion [1]), joint angles robot by robot
    [rad; m where joints slide], modal coordinates [kg^½·m]. Speeds
    :math:`v = (v_t, \omega_t, \dot\theta, \dot\tau)`: velocity and angular velocity of the truss frame **in
    truss axes** [m/s, rad/s], joint rates, modal rates. Inputs :math:`Q`: per robot force and torque on the
    base's centroid, in base axes [N, N·m], then all joint torques [N·m; N where joints slide].

    Attributes
    ----------
    modes : TrussModes
        Modes of the truss, zero or more.
    arms : tuple of RobotArm
        One arm per grasp point; they may differ.
    elastic_integrals : bool
        False: the published equations. They omit the elastic displacement in the integrals over the
        truss, and a hand turns at the rate :math:`R_i\dot\tau`. True: the exact equations of the same
        kinematics, which conserve energy and momentum.
    attitude : AttitudeCoordinates
        `EULER` as in the paper, or `QUATERNION` without singularities.
    groups : tuple of tuple of int
        Derived: indices of equal arms, which share one compiled kernel.

    Raises
    ------
    ModelError
        If the number of arms differs from that of grasp points.

    Notes
    -----
    The terms of a robot come from the recursive Newton–Euler algorithm (bias) and the composite-rigid-body
    algorithm (mass matrix), see `arm_terms`. docs/notation.md relates them to the paper's equations.

    References
    ----------
    Li, Wei, Chen (2026), Eqs. 2–42. Featherstone (2008), *Rigid Body Dynamics Algorithms*, chapters 5, 6.
    """

    modes: TrussModes
    arms: tuple[RobotArm, ...]
    elastic_integrals: bool
    attitude: AttitudeCoordinates = EULER
    groups: tuple[tuple[int, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        set_fields(self, arms=tuple(self.arms))
        if len(self.arms) != self.modes.grasps:
            raise ModelError(
                f"the truss has {self.modes.grasps} grasp points but {len(self.arms)} arms are "
                "given; each grasp point needs one"
            )
        # The first arm that is equal to an arm identifies the group of that arm.
        first_like = [
            next(j for j, a in enumerate(self.arms) if a.same_as(arm))
            for arm in self.arms
        ]
        groups = tuple(
            tuple(i for i, j in enumerate(first_like) if j == first)
            for first in dict.fromkeys(first_like)
        )
        set_fields(self, groups=groups)

    @property
    def joints(self) -> int:
        """Number of joints of all robots together."""
        return sum(arm.joints for arm in self.arms)

    @property
    def joint_data(self) -> tuple[Joint, ...]:
        """Joints of all robots, robot by robot."""
        return tuple(joint for arm in self.arms for joint in arm.joint_data)

    @property
    def rigid_coordinates(self) -> int:
        """Number of rigid coordinates: `rigid_freedoms`, one more with a quaternion."""
        return self.attitude.end + self.joints

    @property
    def coordinates(self) -> int:
        """Number of coordinates: `freedoms`, one more with a quaternion."""
        return self.rigid_coordinates + self.modes.modes

    @property
    def rigid_freedoms(self) -> int:
        """Number of rigid speeds, 6 + joints."""
        return 6 + self.joints

    @property
    def freedoms(self) -> int:
        """Number of speeds, n."""
        return self.rigid_freedoms + self.modes.modes

    @property
    def actuators(self) -> int:
        """Number of actuator inputs, six per robot and one per joint."""
        return 6 * len(self.arms) + self.joints

    @property
    def rest(self) -> Vector:
        """Coordinates at rest: origin, no rotation, the arms' rest angles, undeformed."""
        angles = [arm.rest_angles for arm in self.arms]
        return np.concatenate(
            [np.zeros(3), self.attitude.rest, *angles, np.zeros(self.modes.modes)]
        )

    def without_modes(self) -> TrussDynamics:
        """Return the equations of the same system with a rigid truss."""
        return replace(self, modes=self.modes.truncated(0))

    def with_drives(self, inertias: Vector) -> TrussDynamics:
        """Return the equations of the same system with other drives of the joints.

        Parameters
        ----------
        inertias : Vector, shape (joints,)
            Inertia of each drive, reflected to its joint [kg·m²; kg where joints slide].

        Raises
        ------
        ModelError
            If an inertia is negative or not finite.
        """
        each, arms = iter(np.broadcast_to(inertias, self.joints)), []
        for arm in self.arms:
            joints = [
                joint._replace(inertia=float(next(each))) for joint in arm.joint_data
            ]
            arms.append(replace(arm, joint_data=tuple(joints)))
        return replace(self, arms=tuple(arms))

    def evaluate(
        self, q: Array, v: Array | None = None, truss: ModalData | None = None
    ) -> DynamicsTerms:
        r"""Return mass matrix, bias and actuation matrix, which share their intermediate results.

        Parameters
        ----------
        q : array, shape (n,)
            Coordinates. Position and attitude have no effect.
        v : array, shape (n,), optional
            Speeds; by default zero.
        truss : ModalData, optional
            Data of as many modes and grasp points; by default those of `modes`.

        Returns
        -------
        DynamicsTerms

        Raises
        ------
        ModelError
            If `q` or `v` has the wrong size.

        References
        ----------
        Li, Wei, Chen (2026), Eqs. 18–24, 31–42.
        """
        v = np.zeros(self.freedoms) if v is None else v
        self._check_sizes(q=q, v=v)
        first_mode, first_rate = self.rigid_coordinates, self.rigid_freedoms
        modal, rates = q[first_mode:], v[first_rate:]
        truss = self.modes.data if truss is None else truss
        hands = [
            hand_motion(truss, i, modal, v[:6], rates, exact=self.elastic_integrals)
            for i in range(len(self.arms))
        ]
        robots = self._robots(hands, q[self.attitude.end : first_mode], v[6:first_rate])
        # [1] selects the undeformed positions of Eq. 19, [1, tau] the deformed ones.
        deformation = np.ones(1)
        if self.elastic_integrals:
            deformation = np.concatenate([deformation, modal])
        own = truss_terms(truss, deformation, v[:3], v[3:6], rates)
        return assembled(own, hands, robots, [arm.mass for arm in self.arms])

    def kinematics(self, q: Array, v: Array) -> Array:
        r"""Return the rates of the coordinates.

        .. math:: \dot r_t = R_t v_t, \qquad \dot\Theta_t = A^{-1} \omega_t

        with :math:`A^{-1}` of the Euler angles; see `Quaternion` for quaternions.

        Parameters
        ----------
        q : array, shape (n,)
            Coordinates.
        v : array, shape (n,)
            Speeds.

        Returns
        -------
        array, shape (n,)
            :math:`\dot q`; Euler angles are singular where :math:`\cos\phi = 0`.

        Raises
        ------
        ModelError
            If `q` or `v` has the wrong size.

        References
        ----------
        Li, Wei, Chen (2026), Eq. 44.
        """
        self._check_sizes(q=q, v=v)
        attitude = q[3 : self.attitude.end]
        # Eq. 44: v is in truss axes, the position in inertial axes.
        position_rate = self.attitude.rotation(attitude) @ v[:3]
        attitude_rate = self.attitude.rates(attitude, v[3:6])
        return np.concatenate([position_rate, attitude_rate, v[6:]])

    def elastic_force(
        self,
        q: Array,
        v: Array,
        frequency: Array | None = None,
        damping_ratio: Array | None = None,
    ) -> Array:
        r"""Return the generalized elastic and damping force.

        .. math:: F^E = [0;\; -\Lambda \tau - 2 \zeta \sqrt{\Lambda}\, \dot\tau]

        Parameters
        ----------
        q : array, shape (n,)
            Coordinates.
        v : array, shape (n,)
            Speeds.
        frequency : array, shape (h,), optional
            Natural frequencies [Hz]; by default those of `modes`.
        damping_ratio : array, shape (h,), optional
            Damping ratios [1]; by default those of `modes`.

        Returns
        -------
        array, shape (n,)
            [N, N·m, N/kg^½].

        Raises
        ------
        ModelError
            If `q` or `v` has the wrong size.

        References
        ----------
        Li, Wei, Chen (2026), Eq. 29; modal damping added, zero in the paper.
        """
        self._check_sizes(q=q, v=v)
        first, first_rate = self.rigid_coordinates, self.rigid_freedoms
        omega = 2 * np.pi * (self.modes.frequencies if frequency is None else frequency)
        zeta = self.modes.damping_ratios if damping_ratio is None else damping_ratio
        # Eq. 29, with Lambda diagonal; the term of damping is an addition to the paper.
        modal = -(omega**2) * q[first:] - 2 * zeta * omega * v[first_rate:]
        return np.concatenate([np.zeros(first_rate), modal])

    def momentum(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return linear and angular momentum about the inertial origin, in inertial axes.

        Parameters
        ----------
        q : array, shape (n,)
            Coordinates.
        v : array, shape (n,)
            Speeds.

        Returns
        -------
        linear : array, shape (3,)
            [kg·m/s].
        angular : array, shape (3,)
            [N·m·s].

        Raises
        ------
        ModelError
            If `q` or `v` has the wrong size.

        Notes
        -----
        The first six rows of M v are the momentum about :math:`O_t` in truss axes. With
        ``elastic_integrals=False`` they omit the elastic displacement, so that momentum is conserved
        only approximately.
        """
        self._check_sizes(v=v)
        # The first six rows of M v are the momentum about O_t, in truss axes.
        about_truss = self.evaluate(q).mass_matrix[:6] @ v
        rotation = self.attitude.rotation(q[3 : self.attitude.end])
        linear = rotation @ about_truss[:3]
        # The shift of the reference point from O_t to the inertial origin adds r x p.
        return linear, rotation @ about_truss[3:] + np.cross(q[:3], linear)

    def grasp_displacement(self, q: Array, truss: ModalData | None = None) -> Array:
        r"""Return the elastic displacements :math:`T_i\tau` of the grasp points.

        Parameters
        ----------
        q : array, shape (n,)
            Coordinates.
        truss : ModalData, optional
            Data of the truss; by default those of `modes`.

        Returns
        -------
        array, shape (k, 3)
            Displacements in the truss frame [m].

        Raises
        ------
        ModelError
            If `q` has the wrong size.
        """
        self._check_sizes(q=q)
        modal = q[self.rigid_coordinates :]
        translations = (self.modes.data if truss is None else truss).grasp_translations
        return stacked([translation @ modal for translation in translations], (3,))

    def _check_sizes(self, **vectors: Array) -> None:
        for name, values in vectors.items():
            # A quaternion has one coordinate more than the angular velocity has
            # components.
            root = self.attitude.end if name == "q" else 6
            size = root + self.joints + self.modes.modes
            if shape_of(values) != (size,):
                raise ModelError(
                    f"{name} has shape {shape_of(values)}; it must be ({size},): {root} for the "
                    f"truss, {self.joints} joints, {self.modes.modes} modes"
                )

    def _robots(
        self, hands: list[HandMotion], angles: Array, rates: Array
    ) -> list[ArmTerms]:
        """Return the terms of every robot; equal robots share one compiled kernel."""
        ends = np.cumsum([arm.joints for arm in self.arms]).tolist()
        spans = [
            slice(end - arm.joints, end)
            for arm, end in zip(self.arms, ends, strict=True)
        ]
        motions = [
            (
                angles[span],
                rates[span],
                hand.rotation,
                hand.position,
                hand.velocity,
                hand.acceleration,
            )
            for span, hand in zip(spans, hands, strict=True)
        ]
        robots: dict[int, ArmTerms] = {}
        for group in self.groups:
            results = repeated(
                partial(arm_terms, self.arms[group[0]]), [motions[i] for i in group]
            )
            robots.update(
                zip(group, (ArmTerms(*terms) for terms in results), strict=True)
            )
        # Groups collect equal arms, so their order is not that of the robots.
        return [robots[i] for i in range(len(self.arms))]
