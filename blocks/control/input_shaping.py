r"""Input shaping: a sum of delayed shares of a trajectory, which excites no vibration of one mode."""

from __future__ import annotations

import numpy as np

from trussflow.blocks.control.trajectory import Trajectory
from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.library.signals import finite
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import one_of

SHAPERS = ("ZV", "ZVD")


class ShapedTrajectory(Trajectory):
    r"""A trajectory that leaves a mode of a structure at rest, if it begins at rest.

    .. math:: y(t) = \sum_{k=0}^{n} \binom{n}{k} \frac{K^k}{(1 + K)^n}\, r(t - k \pi / \omega_d), \qquad
              K = e^{-\zeta\pi/\sqrt{1 - \zeta^2}}, \quad
              \omega_d = 2\pi f \sqrt{1 - \zeta^2}

    with n = 1 for ZV (zero vibration), and n = 2 for ZVD, whose residual vibration also has a zero derivative
    with respect to the frequency. It ends n half periods later than r, at the same position. In several
    coordinates it cuts the corners of a curved path.

    Parameters
    ----------
    trajectory : Trajectory
        r, a block without inputs that is in no diagram.
    frequency : float
        f, without damping [Hz].
    damping : float
        ζ, from 0 to below 1 [1].
    kind : str
        ``"ZV"`` or ``"ZVD"``.

    Raises
    ------
    BlockError
        If the trajectory does not depend on time alone, or a value is out of its range.

    References
    ----------
    Singer, Seering (1990), *Preshaping command inputs to reduce system vibration*, ASME Journal of Dynamic
    Systems, Measurement and Control 112(1).
    """

    def __init__(
        self,
        trajectory: Block,
        frequency: float,
        *,
        damping: float = 0.0,
        kind: str = "ZVD",
    ) -> None:
        if (
            not isinstance(trajectory, Trajectory)
            or trajectory.inputs()
            or trajectory.sample_time is not None
        ):
            raise BlockError(
                "ShapedTrajectory needs a trajectory that depends on time alone: a `Trajectory` "
                "block without inputs and sample time"
            )
        f = finite("ShapedTrajectory", "frequency", frequency, above=0.0)
        ratio = finite("ShapedTrajectory", "damping", damping, minimum=0.0, below=1.0)
        one_of("kind of ShapedTrajectory", kind, SHAPERS, BlockError)
        self._trajectory = trajectory
        root = np.sqrt(1.0 - ratio**2)
        # Two impulses, half a damped period apart, in the ratio of their decay, cancel
        # each other (ZV). The pair convolved with itself gives ZVD.
        shares = np.ones(1)
        for _ in range(1 + SHAPERS.index(kind)):
            shares = np.convolve(shares, [1.0, np.exp(-np.pi * ratio / root)])
        self._shares = shares / np.sum(shares)
        self._delays = np.arange(len(shares)) / (2.0 * f * root)
        super().__init__(trajectory.shape, trajectory.unit)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
        # The trajectory has neither states nor inputs, so these are placeholders.
        inner = Signals("trajectory", self._trajectory.parameters)
        each = [
            self._trajectory.output(t - delay, inner, inner, inner)
            for delay in self._delays
        ]
        return {
            name: sum(
                share * one[name] for share, one in zip(self._shares, each, strict=True)
            )
            for name in ("position", "velocity", "acceleration")
        }

    def breakpoints(self) -> tuple[float, ...]:
        """Return the breakpoints of the trajectory, delayed by each delay."""
        times = self._trajectory.breakpoints()
        return tuple(
            sorted({float(time + delay) for time in times for delay in self._delays})
        )
