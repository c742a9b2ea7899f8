"""Stability of loops: rightmost poles, describing functions, least damping, maps of growth rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.support.types import Vector

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DIVERGING = "PuOr_r"
"""Colour map of quantities whose sign matters; safe for colour-blind readers."""


def rightmost(
    A: Vector, low: float = 0.1, high: float = np.inf
) -> tuple[complex, Vector]:
    """Return the rightmost oscillating pole of dx/dt = A x [1/s], and its eigenvector.

    Parameters
    ----------
    A : array, shape (n, n)
        State matrix [1/s].
    low, high : float
        Band of the imaginary part of the pole [rad/s].
    """
    poles, vectors = np.linalg.eig(A)
    within = (poles.imag > low) & (poles.imag < high)
    first = int(np.where(within, poles.real, -np.inf).argmax())
    return complex(poles[first]), vectors[:, first]


def stable_damping(growth: Vector, dampings: Sequence[float]) -> float:
    """Return the damping ratio from which on no growth rate is positive, infinite if the last one is [-].

    Parameters
    ----------
    growth : array, shape (dampings,)
        Growth rate [1/s] at each damping ratio.
    dampings : sequence of float
        Increasing damping ratios [-].
    """
    first = int(np.flatnonzero(growth > 0).max(initial=-1)) + 1
    return dampings[first] if first < len(dampings) else np.inf


def harmonic_gain(amplitude: Vector | float, exponent: float) -> Vector:
    r"""Return the describing function of :math:`|x|^b\,\mathrm{sgn}(x)` [unit^(b-1)].

    .. math:: N(a) = \frac{2}{\sqrt\pi}\frac{\Gamma(b/2 + 1)}{\Gamma(b/2 + 3/2)}\,a^{b-1}

    Parameters
    ----------
    amplitude : float or array
        a > 0 [unit of x].
    exponent : float
        b > 0 [-].
    """
    shape = math.gamma(exponent / 2 + 1) / math.gamma(exponent / 2 + 1.5)
    return np.asarray(2 / math.sqrt(math.pi) * shape * amplitude ** (exponent - 1))


def draw_growth(
    plot: Axes,
    growth: Vector,
    columns: Sequence[str],
    rows: Sequence[str],
    **texts: str,
) -> None:
    """Draw growth rates as coloured cells: purple is stable, orange is not.

    Parameters
    ----------
    plot : matplotlib.axes.Axes
        Axes of the map.
    growth : array, shape (rows, columns)
        Growth rates [1/s].
    columns, rows : sequence of str
        Labels of the axes.
    **texts
        Title and axis labels, as for ``Axes.set``.
    """
    limit = 1.5 * np.abs(growth).max()  # so that black numbers are readable
    look: dict[str, Any] = {"aspect": "auto", "origin": "lower"}
    plot.imshow(growth, cmap=DIVERGING, vmin=-limit, vmax=limit, **look)
    for (row, column), rate in np.ndenumerate(growth):
        plot.text(
            column,
            row,
            f"{rate:+.2f}",
            ha="center",
            va="center",
            fontsize="x-small",
            weight="bold" if rate > 0 else "normal",
        )
    plot.set_xticks(range(len(columns)), columns)
    plot.set_yticks(range(len(rows)), rows)
    plot.set(**texts)
