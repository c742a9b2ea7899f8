r"""Input shaping: a trajectory in shares, one after the other, so that a vibration cancels itself."""

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

    with n = 1 for ZV (zero vibration), and n = 2 for ZVD, for which the derivative by the frequency is zero,
    too. It ends n half periods later, where r ends. In several coordinates it may leave the path of r, by
    what r bends within that time.

    Parameters
    ----------
    trajectory : Trajectory
        r, without inputs; it is made for this and in no diagram.
    frequency : float
        f, without damping [Hz].
    damping : float
        ζ, from 0 to below 1 [1].
    kind : str
        ``"ZV"`` or ``"ZVD"``.

    Raises
    ------
    BlockError
        If the trajectory is none that depends on time alone, or a value is out of its range.

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
                "ShapedTrajectory: it shapes trajectories that depend on time alone"
            )
        f = finite("ShapedTrajectory", "frequency", frequency, above=0.0)
        ratio = finite("ShapedTrajectory", "damping", damping, minimum=0.0, below=1.0)
        one_of("kind of ShapedTrajectory", kind, SHAPERS, BlockError)
        self._trajectory = trajectory
        root = np.sqrt(1.0 - ratio**2)
        shares = np.ones(1)
        for _ in range(1 + SHAPERS.index(kind)):
            shares = np.convolve(shares, [1.0, np.exp(-np.pi * ratio / root)])
        self._shares = shares / np.sum(shares)
        self._delays = np.arange(len(shares)) / (2.0 * f * root)
        super().__init__(trajectory.shape, trajectory.unit)

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return position, velocity and acceleration."""
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
        """Return those of the trajectory, once for each share."""
        times = self._trajectory.breakpoints()
        return tuple(
            sorted({float(time + delay) for time in times for delay in self._delays})
        )
