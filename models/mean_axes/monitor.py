"""Which actuators still do what they are told, from what the joints do."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.linear_algebra import solve_positive_definite
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock, thrusts_of
from trussflow.models.mean_axes.free_modes import FreeModes


class ActuatorMonitor(MeanAxesBlock):
    r"""Tell which bases, and the drives of which arms, are dead, from what the joints do.

    With parts g, the base and the drives of each robot, the joints change their rates from one sample to the
    next by

    .. math::
        \Delta\dot\theta = \sum_g a_g - T_s S_\theta G^{-1} (c - w_r) + r, \qquad
        a_g = T_s S_\theta G^{-1} P_g Q_g,

    at the measured joints, with the disturbance w of the root, as an unknown load is one. The residue r is
    noise if all is well, and :math:`-a_g` besides if part g is dead: a base pulls its own arm first, so its
    loss shows at once, and the arm tells whose it was. If a whole robot h is dead, it is the sum of its two
    parts. The evidence of each such loss adds up the logarithms of the ratio of the two likelihoods (CUSUM),

    .. math::
        S_h \leftarrow \max\left(0,\ S_h - \frac{a_h^T R^{-1} r + \delta\, a_h^T R^{-1} a_h}{s}\right), \quad
        s = \max\left(s_0,\ \min_h \frac{|r + a_h|^2_{R^{-1}}}{n}\right)

    with a and r the sums over two samples, in which what vibrates at half the sample rate cancels (so that
    each sample counts about twice), and

    .. math:: R = 2\sigma^2 I + S_\theta\, \mathrm{diag}\left(\frac{T_s\,|B\,q|^2_j}{\zeta\Omega_j}
              \sin^2 \Omega_j T_s\right) S_\theta^T + \left|2 T_s S_\theta G^{-1} \tau\right|^2
              + \lambda^2 \sum_g a_g a_g^T

    the covariance of r: noise of the measured rates, all free modes as steps q of the thrust in every sample
    keep them ringing, torques :math:`\tau` of thrust on arms whose angles are known to a noise only, and a
    share :math:`\lambda` of what each part does, as it is known to that only: thrust has a longer lever than
    believed if its arm is longer. A loss is all of what a part does, so it still stands out. Of R only the
    shape is believed: its scale s is what the best explanation, no loss among them with a = 0, leaves of the
    residue, by its n joints, and at least :math:`s_0`. So what no loss explains, such as modes that ring more
    than expected, speaks for none.

    When the greatest evidence is above the threshold, what all losses have in common whose evidence is more
    than a share of it is suspected, and believed to be dead, for good, if it still is one sample later (the
    one in which it died fits no loss). So where a base and its robot cannot be told
    apart yet, the base is believed dead, and the drives may follow. What a loss shook may draw suspicion on
    others, so for a while only its own robot is suspected further. Of a part that does nothing nothing can be
    learnt: its loss is found when it is needed.

    Parameters
    ----------
    dynamics : TrussDynamics
        What is believed: robots and truss.
    design : MeanAxesDesign
        Sample time, noise, and threshold.

    References
    ----------
    Page (1954), *Continuous inspection schemes*, Biometrika 41, for the sums; Basseville, Nikiforov (1993),
    *Detection of Abrupt Changes*, chapter 2. With :math:`\delta = 1/2` it is the ratio of likelihoods; more
    makes it slower to suspect.
    """

    position = Input("rigid_q", unit=Attribute("position_units"), meaning="measured x_1")
    velocity = Input("rigid", unit=Attribute("rigid_speed_units"), meaning="measured x_2")
    actuation = Input(
        "actuators", unit=Attribute("actuator_units"), meaning="Q ordered until the next sample"
    )
    disturbance = Input("rigid", unit=Attribute("force_units"), default=0.0, meaning="w")
    effectiveness = Output("actuators", unit="1", meaning="0 of what is dead, 1 of all others")
    evidence = Output("losses", meaning="S: bases, then drives of the arms, then whole robots")

    expected = State(("joints", "columns"), meaning="next change of rates: by each part, and by all else")
    rates = State("joints", meaning="measured before")
    before = State(("joints", "columns"), meaning="a of each part, and r, of the sample before")
    sums = State("losses", meaning="S")
    suspected = State("parts", meaning="1 where it seems dead, and was not")
    dead = State("parts", meaning="1 where dead")
    truce = State("losses", unit="s", meaning="for how long each is not suspected")

    unknown_share = Parameter(minimum=0.0, meaning="lambda")
    calm = Parameter(above=0.0, meaning="s_0")
    drift = Parameter(minimum=0.5, meaning="delta")
    threshold = Parameter(above=0.0, meaning="of the evidence")
    doubt = Parameter(minimum=0.0, meaning="share of the greatest evidence from which a loss is thought of")
    settling = Parameter(
        minimum=0.0, unit="s", meaning="for how long no other robot is suspected after a loss"
    )

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign) -> None:
        robots, joints = len(dynamics.arms), dynamics.joints
        self.parts, self.columns, self.losses = 2 * robots, 2 * robots + 1, 3 * robots
        sizes = [6] * robots + [arm.joints for arm in dynamics.arms]
        self.members = np.repeat(np.eye(self.parts), sizes, axis=0)
        # A robot without joints shows itself in those of others only, through a truss that is not rigid.
        self.judged = np.tile([float(arm.joints > 0) for arm in dynamics.arms], 3)
        self.shares = np.hstack([np.eye(self.parts), np.tile(np.eye(robots), (2, 1))])
        free, time = FreeModes.of(dynamics, dynamics.modes.modes), design.sample_time
        shaken = design.unknown_thrust**2 * np.sum(free.influence[:, thrusts_of(dynamics)] ** 2, axis=1)
        shaken *= time * np.sin(free.frequencies * time) ** 2 / (design.structural_damping * free.frequencies)
        ringing = free.root_motion[6:] * np.sqrt(shaken)
        scatter = 2.0 * time * design.unknown_torque * np.linalg.inv(free.inertia)[6:, 6:]
        noise = 2.0 * design.rate_noise**2 * np.eye(joints)
        self.covariance = noise + ringing @ ringing.T + scatter @ scatter.T
        self.precision = np.linalg.inv(self.covariance)
        believing = {
            name: getattr(design, name)
            for name in ("unknown_share", "calm", "drift", "threshold", "doubt", "settling")
        }
        super().__init__(dynamics, design, **believing)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what is dead, and the evidence."""
        return {"effectiveness": 1.0 - self.members @ x.dead, "evidence": x.sums}

    def evidence_of(self, effects: Array, residue: Array, p: Signals) -> Array:
        """Return by how much two samples raise, or lower, the evidence of each loss [-].

        Parameters
        ----------
        effects : array, shape (joints, parts)
            a of each part [rad/s].
        residue : array, shape (joints,)
            r [rad/s].
        p : Signals
            The parameters.
        """
        seen, unsure = np.reshape(residue, (self.joints, 1)), p.unknown_share**2
        if self.joints > self.parts:
            # Woodbury's formula without differences of large numbers: with N = A^T R^-1 A, of R without its
            # last term and A of all a, A^T R^-1 with that term is (1 + lambda^2 N)^-1 A^T R^-1 without. And
            # |r|^2 is the least of what doubted shares leave, and of these.
            told = effects.T @ self.precision @ np.concatenate([effects, seen], axis=1)
            told = solve_positive_definite(np.eye(self.parts) + unsure * told[:, : self.parts], told)
            shares = told[:, self.parts]
            rest = residue - unsure * effects @ shares
            size = rest @ self.precision @ rest + unsure * shares @ shares
        else:  # N is singular
            doubted = self.covariance + unsure * effects @ effects.T
            weighed = solve_positive_definite(doubted, np.concatenate([effects, seen], axis=1))
            told, size = effects.T @ weighed, residue @ weighed[:, self.parts]
        told = self.shares.T @ told
        match, strength = told[:, self.parts], np.sum(self.shares.T * told[:, : self.parts], axis=1)
        left = size + np.minimum(0.0, np.min(2.0 * match + strength))
        scale = np.maximum(p.calm, left / max(self.joints, 1))
        return -(match + p.drift * strength) / scale

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Weigh the rates measured, and expect their next change."""
        surprise = u.velocity[6:] - x.rates - np.sum(x.expected, axis=1)
        now = np.concatenate([x.expected[:, : self.parts], np.reshape(surprise, (self.joints, 1))], axis=1)
        each, residue = (now + x.before)[:, : self.parts], (now + x.before)[:, self.parts]
        sums = x.sums + self.evidence_of(each, residue, p)
        sums = np.where(np.logical_and(sums > 0.0, x.truce <= 0.0), sums, 0.0) * self.judged
        likely = np.where(sums >= p.doubt * np.max(sums), 1.0, 0.0)
        common = (1.0 - self.shares) @ likely < 0.5
        suspected = np.where(np.logical_and(common, np.max(sums) > p.threshold), 1.0 - x.dead, 0.0)
        found = suspected * x.suspected
        spared = np.where(self.shares.T @ found > 0.0, 0.0, p.settling)
        new = np.max(found) > 0.0
        terms = self.dynamics.evaluate(u.position, u.velocity)
        dead = x.dead + found
        acting = self.members * np.reshape(1.0 - dead, (1, self.parts))
        parts = terms.actuation_matrix @ (acting * np.reshape(u.actuation, (self.actuators, 1)))
        others = np.concatenate([u.disturbance[:6], np.zeros(self.joints)]) - terms.bias
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
