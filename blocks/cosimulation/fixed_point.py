r"""Fixed-point iteration of the signals between members, by Anderson acceleration.

Plain iteration :math:`u \leftarrow g(u)` converges only where the loop gain is below one, and
slowly near it. Anderson acceleration combines the last iterates so that the residual
:math:`f = g(u) - u` of their linear interpolation is smallest; for affine g it ends after as many
iterations as f has independent directions, whatever the gain.

References
----------
D. G. Anderson (1965), *Iterative procedures for nonlinear integral equations*, J. ACM 12(4);
H. F. Walker, P. Ni (2011), *Anderson acceleration for fixed-point iterations*, SIAM J. Numer.
Anal. 49(4), eq. (2.2).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trussflow.blocks.support.types import Vector

MAX_COMBINED_ITERATES = 30
"""Largest number of earlier iterates that are combined."""

ZERO_SIGNAL_TOLERANCE = 1e-12
"""Absolute tolerance of the residual of signals that are zero [unit of the signal]."""


class NotConvergedError(ArithmeticError):
    """The limit of iterations is reached; `residual` is the relative residual of each signal."""

    def __init__(self, residual: Vector) -> None:
        super().__init__("not converged")
        self.residual = residual


def fixed_point(
    function: Callable[[Vector], Vector], guess: Vector, tolerance: float, limit: int
) -> tuple[Vector, int]:
    """Return u with g(u) = u, and the number of evaluations; the last evaluation is at u.

    Parameters
    ----------
    function : callable
        The function g.
    guess : Vector
        Initial guess of u [any].
    tolerance : float
        Largest residual, relative to the largest magnitude of a signal so far [-].
    limit : int
        Largest number of evaluations [-].

    Raises
    ------
    NotConvergedError
        If the limit is reached, or the residual is not finite.
    """
    u = guess
    values: list[Vector] = []
    residuals: list[Vector] = []
    scale = np.abs(guess)
    relative = np.zeros_like(guess)
    for number in range(1, limit + 1):
        value = function(u)
        residual = value - u
        scale = np.maximum(scale, np.abs(value))
        # So relative <= tolerance means residual <= tolerance * scale +
        # ZERO_SIGNAL_TOLERANCE.
        relative = np.abs(residual) / (scale + ZERO_SIGNAL_TOLERANCE / tolerance)
        if not np.isfinite(residual).all():
            break
        if (relative <= tolerance).all():
            return u, number
        # One more value than differences.
        values = [*values[-MAX_COMBINED_ITERATES:], value]
        residuals = [*residuals[-MAX_COMBINED_ITERATES:], residual]
        u = _combined(values, residuals, scale + ZERO_SIGNAL_TOLERANCE / tolerance)
    raise NotConvergedError(relative)


def _combined(values: list[Vector], residuals: list[Vector], scale: Vector) -> Vector:
    """Return the next iterate of Anderson acceleration."""
    if len(values) == 1:
        return values[0]
    # Eq. (2.2): the weights minimize the residual, with each signal
    # divided by its scale.
    changes = np.diff(residuals, axis=0).T / scale[:, None]
    # Columns of unit length, so that rcond compares directions. Differences become ever
    # smaller as the iteration converges.
    lengths = np.linalg.norm(changes, axis=0)
    used = lengths > 0.0
    # The residual does not change: plain iteration.
    if not used.any():
        return values[-1]
    weights = np.linalg.lstsq(
        changes[:, used] / lengths[used], residuals[-1] / scale, rcond=1e-12
    )[0]
    step: Vector = np.diff(values, axis=0).T[:, used] @ (weights / lengths[used])
    return values[-1] - step
