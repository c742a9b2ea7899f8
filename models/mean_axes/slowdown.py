"""Slowdown of the path when its demand exceeds the actuators."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.framework.block import Values
from trussflow.blocks.framework.declarations import Parameter, Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array, Vector
from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.mean_axes.design import MeanAxesDesign
from trussflow.models.mean_axes.estimator import MeanAxesBlock
from trussflow.models.plant.truss_block import FORCE_UNITS

MISSED_PART = 0.02
"""Part of the largest force or torque on the truss that counts as missed [-]."""

MISSED_TIME = 1.0
"""Time with a missed demand after which the share is halved [s]."""

MIN_SHARE = 1.0 / 16.0
"""Smallest share of the acceleration [-]."""


class PathSlowdown(MeanAxesBlock):
    """Share of the path's acceleration: halved each time the demand is missed for 1 s, not below 1/16.

    A demand on the truss that is missed for so long is probably infeasible, for example after a failure.
    With the output `share` of the controller connected to the input `share` of the path (`RetimedQuintic`),
    the path becomes slower and arrives later. The share does not grow again. A demand counts as missed if the
    missing part of a component is above 2 % of the largest force or torque of all actuators together.

    Parameters
    ----------
    dynamics : TrussDynamics
        Nominal dynamics of truss and robots.
    limits : Vector, shape (actuators,)
        Limit of each actuator in either direction, positive [N, N·m].
    design : MeanAxesDesign
        Sample time.
    """

    missed = Input("rigid", unit=FORCE_UNITS, meaning="demand that is not met")
    share = Output(meaning="available share of the path's acceleration")

    left = State(initial=1.0, meaning="the share")
    waited = State(unit="s", meaning="time since the demand was met")

    reach = Parameter(shape=(6,), above=0.0, meaning="largest force and torque at rest")

    def __init__(
        self, dynamics: TrussDynamics, limits: Vector, design: MeanAxesDesign
    ) -> None:
        terms = dynamics.evaluate(dynamics.rest)
        reach = np.abs(terms.actuation_matrix[:6]) @ limits
        super().__init__(dynamics, design, reach=reach)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the share."""
        return {"share": x.left}

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Halve the share after a demand that was missed for long."""
        missing = np.max(np.abs(u.missed[:6]) / p.reach) > MISSED_PART
        waited = np.where(missing, x.waited + self.design.sample_time, 0.0)
        late = waited > MISSED_TIME
        return {
            "left": np.maximum(np.where(late, x.left / 2.0, x.left), MIN_SHARE),
            "waited": np.where(late, 0.0, waited),
        }
