"""Page of a diagram: the picture with zoom, groups that open in their boxes, search, and charts of a result."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from trussflow.blocks.drawing.svg import svg_of
from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.units import distinct
from trussflow.blocks.support.packing import packed, spread
from trussflow.blocks.support.texts import page_text, script_json
from trussflow.blocks.support.validation import shown

if TYPE_CHECKING:
    import xarray as xr

MAX_INSTANTS, MAX_LINES = 600, 8
"""Largest numbers of instants and of elements of a signal in its chart."""

CHART_BITS = 20
"""Mantissa bits of a number in a chart, six decimal digits [-]."""


def page_of(diagram: Diagram, picture: str, result: xr.Dataset | None = None) -> str:
    """Return the HTML text of a page with the picture of a diagram, and those of its nested diagrams.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    picture : str
        Its picture, as SVG.
    result : xarray.Dataset, optional
        Result of a run; a click on a wire shows the chart of its signal.

    Raises
    ------
    DiagramError
        If the result is none, or has no signal of the diagram.
    """
    data: dict[str, Any] = {"time": [], "signals": {}}
    if result is not None:
        if not hasattr(result, "data_vars"):
            raise DiagramError(
                f"cannot draw diagram '{diagram.name}' with {shown(result)}: it is no result of a run"
            )
        ports = {port.path for block in diagram.within() for port in block.outputs()}
        if not (paths := sorted(ports & {*map(str, result)})):
            raise DiagramError(
                f"the result has no signal of diagram '{diagram.name}'; give the result of its own run"
            )
        instants = spread(result.sizes["time"], MAX_INSTANTS)
        thinned = result[paths].isel(time=instants)
        data["time"] = packed(thinned["time"])
        for path, values in thinned.items():
            rows = values.to_numpy().reshape(len(instants), -1)[:, :MAX_LINES].T
            unit = distinct(values.attrs.get("units", ""))
            data["signals"][path] = {"unit": unit, "lines": packed(rows, CHART_BITS)}
    return page_text(
        "trussflow.blocks.drawing",
        diagram.name,
        picture=picture,
        groups="".join(
            f'<div data-path="{escape(each.path)}">{svg_of(each)}</div>'
            for each in diagram.within()
            if isinstance(each, Diagram)
        ),
        data=script_json(data),
    )


# Set here, as the framework does not import the drawing package.
Diagram._artists[".html"] = page_of
