r"""A map of control spillover: how fast the worst pole grows, over modes, damping and observer.

The controller believes in as many modes as it is given, six like the source; the plant has as
many as the map says. Modes, their frequencies and shapes are those of the finite-element truss.
Without observer the bandwidth is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from trussflow.models.dynamics.dynamics import TrussDynamics
from trussflow.models.errors import ModelError
from trussflow.models.modal_analysis.linear_loop import HeldTruss, OpenLoop
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.robots.robot_arm import RobotArm
from trussflow.models.truss.truss_fe import TrussFrame
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.validation import check_choice

BELIEVED_MODES = 6

SLOWEST = 0.1
"""Slower oscillations are the law's own [rad/s]."""

LOOPS = {
    "published": ("published", False),
    "Eq. 64": ("published", True),
    "consistent": ("mode-neutral", True),
}
"""Loops by name: allocation, and whether the actuators work on the modes. The first is the
published plant's; the last one the consistent plant's; between them, what the source's own
equations give if nothing is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """What a map goes over.

    Attributes
    ----------
    modes : tuple of int
        Numbers of modes of the plant [-].
    damping : tuple of float
        Fractions of critical damping [-].
    bandwidth : tuple of float
        L of the observer [1/s]; zero: no observer.
    """

    modes: tuple[int, ...] = (6, 10, 14, 20, 30)
    damping: tuple[float, ...] = (0.0, 0.0025, 0.005, 0.01, 0.02, 0.05)
    bandwidth: tuple[float, ...] = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)


QUICK = Grid(modes=(14,), damping=(0.0, 0.005, 0.02), bandwidth=(0.0, 2.0, 4.0))


def dynamics_with_modes(modes: int, *, damping: float = 0.0, arm: RobotArm | None = None) -> TrussDynamics:
    """Return truss and robots with more modes than the source has, from finite elements.

    Parameters
    ----------
    modes : int
        How many [-].
    damping : float
        Fraction of critical damping of all modes [-].
    arm : RobotArm, optional
        Of all robots; by default that of Table 2 as printed.
    """
    grasps = TrussModes.reconstructed().grasp_positions
    shapes = TrussFrame.reconstructed().modes(modes, grasps).damped(damping)
    arms = (RobotArm.literal() if arm is None else arm,) * len(grasps)
    return TrussDynamics(modes=shapes, arms=arms, elastic_integrals=True)


def spillover_map(grid: Grid | None = None, *, loops: Sequence[str] = tuple(LOOPS)) -> xr.Dataset:
    """Return the rightmost oscillating pole over number of modes, damping and bandwidth.

    The law is linear: exponents one, no switching.

    Parameters
    ----------
    grid : Grid, optional
        What to go over.
    loops : sequence of str
        Which of `LOOPS`.

    Returns
    -------
    xarray.Dataset
        ``growth_rate`` [1/s] and ``frequency`` [rad/s] over ``loop``, ``modes``, ``damping`` and
        ``bandwidth``.

    Raises
    ------
    ModelError
        If there is no such loop, or the plant has fewer modes than the controller believes in.
    """
    grid = Grid() if grid is None else grid
    if min(grid.modes) < BELIEVED_MODES:
        raise ModelError(
            f"cannot map {min(grid.modes)} modes: the controller believes in {BELIEVED_MODES}, and "
            "the plant must have as many"
        )
    for name in loops:
        check_choice("loop", name, LOOPS)
    shape = (len(loops), len(grid.modes), len(grid.damping), len(grid.bandwidth))
    worst = np.zeros(shape, dtype=complex)
    for j, number in enumerate(grid.modes):
        dynamics = dynamics_with_modes(number)
        believed = replace(dynamics, modes=dynamics.modes.truncated(BELIEVED_MODES))
        held = {
            allocation: HeldTruss(SpaceTruss(dynamics), allocation=allocation, believed=believed)
            for allocation in {LOOPS[name][0] for name in loops}
        }
        for i, k, n in np.ndindex(len(loops), len(grid.damping), len(grid.bandwidth)):
            allocation, modal_actuation = LOOPS[loops[i]]
            bandwidth = grid.bandwidth[n] or None
            loop = held[allocation].loop(
                damping=grid.damping[k], bandwidth=bandwidth, modal_actuation=modal_actuation
            )
            worst[i, j, k, n] = _rightmost(loop)
    dims = ("loop", "modes", "damping", "bandwidth")
    return xr.Dataset(
        {
            "growth_rate": (dims, worst.real, {"units": "1/s"}),
            "frequency": (dims, worst.imag, {"units": "rad/s"}),
        },
        coords={
            "loop": list(loops),
            "modes": list(grid.modes),
            "damping": ("damping", list(grid.damping), {"units": "1"}),
            "bandwidth": ("bandwidth", list(grid.bandwidth), {"units": "1/s"}),
        },
    )


def _rightmost(loop: OpenLoop) -> complex:
    values = np.linalg.eigvals(loop.closed_matrix)
    values = values[values.imag > SLOWEST]
    return complex(values[np.argmax(values.real)])
