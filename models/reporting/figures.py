"""Figures of curves in panels, in one style for colour-blind readers."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.support.files import replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from trussflow.blocks.support.types import Vector

# Okabe and Ito (2008): distinguishable for colour-blind readers
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), "-")

WIDTH, ROW_HEIGHT = 8.0, 2.5  # inch
DOTS_PER_INCH = 110
PALETTE_COLOURS = 128
"""Number of colours of a small file, a third of the size: enough for all `COLOURS`, not for colour maps."""

LEAST_PART = 1e-4
"""Smallest part of a curve's peak that a logarithmic axis shows."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One curve.

    Attributes
    ----------
    label : str
        Text in the legend; may be empty.
    x, y : Vector
        Points of the curve [units of the axes].
    """

    label: str
    x: Vector
    y: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One set of axes.

    Attributes
    ----------
    curves : sequence of Curve
        Curves in the order of colours and line styles.
    y : str
        Quantity and unit of the vertical axis.
    x : str
        Quantity and unit of the horizontal axis.
    title : str
        Title above the axes; may be empty.
    log, log_x : bool
        Whether the vertical or the horizontal axis is logarithmic.
    span : tuple of float
        Displayed part of the horizontal axis, by default all of it [as in `x`].
    levels : sequence of float
        Horizontal lines, such as bounds [as in `y`].
    marks : sequence of float
        Vertical lines, such as natural frequencies [as in `x`].
    legend_inside : bool
        Whether the legend is inside the axes; otherwise it is next to the title.
    """

    curves: Sequence[Curve]
    y: str
    x: str = "time [s]"
    title: str = ""
    log: bool = False
    log_x: bool = False
    span: tuple[float, float] = (-np.inf, np.inf)
    levels: Sequence[float] | Vector = ()
    marks: Sequence[float] | Vector = ()
    legend_inside: bool = False


def drawing(panels: Sequence[Panel], *, row_height: float = ROW_HEIGHT) -> Figure:
    """Return a figure of panels, two in a row.

    Parameters
    ----------
    panels : sequence of Panel
        Panels of the figure.
    row_height : float
        Height of a row [inch].
    """
    columns = min(2, len(panels))
    figure, cells = blank(-(-len(panels) // columns), columns, row_height=row_height)
    for panel, cell in zip(panels, cells, strict=False):
        _draw(panel, cell)
    for cell in cells[len(panels) :]:
        cell.remove()
    return figure


def blank(
    rows: int, columns: int, *, width: float = WIDTH, row_height: float = ROW_HEIGHT
) -> tuple[Figure, list[Axes]]:
    """Return a figure without a window, and its empty axes, row by row.

    Parameters
    ----------
    rows, columns : int
        Numbers of rows and columns [-].
    width, row_height : float
        Width of the figure and height of a row [inch].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, row_height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _draw(panel: Panel, plot: Axes) -> None:
    for i, curve in enumerate(panel.curves):
        shown = (curve.x >= panel.span[0]) & (curve.x <= panel.span[1])
        y = curve.y[shown]
        if panel.log:  # a start at rest would stretch the axis over ten decades
            y = np.where(y > LEAST_PART * np.max(y, initial=0.0), y, np.nan)
        k = i % len(COLOURS)
        look: dict[str, Any] = {"color": COLOURS[k], "linestyle": STYLES[k]}
        plot.plot(curve.x[shown], y, label=curve.label, linewidth=1.1, **look)
    for level in panel.levels:
        plot.axhline(
            level, color="0.35", linewidth=0.8, linestyle=(0, (4, 3)), zorder=0
        )
    for mark in panel.marks:
        plot.axvline(mark, color="0.75", linewidth=0.7, zorder=0)
    plot.set(xlabel=panel.x, ylabel=panel.y, yscale="log" if panel.log else "linear")
    if not panel.log:
        plot.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    if panel.log_x:
        plot.set_xscale("log")
    plot.set_title(panel.title, loc="left", fontsize="medium")
    plot.grid(alpha=0.3)
    plot.margins(x=0)
    if any(curve.label for curve in panel.curves):
        place: dict[str, Any] = {"ncols": 2}
        if not panel.legend_inside:
            place = {
                "loc": "lower right",
                "bbox_to_anchor": (1.0, 0.98),
                "borderaxespad": 0.1,
                "ncols": min(4, len(panel.curves)),
                "handlelength": 1.8,
                "columnspacing": 1.0,
            }
        plot.legend(fontsize="small", frameon=False, **place)


def save(figure: Figure, file: Path, *, small: bool = False) -> None:
    """Write a figure as a PNG; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        Figure to write.
    file : pathlib.Path
        PNG file.
    small : bool
        Whether to reduce the image to `PALETTE_COLOURS` colours.
    """
    raw = io.BytesIO()
    figure.savefig(raw, dpi=DOTS_PER_INCH, format="png", metadata={"Software": None})
    if small:
        from PIL import Image

        with Image.open(raw) as image:
            raw = io.BytesIO()
            # A median cut would mix the colours of curves.
            few = image.convert("RGB").quantize(
                PALETTE_COLOURS, Image.Quantize.FASTOCTREE
            )
            few.putpalette(
                [255 if part == 254 else part for part in few.getpalette() or []]
            )  # white is white
            few.save(raw, format="png", optimize=True)
    with replaced(file) as partial:
        partial.write_bytes(raw.getvalue())
