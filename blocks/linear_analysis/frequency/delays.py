"""Delay margin of a loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.linear_analysis.margins import frequencies_about, stable_poles
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import frequencies, shown

if TYPE_CHECKING:
    import control

GRID_POINTS = 4000
"""Number of frequencies, even in logarithm, at which the loop gain is computed [-]."""


def delay_margin(
    loop: control.StateSpace, *, omega: Sequence[float] | Vector | None = None
) -> tuple[float, float]:
    r"""Return the delay margin of a closed loop, for the same delay in all channels.

    With a delay T in every broken channel the loop is on the stability limit where an
    eigenvalue of the loop gain meets -1,

    .. math:: \lambda_i(L(j \omega))\, e^{-j \omega T} = -1,

    so only where :math:`|\lambda_i| = 1`, at the smallest positive T of all those.

    Parameters
    ----------
    loop : control.StateSpace
        Loop transfer function for negative feedback, as from `loop_transfer`; the loop closed
        without delay must be stable.
    omega : array_like, optional
        Frequencies to search [rad/s]; by default from the loop's poles.

    Returns
    -------
    float, float
        The delay margin [s] and the frequency of the oscillation there [rad/s]; infinite and
        nan if no delay makes the loop unstable, zero and infinite if any does, since a direct
        feedthrough has a gain of one or more at all high frequencies.

    Raises
    ------
    LinearAnalysisError
        If the closed loop is not stable, the model is discrete or not square, or frequencies to search are
        fewer than two or not positive.

    Warns
    -----
    SimulationWarning
        If the diagram has unstable poles that the loop hides: its margins are those of the other poles.
    """
    import control
    from scipy.optimize import brentq

    if not isinstance(loop, control.StateSpace) or not loop.isctime():
        raise LinearAnalysisError(
            f"the loop must be a continuous model, a control.StateSpace, not {shown(loop)}"
        )
    if loop.ninputs != loop.noutputs:
        raise LinearAnalysisError(
            f"a loop has as many outputs as inputs, not {loop.noutputs} and {loop.ninputs}"
        )
    A, B, C, D = (np.asarray(m) for m in (loop.A, loop.B, loop.C, loop.D))
    closed_poles = stable_poles(loop, loop.input_labels[0])
    if np.abs(np.linalg.eigvals(D)).max(initial=0.0) >= 1:
        return 0.0, np.inf
    poles = np.concatenate([np.linalg.eigvals(A), closed_poles])
    sizes = np.abs(poles)
    # Integrators, zero up to round-off, would extend the grid to no purpose.
    sizes = sizes[sizes > 1e-6 * max(sizes.max(initial=0.0), 1e-12)]
    low, high = (sizes.min() / 30, sizes.max() * 30) if sizes.size else (1e-3, 1e3)
    grid = (
        frequencies_about(poles, low, high, GRID_POINTS)
        if omega is None
        else np.sort(frequencies(omega, 2))
    )

    def gains(w: float) -> NDArray[np.complex128]:
        gain = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
        return np.asarray(np.linalg.eigvals(gain))

    def sizes_at(w: float) -> Vector:
        # Eigenvalues come in no fixed order from frequency to frequency; their sorted
        # sizes are continuous. The smallest number replaces log 0.
        return np.asarray(np.sort(np.log(np.abs(gains(w)) + 1e-300)))

    found = [(np.inf, np.nan)]
    values = np.array([sizes_at(w) for w in grid])
    for k, i in np.argwhere(np.diff(np.sign(values), axis=0) != 0):
        crossing = brentq(
            lambda w, i: float(sizes_at(w)[i]),
            grid[k],
            grid[k + 1],
            args=(i,),
            xtol=1e-12 * grid[k],
        )
        for gain in gains(crossing):
            if abs(abs(gain) - 1) < 1e-6:  # two gains may cross here together
                # The delay turns the gain to -1: arg λ - ω T = -π, up to whole turns.
                turn = (np.angle(gain) + np.pi) % (2 * np.pi)
                turn = 0.0 if turn > 2 * np.pi - 1e-9 else turn  # a gain of -1, rounded
                found.append((float(turn / crossing), float(crossing)))
    return min(found, key=lambda pair: pair[0])
