"""Page of a diagram: the picture with zoom, groups that open, search, and charts of a result."""

from __future__ import annotations

from html import escape
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.drawing.svg import svg_of
from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.support.texts import package_text, script_json

if TYPE_CHECKING:
    import xarray as xr

MAX_INSTANTS, MAX_LINES = 600, 8
"""Largest numbers of instants and of elements of a signal in its chart."""


def page_of(diagram: Diagram, result: xr.Dataset | None = None) -> str:
    """Return the HTML text of a page with the picture of a `diagram`.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    result : xarray.Dataset, optional
        Result of a run; a click on a wire shows the chart of its signal.

    Raises
    ------
    DiagramError
        If the result has no signal of the diagram.
    """
    data: dict[str, Any] = {"time": [], "signals": {}}
    if result is not None:
        count = min(MAX_INSTANTS, result.sizes["time"])
        instants = np.linspace(0, result.sizes["time"] - 1, count).round().astype(int)
        shown = result.isel(time=instants)
        data["time"] = _numbers(shown["time"].to_numpy())
        ports = {port.path for block in diagram.within() for port in block.outputs()}
        for path in sorted(ports & {*map(str, result)}):
            values = shown[path]
            rows = values.to_numpy().reshape(count, -1)[:, :MAX_LINES].T
            unit = values.attrs.get("units", "")
            data["signals"][path] = {"unit": unit, "lines": [*map(_numbers, rows)]}
        if not data["signals"]:
            raise DiagramError(
                f"the result has no signal of diagram '{diagram.name}'; give the result of its own run"
            )
    page, script, chart = (
        package_text(name, "trussflow.blocks")
        for name in ("drawing/page.html", "drawing/page.js", "live/chart.js")
    )
    return Template(page).substitute(
        title=escape(diagram.name),
        picture=svg_of(diagram, nested=True),
        data=script_json(data),
        script=chart + script,
    )


def _numbers(values: np.ndarray[Any, Any]) -> list[float | None]:
    """Return numbers with six digits for JSON; those that are not finite are None."""
    return [float(f"{v:.6g}") if np.isfinite(v) else None for v in values]


# Set here, as the framework does not import the drawing package.
Diagram._artists[".html"] = page_of
