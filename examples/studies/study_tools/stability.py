"""Stability over two parameters: rightmost poles, limits of the damping ratio, and maps of growth rates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trussflow.blocks.support.types import Vector
from trussflow.models.reporting.figures import draw_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    draw_cells(
        plot,
        growth,
        "{:+.2f}".format,
        lambda _: False,
        columns,
        rows,
        vmin=-limit,
        vmax=limit,
    )
    plot.set(**texts)
