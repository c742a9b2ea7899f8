r"""Fixed points of the signals between members, found without derivatives.

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

from trussflow.blocks.framework.types import Vector

MEMORY = 30
"""Iterates that are combined at most."""

FLOOR = 1e-12
"""Size [unit of the signal] below which a residual is round-off of signals that are zero."""


class NotConvergedError(ArithmeticError):
    """The limit of iterations is reached; carries the relative residual of each signal."""

    def __init__(self, residual: Vector) -> None:
        super().__init__("not converged")
        self.residual = residual


def fixed_point(
    function: Callable[[Vector], Vector], guess: Vector, tolerance: float, limit: int
) -> tuple[Vector, int]:
    """Return u with g(u) = u, and the number of evaluations; the last one was at u.

    Parameters
    ----------
    function : callable
        g.
    guess : Vector
        First u [any].
    tolerance : float
        Residual allowed, relative to the largest size that a signal had [-].
    limit : int
        Most evaluations [-].

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
        relative = np.abs(residual) / (scale + FLOOR / tolerance)
        if not np.isfinite(residual).all():
            break
        if (relative <= tolerance).all():
            return u, number
        values = [*values[-MEMORY:], value]
        residuals = [*residuals[-MEMORY:], residual]
        u = _combined(values, residuals, scale + FLOOR / tolerance)
    raise NotConvergedError(relative)


def _combined(values: list[Vector], residuals: list[Vector], scale: Vector) -> Vector:
    """Return the next iterate."""
    if len(values) == 1:
        return values[0]
    changes = np.diff(residuals, axis=0).T / scale[:, None]
    lengths = np.linalg.norm(changes, axis=0)
    used = lengths > 0.0
    if not used.any():
        return values[-1]
    weights = np.linalg.lstsq(changes[:, used] / lengths[used], residuals[-1] / scale, rcond=1e-12)[0]
    step: Vector = np.diff(values, axis=0).T[:, used] @ (weights / lengths[used])
    return values[-1] - step
