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
from trussflow.models.mean_axes.estimator import MeanAxesBlock
from trussflow.models.mean_axes.free_modes import FreeModes


class ActuatorMonitor(MeanAxesBlock):
    r"""Tell which bases, and the drives of which arms, are dead, from what the joints do.

    With groups g of actuators, those of a base and the drives of its arm for each robot, the joints change
    their rates from one sample to the next by

    .. math::
        \Delta\dot\theta = \sum_g a_g - T_s S_\theta G^{-1} (c - w_r) + r, \qquad
        a_g = T_s S_\theta G^{-1} P_g Q_g

    at the measured joints, with the disturbance w of the root, as an unknown load is one. The residue r is
    noise if all is well, and :math:`-a_g` besides if group g is dead: a base pulls its own arm first, so its
    loss shows at once, and the arm tells whose it was. The evidence of each such loss adds up the logarithms
    of the ratio of the two likelihoods (CUSUM),

    .. math:: S_g \leftarrow \max(0,\ S_g - a_g^T R^{-1} r - \delta\, a_g^T R^{-1} a_g)

    with a and r the sums over two samples, in which what vibrates at half the sample rate cancels (so that
    each sample counts about twice), and R
    the covariance of r: noise of the measured rates, and of forces that the model does not know. The loss
    whose evidence is the greatest and above the threshold is believed for good. What that shook may draw
    suspicion on others, so for a while nobody is suspected. Of a group that does nothing nothing can be
    learnt: its loss is found when it is needed; and where a base and its arm die together, they hardly move
    against each other, which takes longer to tell.

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

    position = Input("rigid", unit=Attribute("task_units"), meaning="measured x_1")
    velocity = Input("rigid", unit=Attribute("rigid_speed_units"), meaning="measured x_2")
    actuation = Input(
        "actuators", unit=Attribute("actuator_units"), meaning="Q ordered until the next sample"
    )
    disturbance = Input("rigid", unit=Attribute("force_units"), default=0.0, meaning="w")
    effectiveness = Output("actuators", unit="1", meaning="0 of what is dead, 1 of all others")
    evidence = Output("groups", meaning="S: bases, then drives of the arms")

    expected = State(("joints", "columns"), meaning="next change of rates: by each group, and by all else")
    rates = State("joints", meaning="measured before")
    before = State(("joints", "columns"), meaning="a of each group, and r, of the sample before")
    sums = State("groups", meaning="S")
    dead = State("groups", meaning="1 where dead")
    truce = State(unit="s", meaning="for how long nobody is suspected")

    drift = Parameter(minimum=0.5, meaning="delta")
    threshold = Parameter(above=0.0, meaning="of the evidence")
    settling = Parameter(minimum=0.0, unit="s", meaning="for how long nobody is suspected after a loss")

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign) -> None:
        robots, joints = len(dynamics.arms), dynamics.joints
        self.groups, self.columns = 2 * robots, 2 * robots + 1
        sizes = [6] * robots + [arm.joints for arm in dynamics.arms]
        self.members = np.repeat(np.eye(self.groups), sizes, axis=0)
        response = np.linalg.inv(FreeModes.of(dynamics, 0).inertia)[6:]
        unknown = np.repeat([design.unknown_force, design.unknown_torque], (6, joints))
        scatter = 2.0 * design.sample_time * response * unknown
        self.precision = np.linalg.inv(2.0 * design.rate_noise**2 * np.eye(joints) + scatter @ scatter.T)
        super().__init__(
            dynamics, design, drift=design.drift, threshold=design.threshold, settling=design.settling
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what is dead, and the evidence."""
        return {"effectiveness": 1.0 - self.members @ x.dead, "evidence": x.sums}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Weigh the rates measured, and expect their next change."""
        surprise = u.velocity[6:] - x.rates - np.sum(x.expected, axis=1)
        now = np.concatenate([x.expected[:, : self.groups], np.reshape(surprise, (self.joints, 1))], axis=1)
        told, residue = (now + x.before)[:, : self.groups], (now + x.before)[:, self.groups]
        weighed = self.precision @ told
        sums = x.sums - residue @ weighed - p.drift * np.sum(told * weighed, axis=0)
        sums = np.where(np.logical_and(sums > 0.0, x.truce <= 0.0), sums, 0.0)
        found = np.logical_and(sums > p.threshold, sums >= np.max(sums))
        terms = self.dynamics.evaluate(u.position, u.velocity)
        each = terms.actuation_matrix @ (self.members * np.reshape(u.actuation, (self.actuators, 1)))
        others = np.concatenate([u.disturbance[:6], np.zeros(self.joints)]) - terms.bias
        forces = np.concatenate([each, np.reshape(others, (self.rigid, 1))], axis=1)
        change = solve_positive_definite(terms.mass_matrix, forces)
        return {
            "expected": self.design.sample_time * change[6:],
            "rates": u.velocity[6:],
            "before": now,
            "sums": sums,
            "dead": np.where(found, 1.0, x.dead),
            "truce": np.where(np.any(found), p.settling, x.truce - self.design.sample_time),
        }
