"""Small torques that nothing else asks for, so that a drive or a base that is dead is missed in the coast."""

from __future__ import annotations

import numpy as np
import scipy

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Attribute, Parameter, Signals
from trussflow.blocks.framework.port import Output
from trussflow.blocks.framework.types import Array
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock, thrusts_of
from trussflow.models.mean_axes.monitor import ActuatorMonitor

PATTERN = 4
"""Samples of a period: up, down, down, up. With two, what the monitor sums up would cancel."""

ROUND_OFF = 1e-9
"""What is a force on the truss, by the greatest that the same torques could make [-]."""


class ActuatorProbe(MeanAxesBlock):
    r"""Move each arm in itself, by torques of drives and base that the truss at rest does not feel.

    .. math::
        Q_p(t) = \pm v \sum_g \frac{d_g}{|T_s S_\theta G^{-1} P d_g|_{R^{-1}}}, \qquad
        S_r\, G^{-1} P d_g = 0

    for the base and for the drives g of each robot, with both signs for two samples at a time. Among the
    torques of g that leave the root r alone at rest, so that no force is on the truss and no mode is excited
    either, d is what changes the joint rates most, torque by torque, as `ActuatorMonitor` sees them by its
    covariance R, without what it doubts of each part. In each sample a probe then stands out by v standard
    deviations. A part without such torques is not probed. Of the two signs of the drives that one is taken
    which turns their arm against what its base does: together they then look like neither alone, and a whole
    robot is told from both.

    At other joint angles, and where a brake holds the arm, the truss feels a little of it.

    Parameters
    ----------
    dynamics : TrussDynamics
        What is believed: robots and truss.
    design : MeanAxesDesign
        Sample time, noise, and v.
    monitor : ActuatorMonitor
        Whose R says what is seen.

    References
    ----------
    Campbell, Nikoukhah (2004), *Auxiliary Signal Design for Failure Detection*, Princeton University Press.
    """

    probe = Output("actuators", unit=Attribute("actuator_units"), meaning="Q_p")

    strength = Parameter(minimum=0.0, meaning="v")

    def __init__(self, dynamics: TrussDynamics, design: MeanAxesDesign, monitor: ActuatorMonitor) -> None:
        rigid = dynamics.rigid_freedoms
        terms = dynamics.evaluate(dynamics.rest, np.zeros(dynamics.freedoms))
        response = np.linalg.solve(terms.mass_matrix[:rigid, :rigid], terms.actuation_matrix[:rigid])
        seen = np.linalg.cholesky(monitor.precision).T @ (design.sample_time * response[6:])
        self.shape = np.zeros(dynamics.actuators)
        for members in monitor.members.T > 0.0:
            torques = np.flatnonzero(members & ~thrusts_of(dynamics))
            still = scipy.linalg.null_space(response[:6, torques], rcond=ROUND_OFF)
            if still.size:
                _, shown, ways = np.linalg.svd(seen[:, torques] @ still)
                self.shape[torques] = still @ ways[0] / shown[0]
        of_bases, of_drives = np.split(seen @ (self.shape.reshape(-1, 1) * monitor.members), 2, axis=1)
        signs = np.where(np.sum(of_bases * of_drives, axis=0) > 0.0, -1.0, 1.0)
        self.shape *= monitor.members @ np.append(np.ones(len(signs)), signs)
        super().__init__(dynamics, design, strength=design.probe)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the torques of this sample."""
        # Begun with both up, the joints would never move back, and leave until the law fetches them.
        phase = 2.0 * np.pi * (t / (PATTERN * self.design.sample_time) + 0.375)
        return {"probe": np.where(np.sin(phase) > 0.0, 1.0, -1.0) * p.strength * self.shape}
