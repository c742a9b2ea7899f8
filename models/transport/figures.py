"""Figures of one mission, with the axes of section 4 of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from trussflow.blocks.framework.units import readable
from trussflow.blocks.support.progress import counted
from trussflow.models.reporting.figures import Curve, Panel, drawing, save

if TYPE_CHECKING:
    import xarray as xr

ANGLE_NAMES = {"phi": "φ", "theta": "θ", "psi": "ψ"}

DRAWINGS = {
    "motion": ("position", "attitude"),
    "errors": ("position_error", "attitude_error"),
    "base_forces": ("base_force",),
    "base_torques": ("base_torque",),
    "flexibility": ("modal_coordinate", "grasp_displacement"),
}
"""Variables of each figure, keyed by file name; one panel per base, the last grasp only."""


def draw(result: xr.Dataset, folder: Path) -> None:
    """Draw the figures of a mission.

    Parameters
    ----------
    result : xarray.Dataset
        Result with the signals of `logged`.
    folder : pathlib.Path
        Output folder.
    """
    for figure, names in counted("drawing figures", DRAWINGS.items()):
        panels: list[Panel] = []
        for name in names:
            values = result[name]
            y = f"{name.replace('_', ' ')} [{readable(values.attrs.get('units', ''))}]"
            robots = result["robot"].values if "robot" in values.dims else [None]
            for robot in robots if name.startswith("base") else robots[-1:]:
                part = values if robot is None else values.sel(robot=robot)
                title = "" if robot is None else f"Robot {robot}"
                panels.append(Panel(curves=components(part), y=y, title=title))
        save(drawing(panels), folder / f"{figure}.png")


def components(values: xr.DataArray) -> list[Curve]:
    """Return one curve for each component of a vector over time."""
    (axis,) = (str(d) for d in values.dims if d != "time")
    labels = [ANGLE_NAMES.get(str(k), str(k)) for k in values[axis].values]
    if axis == "mode":
        labels = [f"mode {k}" for k in labels]
    time = values["time"].values
    return [Curve(k, time, values.values[:, i]) for i, k in enumerate(labels)]
