"""One look for all figures: for print, for colour-blind readers, small on disk."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trussflow.blocks.framework.types import Vector
from trussflow.models.reporting.figure_style import COLOURS, STYLES

WIDTH, ROW_HEIGHT = 8.0, 2.5  # inch
DOTS_PER_INCH = 110
PALETTE = 64
"""Colours kept in a file: line drawings need few, and it is a third of the size."""


LEAST_PART = 1e-4
"""Smallest part of a curve's peak that a logarithmic axis shows."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One curve.

    Attributes
    ----------
    label : str
        For the legend.
    x, y : Vector
        What to draw [as the axes say].
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
        In the order of colours and line styles.
    y : str
        Quantity with unit.
    x : str
        The same of the horizontal axis.
    title : str
        Above the axes; may be empty.
    log, log_x : bool
        Whether the vertical, the horizontal axis is logarithmic.
    span : tuple of float, optional
        Part of the horizontal axis to show.
    levels : tuple of float
        Horizontal lines, such as bounds.
    """

    curves: Sequence[Curve]
    y: str
    x: str = "time [s]"
    title: str = ""
    log: bool = False
    log_x: bool = False
    span: tuple[float, float] | None = None
    levels: tuple[float, ...] = ()


def drawing(panels: Sequence[Panel], columns: int = 2) -> Any:
    """Return a figure of panels, row by row.

    Parameters
    ----------
    panels : sequence of Panel
        What to draw.
    columns : int
        Panels side by side [-].
    """
    rows = -(-len(panels) // columns)
    figure, cells = blank(rows, columns)
    for panel, cell in zip(panels, cells, strict=False):
        _draw(panel, cell)
    for cell in cells[len(panels) :]:
        cell.remove()
    return figure


def blank(rows: int, columns: int) -> tuple[Any, list[Any]]:
    """Return a figure and its empty axes, row by row.

    Parameters
    ----------
    rows, columns : int
        How many [-].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, ROW_HEIGHT * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(rows, columns, squeeze=False).ravel())


def _draw(panel: Panel, plot: Any) -> None:
    for i, curve in enumerate(panel.curves):
        shown = slice(None)
        if panel.span is not None:
            inside = np.flatnonzero((curve.x >= panel.span[0]) & (curve.x <= panel.span[1]))
            shown = slice(inside[0], inside[-1] + 1) if len(inside) else slice(0, 0)
        y = curve.y[shown]
        if panel.log:  # a start at rest would stretch the axis over ten decades
            y = np.where(y > LEAST_PART * np.max(y, initial=0.0), y, np.nan)
        style = {"color": COLOURS[i % len(COLOURS)], "linestyle": STYLES[i % len(STYLES)]}
        plot.plot(curve.x[shown], y, label=curve.label, linewidth=1.1, **style)
    for level in panel.levels:
        plot.axhline(level, color="0.35", linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
    plot.set(xlabel=panel.x, ylabel=panel.y, yscale="log" if panel.log else "linear")
    if not panel.log:
        plot.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    if panel.log_x:
        plot.set_xscale("log")
    if panel.title:
        plot.set_title(panel.title, loc="left", fontsize="medium")
    plot.grid(alpha=0.3)
    plot.margins(x=0)
    if any(curve.label for curve in panel.curves):
        plot.legend(
            fontsize="small",
            ncols=min(4, len(panel.curves)),
            frameon=False,
            handlelength=1.8,
            columnspacing=1.0,
            loc="lower right",
            bbox_to_anchor=(1.0, 0.98),
            borderaxespad=0.1,
        )


def save(figure: Any, file: Path) -> None:
    """Write a figure as a small PNG; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to write.
    file : pathlib.Path
        Where.
    """
    from PIL import Image

    raw = io.BytesIO()
    figure.savefig(raw, dpi=DOTS_PER_INCH, format="png", metadata={"Software": None})
    with Image.open(raw) as image:
        image.convert("RGB").quantize(PALETTE).save(file, format="png", optimize=True)
