"""How figures look: colours that colour-blind readers tell apart, one size of everything."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito (2008): distinguishable for colour-blind readers
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), "-")

DIVERGING = "PuOr_r"
"""Colour map of quantities whose sign matters; safe for colour-blind readers."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that no window shows.

    Parameters
    ----------
    width, height : float
        Size [inch].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def line(plot: Axes, x: Any, y: Any, number: int, label: str | None = None) -> None:
    """Draw a line in the colour and style of its number.

    Parameters
    ----------
    plot : Axes
        Where.
    x, y : array
        Points [any].
    number : int
        From zero; colour and style repeat after seven [-].
    label : str, optional
        For the legend.
    """
    plot.plot(x, y, color=COLOURS[number % 7], linestyle=STYLES[number % 7], linewidth=1.1, label=label)


def finish(plot: Axes, title: str = "", **labels: Any) -> None:
    """Set labels and title, and a light grid.

    Parameters
    ----------
    plot : Axes
        Which.
    title : str
        At the upper left.
    **labels
        As for ``Axes.set``.
    """
    plot.set(**labels)
    plot.set_title(title, loc="left", fontsize="medium")
    plot.grid(alpha=0.3)
    plot.margins(x=0)


def legend_above(plot: Axes, columns: int = 3) -> None:
    """Put the legend beside the title, outside the curves.

    Parameters
    ----------
    plot : Axes
        Which.
    columns : int
        Entries side by side [-].
    """
    plot.legend(
        fontsize="small",
        ncols=columns,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.0,
        loc="lower right",
        bbox_to_anchor=(1.0, 0.98),
    )


def save_figure(figure: Figure, folder: Path, name: str) -> Path:
    """Write a figure and return its file.

    Parameters
    ----------
    figure : Figure
        Which.
    folder : pathlib.Path
        Where to.
    name : str
        Of the file, without its ending.
    """
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=110)
    return path
