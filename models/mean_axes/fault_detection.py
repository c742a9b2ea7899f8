"""Fault detection and isolation (FDI) of the actuators, from measured joint rates."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock, thrusts_of
from trussflow.models.mean_axes.free_modes import FreeModes
from trussflow.models.plant.truss_block import (
    ACTUATOR_UNITS,
    FORCE_UNITS,
    POSITION_UNITS,
    RATE_UNITS,
)


class FaultDetection(MeanAxesBlock):
    r"""Detection of failed bases and arm drives by a CUSUM test of the joint rates.

    With parts g, the base and the drives of each robot, the change of the joint rates in a sample is

    .. math::
        \Delta\dot\theta = \sum_g a_g - T_s S_\theta G^{-1} (c - w_r) + r, \qquad
        a_g = T_s S_\theta G^{-1} P_g Q_g,

    at the measured joints, with the disturbance w of the truss frame, such as that of an unknown load. The
    residual r is noise if all actuators are healthy, plus :math:`-a_g` if part g has failed. The force of a
    base accelerates its own arm first, so the residual is immediate and isolates the robot. The failure of
    a whole robot is the sum of its two parts. The CUSUM statistic of a failure h sums log-likelihood ratios,

    .. math::
        S_h \leftarrow \max\left(0,\ S_h - \frac{a_h^T R^{-1} r + \delta\, a_h^T R^{-1} a_h}{s}\right), \quad
        s = \max\left(s_0,\ \min_h \frac{|r + a_h|^2_{R^{-1}}}{n}\right)

    with a and r summed over two samples, which cancels vibrations at half the sample rate (so that each
    sample counts about twice), and

    .. math:: R = 2\sigma^2 I + S_\theta\, \mathrm{diag}\left(\frac{T_s\,|B\,q|^2_j}{\zeta\Omega_j}
              \sin^2 \Omega_j T_s\right) S_\theta^T + \left|2 T_s S_\theta G^{-1} \tau\right|^2
              + \lambda^2 \sum_g a_g a_g^T

    the covariance of r. Its terms are the noise of the measured rates; the free modes, excited by thrust
    steps q in every sample; torques :math:`\tau` of thrust on arms with uncertain angles; and a relative
    uncertainty :math:`\lambda` of the effect of each part, for example by the length of its arm. The scale s
    of R is the residual variance per joint, of n joints, under the most likely failure or none (a = 0), and
    at least :math:`s_0`. So residuals that no failure explains, such as larger vibrations, do not increase
    any statistic.

    If the largest statistic exceeds the threshold, the candidates are the parts common to all failures whose
    statistic exceeds a share of the largest one. A candidate in two consecutive samples is isolated as
    failed, permanently (the sample of the failure itself fits no failure). If the failures of a base and of
    its robot cannot be distinguished yet, the base is isolated first. The transient of a failure can mimic
    failures of others, so in a holdoff time only the same robot is tested. The failure of an inactive part
    is not detectable until it is used.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time, noise, and threshold.
    held_joints : bool
        Whether joints with failed drives are held instead of free. The expected torque of a failed drive is
        then that of its brake.

    References
    ----------
    Page (1954), *Continuous inspection schemes*, Biometrika 41 (CUSUM); Basseville, Nikiforov (1993),
    *Detection of Abrupt Changes*, chapter 2. :math:`\delta = 1/2` gives the likelihood ratio; a larger drift
    term delays detection.
    """

    position = Input("rigid_q", unit=POSITION_UNITS, meaning="measured x_1")
    velocity = Input("rigid", unit=RATE_UNITS, meaning="measured x_2")
    actuation = Input(
        "actuators",
        unit=ACTUATOR_UNITS,
        meaning="Q of healthy actuators until the next sample",
    )
    disturbance = Input("rigid", unit=FORCE_UNITS, default=0.0, meaning="w")
    effectiveness = Output("actuators", unit="1", meaning="health: 0 failed, 1 healthy")
    evidence = Output(
        "losses", meaning="S of bases, of drives of the arms, of whole robots"
    )

    expected = State(
        ("joints", "columns"),
        meaning="predicted change of rates by each part, and the rest",
    )
    rates = State("joints", meaning="previous measured rates")
    before = State(
        ("joints", "columns"), meaning="a of each part, and r, of the previous sample"
    )
    sums = State("losses", meaning="S")
    suspected = State("parts", meaning="1 for candidates of a failure")
    dead = State("parts", meaning="1 for failed parts")
    truce = State("losses", unit="s", meaning="remaining holdoff time")

    unknown_share = Parameter(minimum=0.0, meaning="lambda")
    calm = Parameter(above=0.0, meaning="s_0")
    drift = Parameter(minimum=0.5, meaning="delta")
    threshold = Parameter(above=0.0, meaning="decision threshold of S")
    doubt = Parameter(
        minimum=0.0, meaning="isolation threshold, share of the largest S"
    )
    settling = Parameter(
        minimum=0.0, unit="s", meaning="holdoff time of other robots after a failure"
    )

    def __init__(
        self, dynamics: TrussDynamics, design: MeanAxesDesign, held_joints: bool = False
    ) -> None:
        robots, joints = len(dynamics.arms), dynamics.joints
        self.held = np.append(np.zeros(6 * robots), np.full(joints, held_joints))
        self.parts, self.columns, self.losses = 2 * robots, 2 * robots + 1, 3 * robots
        sizes = [6] * robots + [arm.joints for arm in dynamics.arms]
        # One column per part: the six actuators of each base, then the drives of each
        # arm.
        self.members = np.repeat(np.eye(self.parts), sizes, axis=0)
        # A robot without joints affects only the joints of others, through the flexible truss: not tested.
        self.judged = np.tile([float(arm.joints > 0) for arm in dynamics.arms], 3)
        # One column per candidate: each single part, then both parts of each robot.
        self.shares = np.hstack([np.eye(self.parts), np.tile(np.eye(robots), (2, 1))])
        free, time = FreeModes.of(dynamics, dynamics.modes.modes), design.sample_time
        shaken = design.unknown_thrust**2 * np.sum(
            free.influence[:, thrusts_of(dynamics)] ** 2, axis=1
        )
        shaken *= (
            time
            * np.sin(free.frequencies * time) ** 2
            / (design.structural_damping * free.frequencies)
        )
        ringing = free.root_motion[6:] * np.sqrt(shaken)
        scatter = (
            2.0 * time * design.unknown_torque * np.linalg.inv(free.inertia)[6:, 6:]
        )
        # The sum over two samples is the difference of two measured rates.
        noise = 2.0 * design.rate_noise**2 * np.eye(joints)
        self.covariance = noise + ringing @ ringing.T + scatter @ scatter.T
        self.precision = np.linalg.inv(self.covariance)
        super().__init__(dynamics, design)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return health and statistics."""
        return {"effectiveness": 1.0 - self.members @ x.dead, "evidence": x.sums}

    def evidence_of(self, effects: Array, residue: Array, p: Signals) -> Array:
        """Return the change of each statistic by the sums over two samples [-].

        Parameters
        ----------
        effects : array, shape (joints, parts)
            Effect of each part, a [rad/s].
        residue : array, shape (joints,)
            Residual, r [rad/s].
        p : Signals
            Parameters of the run.
        """
        seen, unsure = np.reshape(residue, (self.joints, 1)), p.unknown_share**2
        if self.joints > self.parts:
            # Woodbury's formula, without cancellation. Let R0 be R without its last term,
            # A the matrix of all a, N = A^T R0^-1 A. Then A^T R^-1 = (1 + lambda^2 N)^-1 A^T R0^-1, and |r|^2
            # is the minimum over the shares of the norm of the rest plus that of the shares.
            told = effects.T @ self.precision @ np.concatenate([effects, seen], axis=1)
            told = solve_positive_definite(
                np.eye(self.parts) + unsure * told[:, : self.parts], told
            )
            shares = told[:, self.parts]
            rest = residue - unsure * effects @ shares
            size = rest @ self.precision @ rest + unsure * shares @ shares
        else:  # N is singular
            doubted = self.covariance + unsure * effects @ effects.T
            weighed = solve_positive_definite(
                doubted, np.concatenate([effects, seen], axis=1)
            )
            told, size = effects.T @ weighed, residue @ weighed[:, self.parts]
        told = self.shares.T @ told
        match, strength = (
            told[:, self.parts],
            np.sum(self.shares.T * told[:, : self.parts], axis=1),
        )
        left = size + np.minimum(0.0, np.min(2.0 * match + strength))
        scale = np.maximum(p.calm, left / max(self.joints, 1))
        return -(match + p.drift * strength) / scale

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Update the statistics by the measured rates, and predict their next change."""
        surprise = u.velocity[6:] - x.rates - np.sum(x.expected, axis=1)
        now = np.concatenate(
            [x.expected[:, : self.parts], np.reshape(surprise, (self.joints, 1))],
            axis=1,
        )
        each, residue = (
            (now + x.before)[:, : self.parts],
            (now + x.before)[:, self.parts],
        )
        sums = x.sums + self.evidence_of(each, residue, p)
        sums = (
            np.where(np.logical_and(sums > 0.0, x.truce <= 0.0), sums, 0.0)
            * self.judged
        )
        likely = np.where(sums >= p.doubt * np.max(sums), 1.0, 0.0)
        common = (1.0 - self.shares) @ likely < 0.5
        suspected = np.where(
            np.logical_and(common, np.max(sums) > p.threshold), 1.0 - x.dead, 0.0
        )
        # Only candidates of two successive samples count, so that one outlier has no
        # effect.
        found = suspected * x.suspected
        spared = np.where(self.shares.T @ found > 0.0, 0.0, p.settling)
        new = np.max(found) > 0.0
        terms = self.dynamics.evaluate(u.position, u.velocity)
        dead = x.dead + found
        acting = self.members * np.reshape(1.0 - dead, (1, self.parts))
        parts = terms.actuation_matrix @ (
            acting * np.reshape(u.actuation, (self.actuators, 1))
        )
        brakes = terms.actuation_matrix @ (
            self.held * (self.members @ dead) * u.actuation
        )
        others = np.concatenate([u.disturbance[:6], np.zeros(self.joints)]) - terms.bias
        others = others + brakes
        forces = np.concatenate([parts, np.reshape(others, (self.rigid, 1))], axis=1)
        change = solve_positive_definite(terms.mass_matrix, forces)
        return {
            "expected": self.design.sample_time * change[6:],
            "rates": u.velocity[6:],
            "before": now,
            "sums": np.where(new, 0.0, sums),
            "suspected": suspected,
            "dead": dead,
            "truce": np.where(new, spared, x.truce - self.design.sample_time),
        }
