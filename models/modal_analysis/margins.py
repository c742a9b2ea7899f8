"""Stability margins of the loop at the plant's inputs: at each demand, and at each mode."""

from __future__ import annotations

from collections.abc import Sequence

import control
import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.blocks.linear_analysis.margins import (
    Margins,
    channel_margins,
    channel_responses,
    frequencies_about,
    real_sensitivities,
    sensitivities,
    stable_poles,
)
from trussflow.models.modal_analysis.linear_loop import OpenLoop


def is_stable(matrix: Vector) -> bool:
    """Tell whether all eigenvalues are to the left of the axis, but for round-off.

    Parameters
    ----------
    matrix : array, shape (n, n)
        State matrix of the closed loop [1/s].
    """
    values = np.linalg.eigvals(matrix)
    return bool(values.real.max(initial=-1.0) < 1e-12 * np.abs(values).max(initial=1.0))


def frequencies(loop: OpenLoop, low: float = 1e-2, high: float = 1e4, points: int = 600) -> Vector:
    """Return frequencies that show a loop; see `frequencies_about`.

    Parameters
    ----------
    loop : OpenLoop
        The loop.
    low, high : float
        Ends [rad/s].
    points : int
        Evenly in logarithm [-].
    """
    matrices = loop.closed_matrix, loop.plant.A, loop.demand_loop.A
    return frequencies_about(np.concatenate([np.linalg.eigvals(M) for M in matrices]), low, high, points)


def demand_margins(loop: OpenLoop, omega: Vector | None = None) -> list[Margins]:
    """Return the margins at the demand of each translation, rotation and joint channel.

    Parameters
    ----------
    loop : OpenLoop
        The loop.
    omega : array, optional
        Frequencies [rad/s].

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable; the message lists its unstable poles.
    """
    return _all_margins(loop, loop.demand_loop, loop.channel_names()[: loop.rigid], omega)


def modal_margins(loop: OpenLoop, omega: Vector | None = None) -> list[Margins]:
    """Return the margins at the modal force of each mode.

    Parameters
    ----------
    loop : OpenLoop
        The loop.
    omega : array, optional
        Frequencies [rad/s].

    Raises
    ------
    LinearAnalysisError
        If the closed loop is unstable; the message lists its unstable poles.
    """
    return _all_margins(loop, loop.modal_loop, loop.channel_names()[loop.rigid :], omega)


def _all_margins(
    loop: OpenLoop, opened: control.StateSpace, names: Sequence[str], omega: Vector | None
) -> list[Margins]:
    stable_poles(opened, names[0])
    omega = frequencies(loop) if omega is None else omega
    gains = channel_responses(sensitivities(opened, omega))
    ends = real_sensitivities(opened, float(omega[0]))
    each = zip(gains.T, names, ends.T, strict=True)
    return [channel_margins(gain, omega, name, real) for gain, name, real in each]
