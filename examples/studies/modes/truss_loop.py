"""Closed loop of the truss at rest, linear: loop gains and margins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import control
import numpy as np
from numpy.typing import NDArray
from study_tools.stability import harmonic_gain

from trussflow.blocks import Diagram, OperatingPoint, loop_transfer
from trussflow.blocks.linear_analysis.loop_transfer import LoopMargins, margins_of
from trussflow.blocks.linear_analysis.margins import frequencies_about
from trussflow.models import SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

RIGID, ROBOTS, JOINTS = 34, 4, 7
CHANNELS = ["x", "y", "z", "phi", "theta", "psi"]
CHANNELS += [f"theta_{i + 1}_{j + 1}" for i in range(ROBOTS) for j in range(JOINTS)]
GROUPS = {
    "translation": range(3),
    "rotation": range(3, 6),
    "translation and rotation": range(6),
}
GROUPS |= {
    f"joints of Robot {i + 1}": range(6 + JOINTS * i, 13 + JOINTS * i)
    for i in range(ROBOTS)
}

ERROR, OMEGA = 1e-3, 1.0
"""Amplitude [m, rad] and frequency [rad/s] of the errors for describing functions."""


@dataclass(frozen=True)
class TrussLoop:
    """Loop of Case 1; bandwidth None: no observer; linear: exponents one and no switching."""

    truss: SpaceTruss
    bandwidth: float | None = None
    allocation: str | None = None
    linear: bool = False

    @cached_property
    def mission(self) -> Mission:
        """Gains of the law and the observer."""
        mission = replace(Mission.of_case(1), observer_bandwidth=self.bandwidth or 1.0)
        if not self.linear:
            return mission
        return replace(mission, exponent=1.0, switching_gain=0.0)

    @cached_property
    def diagram(self) -> Diagram:
        """Closed loop."""
        return transport_diagram(
            self.mission,
            SpaceTruss(self.truss.dynamics, modal_actuation=self.truss.modal_actuation),
            observer=self.bandwidth is not None,
            allocation=self.allocation,
        )

    @cached_property
    def demand(self) -> str:
        """Input of the allocation: forces, torques and joint torques."""
        neutral = "feedback_allocation" in self.diagram.blocks
        return (
            f"feedback_allocation.demand[:{RIGID}]" if neutral else "allocation.demand"
        )

    @cached_property
    def point(self) -> OperatingPoint:
        """Initial states, and the gains of the describing functions of the law."""
        if self.linear:
            return OperatingPoint()
        law = self.mission
        power = law.exponent
        gamma = law.rate_gain * harmonic_gain(ERROR * OMEGA, power)
        mu = law.error_gain * harmonic_gain(ERROR, power / (2 - power))
        sliding = ERROR * abs(1j * OMEGA + gamma + mu / (1j * OMEGA))
        reaching = control.describing_function(
            lambda s: s / (abs(s) + law.boundary_layer), sliding
        )
        gains = {
            "controller.gamma": gamma,
            "controller.mu": mu,
            "controller.beta": 1.0,
            "controller.eta": 0.0,
            "controller.sigma": law.reaching_gain
            + law.switching_gain * reaching.real.item(),
        }
        return OperatingPoint(parameters=gains)

    @cached_property
    def demand_loop(self) -> control.StateSpace:
        """Loop gain at the demand."""
        return loop_transfer(self.diagram, self.demand, at=self.point)

    @cached_property
    def modal_loop(self) -> control.StateSpace:
        """Loop gain at the modal force."""
        return loop_transfer(self.diagram, "truss.modal_force", at=self.point)

    @cached_property
    def closed(self) -> NDArray[np.float64]:
        """State matrix of the closed loop; the loop gain has no direct feedthrough."""
        loop = self.demand_loop
        return np.asarray(loop.A - loop.B @ loop.C)

    @cached_property
    def omega(self) -> NDArray[np.float64]:
        """Frequencies around all poles, open and closed [rad/s]."""
        poles = np.append(np.linalg.eigvals(self.closed), self.demand_loop.poles())
        return frequencies_about(poles, high=1e4, points=600)

    def margins(self, channels: range) -> LoopMargins:
        """Return the margins of some channels of the demand, the loops through the others closed."""
        loop = self.demand_loop
        others = np.setdiff1d(range(RIGID), channels)
        A = loop.A - loop.B[:, others] @ loop.C[others]
        names = [CHANNELS[k] for k in channels]
        opened = control.ss(A, loop.B[:, channels], loop.C[channels], 0, inputs=names)
        return margins_of(opened, self.omega)
