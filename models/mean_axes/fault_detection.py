"""Fault detection and isolation (FDI) of the bases, by estimates of the effect that each has lost."""

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
    POSITION_UNITS,
    RATE_UNITS,
)

RATE_GAIN, DRIFT_GAIN = 0.5, 0.05
"""Gains of the filter of the joint rates and their drifts [-]."""

FRAME_RATE_GAIN, FRAME_DRIFT_GAIN = 0.2, 2e-3
"""Gains for the rates of the truss frame, whose vibrations are slower [-]."""

MEMORY, RECENT_MEMORY, FRAME_MEMORY = 0.95, 0.8, 0.98
"""Weight of the evidence of the sample before: of the joints, long and short, and of the truss frame [-]."""

FAILED, SUDDENLY_FAILED, WORKING, HELD = 0.65, 0.5, 0.4, 0.5
"""Lost shares above which a base has failed, also by recent evidence, below which it works, and of held arms [-]."""

COMMON_LOSS = 0.3
"""Lost share of a base that counts for a cause that most bases have in common, such as wrong gains [-]."""

MAX_LOST_SHARE = 1.35
"""Lost share of a base above which the cause is none of the hypotheses [-]."""

FRAME_THRESHOLD = 2.5
"""Threshold of the lost share of the base of a held arm, and lead over others, in standard deviations [-]."""

RECENTLY_HELD = 0.1
"""Value of `held_arms` 2.3 s after the arm was held [-]."""

SETTLING_TIME = 3.0
"""Time after an isolation without another one, in which the vibration by the other commands decays [s]."""

UNEXPLAINED_VARIANCE = 3.0
"""Relative variance above which a sample shows a sudden failure, or a residual has another cause [-]."""


class FaultDetection(MeanAxesBlock):
    r"""Estimates of the share of their effect that bases and arm drives have lost, and failed bases.

    The rates of truss frame and joints change in a sample by

    .. math::
        \Delta\nu = \sum_g (1 - \lambda_g)\,a_g + d - T_s G^{-1} c, \qquad a_g = T_s G^{-1} P_g Q_g

    with the lost share :math:`\lambda_g` of each part g, which is the base or the drives of a robot. d are
    slow unknown changes, such as those of encoder biases or open valves. A filter with constant gains
    estimates :math:`\nu` and d for :math:`\lambda = 0`. Its innovation is :math:`e = -Y\lambda` plus noise,
    where Y is the response of the same filter to the effects a. Least squares with exponential forgetting
    give :math:`\lambda` from the innovations of the joints, and its covariance. Only changes count:
    constant torques are in d. `ActuatorExcitation` keeps all parts moving. If an innovation is much larger
    than noise, a sudden failure is likely: Y and the evidence then start anew at this sample.

    * A base has failed if its lost share is large, significant, and the most significant one of the bases in
      use, in two consecutive samples. Commands of bases are correlated, so their lost shares are, too.
      The estimate from the last 0.1 s alone suffices if it is clear.
    * A base is isolated only if it is `dispensable`, as all are by default. Bases without which the mission
      is infeasible should not be. While such a loss is the most significant one, no other base is isolated.
    * If the drives of an arm have lost more than half of their effect, by a significant estimate of 0.4 s or 0.1 s,
      the arm is held, by its brakes or by friction. Its base is tested with the innovations of the truss frame
      alone, on which bases have similar effects. So its lost share, in standard deviations, must exceed that of
      every other arm held now or in the last 2.3 s by the threshold.
    * If the residual is larger than noise, or more than the whole effect is lost, the cause is none of these,
      and no base is isolated.
    * If most of the bases in use lose effect, the cause is common, and no base is isolated: without them the
      others could not move the truss.
    * A failed base still receives the excitation. If both estimates show its response, it is used again
      at once.
    * While the vibration after an isolation decays, no other base is isolated.

    Drives are never switched off: a held arm needs no torques, and a healthy one needs its own.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time, noise, and threshold.

    Notes
    -----
    The covariance of the sum of two innovations is

    .. math:: R = 2\sigma^2 I + S\, \mathrm{diag}\left(\frac{T_s\,|B\,q|^2_j}{\zeta\Omega_j}
              \sin^2 \Omega_j T_s\right) S^T + \left|2 T_s G^{-1} \tau\right|^2.

    Its terms are the noise of the measured rates; the free modes, excited by thrust steps q in every sample;
    and torques :math:`\tau` of thrust on arms with uncertain angles. One innovation has two thirds of it, if
    the noise is white and the gain of the rates is 0.5.

    References
    ----------
    Zhang (2002), *Adaptive observer for multiple-input-multiple-output linear time-varying systems*, IEEE
    Transactions on Automatic Control 47(3); Basseville, Nikiforov (1993), *Detection of Abrupt Changes*.
    """

    position = Input("rigid_q", unit=POSITION_UNITS, meaning="measured x_1")
    velocity = Input("rigid", unit=RATE_UNITS, meaning="measured x_2")
    actuation = Input(
        "actuators",
        unit=ACTUATOR_UNITS,
        meaning="Q of healthy actuators until the next sample",
    )
    servo_torque = Input(
        "joints",
        default=0.0,
        meaning="mean joint torques of servos in the last sample, which are expected again in Q",
    )
    effectiveness = Output("actuators", unit="1", meaning="health: 0 failed, 1 healthy")
    held = Output("joints", meaning="1 for the joints of held arms")
    lost_shares = Output("parts", meaning="lambda of bases, then of drives of the arms")
    evidence = Output("robots", meaning="lost shares of bases, in standard deviations")
    unexplained = Output(meaning="relative variance of the residual; 1 is noise")

    rates = State("rigid", meaning="estimated rates")
    drift = State("rigid", meaning="d")
    response = State(("parts", "rigid"), meaning="Y^T after the correction, whitened")
    drift_response = State(("parts", "rigid"), meaning="the same for d")
    applied = State("actuators", meaning="Q since the previous sample, without servos")
    information = State(("parts", "parts"), meaning="information of the joints")
    match = State("parts", meaning="its product with lambda")
    recent_information = State(("parts", "parts"), meaning="the same of 0.1 s")
    recent_match = State("parts", meaning="its product with lambda")
    frame_information = State("robots", meaning="information of the truss frame")
    frame_match = State("robots", meaning="its product with lambda")
    lost = State("parts", meaning="lambda")
    deviations = State("robots", meaning="lost shares in standard deviations")
    held_arms = State("robots", meaning="1 for held arms, then decays")
    residual = State(initial=1.0, meaning="relative variance of the residual")
    suspected = State("robots", meaning="1 for bases that seem to have failed")
    failed = State("robots", meaning="1 for failed bases")
    settling = State(unit="s", meaning="remaining time without isolations")

    threshold = Parameter(
        above=0.0, meaning="significant lost share, in standard deviations"
    )
    dispensable = Parameter(
        1.0, "robots", meaning="1 for bases that may be isolated, otherwise 0"
    )

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign) -> None:
        robots = len(dynamics.arms)
        self.parts = 2 * robots
        sizes = [6] * robots + [arm.joints for arm in dynamics.arms]
        # One column per part: the six actuators of each base, then the drives of each
        # arm.
        self.members = np.repeat(np.eye(self.parts), sizes, axis=0)
        # Only joints show the failure of their base; other arms feel it through the truss.
        self.testable = np.array([float(arm.joints > 0) for arm in dynamics.arms])
        rows = [6, dynamics.joints]
        self.joint_rows = np.repeat([0.0, 1.0], rows)
        self.gains = np.repeat([FRAME_RATE_GAIN, RATE_GAIN], rows)
        self.drift_gains = np.repeat([FRAME_DRIFT_GAIN, DRIFT_GAIN], rows)
        free, time = FreeModes.of(dynamics, dynamics.modes.modes), design.sample_time
        shaken = design.unknown_thrust**2 * np.sum(
            free.influence[:, thrusts_of(dynamics)] ** 2, axis=1
        )
        shaken *= (
            time
            * np.sin(free.frequencies * time) ** 2
            / (design.structural_damping * free.frequencies)
        )
        ringing = free.root_motion * np.sqrt(shaken)
        scatter = (
            2.0 * time * design.unknown_torque * np.linalg.inv(free.inertia)[:, 6:]
        )
        noise = 2.0 * design.rate_noise**2 * np.eye(len(ringing))
        covariance = noise + ringing @ ringing.T + scatter @ scatter.T
        self.precision = np.linalg.inv(covariance[6:, 6:])
        # Rates times this matrix are in standard deviations of one innovation, with a covariance of two thirds.
        self.whitening = np.zeros(covariance.shape)
        for own, precision in (
            (slice(0, 6), np.linalg.inv(covariance[:6, :6])),
            (slice(6, len(covariance)), self.precision),
        ):
            self.whitening[own, own] = np.linalg.cholesky(1.5 * precision)
        super().__init__(dynamics, design)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return health and estimates."""
        health = np.concatenate([1.0 - x.failed, np.ones(self.robots)])
        held = np.where(x.held_arms < 1.0, 0.0, 1.0)
        return {
            "effectiveness": self.members @ health,
            "held": self.members[6 * self.robots :, self.robots :] @ held,
            "lost_shares": x.lost,
            "evidence": x.deviations,
            "unexplained": x.residual,
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Update the estimates by the measured rates."""
        robots, time = self.robots, self.design.sample_time
        servo = np.concatenate([np.zeros(6 * robots), u.servo_torque])
        acting = self.members * np.reshape(x.applied + servo, (self.actuators, 1))
        terms = self.dynamics.evaluate(u.position, u.velocity)
        forces = np.concatenate(
            [terms.actuation_matrix @ acting, np.reshape(-terms.bias, (self.rigid, 1))],
            axis=1,
        )
        change = time * solve_positive_definite(terms.mass_matrix, forces)
        predicted = x.rates + np.sum(change, axis=1) + x.drift
        innovation = u.velocity - predicted
        whitened = innovation @ self.whitening
        joint_innovation = whitened[6:]

        def relative(rest: Array) -> Array:
            return rest @ rest / max(self.joints, 1)

        effects = change[:, : self.parts].T @ self.whitening
        response = x.response + effects - x.drift_response
        settled = x.settling <= 0.0
        steady = np.logical_and(x.residual < 0.5 * UNEXPLAINED_VARIANCE, settled)
        jump = np.logical_and(
            relative(joint_innovation + x.lost @ response[:, 6:])
            > UNEXPLAINED_VARIANCE,
            steady,
        )
        restart = np.where(jump, self.joint_rows, 0.0) > 0.5
        response = np.where(restart, effects, response)
        drift_response = np.where(restart, 0.0, x.drift_response)
        joint_response = response[:, 6:]

        def estimated(memory: float, information: Array, match: Array) -> list[Array]:
            kept = np.where(jump, 0.0, memory)
            information = kept * information + joint_response @ joint_response.T
            match = kept * match - joint_response @ joint_innovation
            # One unit of prior information: without evidence nothing is lost.
            right = np.concatenate(
                [np.eye(self.parts), np.reshape(match, (self.parts, 1))], axis=1
            )
            solved = solve_positive_definite(information + np.eye(self.parts), right)
            variance = np.diag(solved[:, : self.parts])
            return [information, match, solved[:, self.parts], variance]

        information, match, lost, variance = estimated(MEMORY, x.information, x.match)
        recent_information, recent_match, recent, recent_variance = estimated(
            RECENT_MEMORY, x.recent_information, x.recent_match
        )
        residual = MEMORY * x.residual + (1.0 - MEMORY) * relative(
            joint_innovation + lost @ joint_response
        )
        noise = np.maximum(1.0, residual)

        frame = response[:robots, :6]
        frame_information = FRAME_MEMORY * x.frame_information + np.sum(
            frame**2, axis=1
        )
        frame_match = FRAME_MEMORY * x.frame_match - frame @ whitened[:6]
        frame_variance = 1.0 / (1.0 + frame_information)
        frame_lost = frame_match * frame_variance
        frame_spread = np.sqrt(noise * frame_variance)

        both = np.stack([lost, recent])
        both_spreads = np.sqrt(noise * np.stack([variance, recent_variance]))
        limit = np.maximum(HELD, p.threshold * both_spreads[:, robots:])
        clear = both[:, robots:] > limit
        held = np.logical_or(clear[0], clear[1])
        shares = np.where(held, frame_lost, both[:, :robots])
        spreads = np.where(held, frame_spread, both_spreads[:, :robots])
        deviations = shares / spreads
        held_arms = np.where(held, 1.0, FRAME_MEMORY * x.held_arms)
        frame_deviations = frame_lost / frame_spread
        rivals = np.where(held_arms > RECENTLY_HELD, frame_deviations, 0.0)
        others = np.where(np.eye(robots) > 0.0, 0.0, rivals)
        lead = FRAME_THRESHOLD + np.max(others, axis=1)
        margins = np.where(held, lead, p.threshold) * spreads
        limits = [np.maximum(FAILED, margins[0]), SUDDENLY_FAILED + margins[1]]
        possible = np.logical_or(held, shares < MAX_LOST_SHARE)
        likely = np.logical_and(shares > np.stack(limits), possible)
        explained = np.logical_and(residual < UNEXPLAINED_VARIANCE, settled)
        used = self.testable * (1.0 - x.failed)
        losing = np.where(shares[0] > COMMON_LOSS, used, 0.0)
        common = 2.0 * np.sum(losing) > np.sum(used)
        weights = np.where(np.logical_and(explained, np.logical_not(common)), used, 0.0)
        rank = np.max(np.where(likely, weights * deviations, 0.0), axis=0)
        suspected = np.where(np.logical_and(rank > 0.0, rank >= np.max(rank)), 1.0, 0.0)
        confirmed = suspected * x.suspected * p.dispensable
        largest = np.max(np.where(held, 1.0, shares + 2.0 * spreads), axis=0)
        failed = np.where(largest < WORKING, 0.0, np.maximum(x.failed, confirmed))
        return {
            "rates": predicted + self.gains * innovation,
            "drift": x.drift + self.drift_gains * innovation,
            "response": (1.0 - self.gains) * response,
            "drift_response": drift_response + self.drift_gains * response,
            "applied": u.actuation - servo,
            "information": information,
            "match": match,
            "recent_information": recent_information,
            "recent_match": recent_match,
            "frame_information": frame_information,
            "frame_match": frame_match,
            "lost": lost,
            "deviations": deviations[0],
            "held_arms": held_arms,
            "residual": residual,
            "suspected": suspected,
            "failed": failed,
            "settling": np.where(
                np.max(failed - x.failed) > 0.0, SETTLING_TIME, x.settling - time
            ),
        }
