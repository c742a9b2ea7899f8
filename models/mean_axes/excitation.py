"""Excitation for fault detection: small torques that reveal failed drives and bases at rest."""

from __future__ import annotations

import numpy as np
import scipy

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.port import Output
from trussflow.blocks.support.types import Array
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock, thrusts_of
from trussflow.models.mean_axes.fault_detection import FaultDetection
from trussflow.models.plant.truss_block import ACTUATOR_UNITS

PATTERN_SAMPLES = 4
"""Samples per period: +, -, -, +. With two, the filter of the fault detection would reduce the effect [-]."""

DRIVE_DELAY = PATTERN_SAMPLES // 4
"""Samples by which drives are excited later than bases, a quarter of a period [-]."""

NULL_SPACE_TOLERANCE = 1e-9
"""Relative tolerance of zero force on the truss [-]."""


class ActuatorExcitation(MeanAxesBlock):
    r"""Excitation of the arms by torques of drives and bases without a force on the truss at rest.

    .. math::
        Q_p(t) = \pm v \sum_g \frac{d_g}{|T_s S_\theta G^{-1} P d_g|_{R^{-1}}}, \qquad
        S_r\, G^{-1} P d_g = 0

    for the base and for the drives g of each robot, with each sign for two samples. The torques are in the
    null space of the acceleration of the truss frame r at rest, so that there is no force on the truss and
    no mode is excited. In this null space d has the largest effect on the joint rates per torque, weighted
    with the covariance R of `FaultDetection`. So the effect in each sample is v standard deviations. A part
    with an empty null space is not excited. The drives are excited a quarter of a period later than
    the bases (in quadrature). So the effects of both on the arm are uncorrelated in time, also if they have
    the same direction.

    At other joint angles, or with a locked arm, there is a small force on the truss.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    design : MeanAxesDesign
        Sample time, noise, and v.
    monitor : FaultDetection
        Fault detection with the covariance R.

    References
    ----------
    Campbell, Nikoukhah (2004), *Auxiliary Signal Design for Failure Detection*, Princeton University Press.
    """

    probe = Output("actuators", unit=ACTUATOR_UNITS, meaning="Q_p")

    strength = Parameter(minimum=0.0, meaning="v")

    def __init__(
        self, dynamics: TrussDynamics, design: MeanAxesDesign, monitor: FaultDetection
    ) -> None:
        rigid = dynamics.rigid_freedoms
        terms = dynamics.evaluate(dynamics.rest)
        response = np.linalg.solve(
            terms.mass_matrix[:rigid, :rigid], terms.actuation_matrix[:rigid]
        )
        seen = np.linalg.cholesky(monitor.precision).T @ (
            design.sample_time * response[6:]
        )
        self.shape = np.zeros(dynamics.actuators)
        for members in monitor.members.T > 0.0:
            torques = np.flatnonzero(members & ~thrusts_of(dynamics))
            # Combinations of these torques that do not accelerate the truss frame.
            still = scipy.linalg.null_space(
                response[:6, torques], rcond=NULL_SPACE_TOLERANCE
            )
            if still.size:
                _, shown, ways = np.linalg.svd(seen[:, torques] @ still)
                # The most visible combination, scaled to one standard deviation of the
                # noise.
                self.shape[torques] = still @ ways[0] / shown[0]
        sizes = [6 * len(dynamics.arms), dynamics.joints]
        self.delay = np.repeat([0, DRIVE_DELAY], sizes)
        super().__init__(dynamics, design, strength=design.probe)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the torques of this sample."""
        # If the pattern began with two positive samples, the joints would drift in one direction.
        count = t / self.design.sample_time - self.delay
        signs = np.sign(np.sin(2.0 * np.pi * (count / PATTERN_SAMPLES + 0.375)))
        signs = np.where(count > -0.5, signs, 0.0)
        return {"probe": signs * p.strength * self.shape}
