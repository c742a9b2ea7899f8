"""Figures of one mission, in the axes of the source's Section 4."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from trussflow.models.reporting.figure_style import finish, legend_above, line, new_figure, save_figure

if TYPE_CHECKING:
    import xarray as xr


def draw(result: xr.Dataset, folder: Path) -> list[Path]:
    """Draw the figures of a mission and return their files.

    Parameters
    ----------
    result : xarray.Dataset
        From `tidy`.
    folder : pathlib.Path
        Where to write them.
    """
    drawings = {
        "motion": [("position", "axis"), ("attitude", "angle")],
        "errors": [("position_error", "axis"), ("attitude_error", "angle")],
        "base_forces": [("base_force", "axis")],
        "base_torques": [("base_torque", "axis")],
        "flexibility": [("modal_coordinate", "mode"), ("grasp_displacement", "axis")],
    }
    return [_figure(result, name, panels, folder) for name, panels in drawings.items()]


def _figure(result: xr.Dataset, name: str, panels: list[tuple[str, str]], folder: Path) -> Path:
    """Draw one figure: a panel for each variable, or for each robot of a variable."""
    cells: list[tuple[Any, str, str]] = []
    for variable, axis in panels:
        values = result[variable]
        if "robot" in values.dims and name.startswith("base"):
            cells += [(values.sel(robot=i), axis, f"Robot {int(i)}") for i in values["robot"]]
        elif "robot" in values.dims:
            cells.append((values.isel(robot=-1), axis, f"Robot {int(values['robot'][-1])}"))
        else:
            cells.append((values, axis, ""))
    rows = -(-len(cells) // 2)
    figure = new_figure(8.0, 2.6 * rows)
    time = result["time"].values
    for k, (values, axis, title) in enumerate(cells):
        plot = figure.add_subplot(rows, 2, k + 1)
        for i, label in enumerate(values[axis].values):
            name_of = f"{axis} {label}" if axis == "mode" else str(label)
            line(plot, time, values.isel({axis: i}).values, i, name_of)
        meaning = str(values.name).replace("_", " ")
        unit = values.attrs.get("units", "")
        finish(plot, title, xlabel="time [s]", ylabel=f"{meaning} [{unit}]")
        legend_above(plot)
    return save_figure(figure, folder, name)
