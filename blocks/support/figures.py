"""Figures that notebooks show once."""

from __future__ import annotations

from typing import Any, NoReturn

from matplotlib import pyplot as plt
from matplotlib.figure import Figure


class _Figure(Figure):
    """Figure of pyplot that a notebook shows once, also as the last value of a cell."""

    def _ipython_display_(self) -> NoReturn:
        """Close the figure, as pyplot shows all open figures after the cell.

        Raises
        ------
        NotImplementedError
            Always: IPython then shows the figure as usual.
        """
        if "inline" in plt.get_backend():
            plt.close(self)
        raise NotImplementedError


def subplots(rows: int, **settings: Any) -> tuple[Figure, Any]:
    """Return a pyplot figure with `rows` subplots that share the x axis, and the array of their axes.

    Parameters
    ----------
    rows : int
        Number of subplots [-].
    **settings
        Settings of the figure.
    """
    figure, axes = plt.subplots(
        rows,
        sharex=True,
        squeeze=False,
        layout="constrained",
        FigureClass=_Figure,
        **settings,
    )
    return figure, axes[:, 0]
