"""Figures that notebooks show once."""

from __future__ import annotations

from typing import NoReturn

from matplotlib import pyplot as plt
from matplotlib.figure import Figure


class NotebookFigure(Figure):
    """Figure of pyplot that a notebook shows once, also as the last value of a cell.

    It is the ``FigureClass`` of the functions of pyplot.
    """

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
