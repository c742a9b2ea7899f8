"""Figures of one mission, in the axes of the source's Section 4."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

# Okabe and Ito (2008): distinguishable for colour-blind readers
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)), "-")


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
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

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
    figure = Figure(figsize=(8.0, 2.6 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    time = result["time"].values
    for k, (values, axis, title) in enumerate(cells):
        plot = figure.add_subplot(rows, 2, k + 1)
        for i, label in enumerate(values[axis].values):
            plot.plot(
                time, values.isel({axis: i}).values, color=COLOURS[i % 7], linestyle=STYLES[i % 7],
                linewidth=1.1, label=f"{axis} {label}" if axis == "mode" else str(label),
            )  # fmt: skip
        meaning = str(values.name).replace("_", " ")
        plot.set(xlabel="time [s]", ylabel=f"{meaning} [{values.attrs.get('units', '')}]")
        plot.set_title(title, loc="left", fontsize="medium")
        plot.grid(alpha=0.3)
        plot.margins(x=0)
        plot.legend(
            fontsize="small", ncols=3, frameon=False, handlelength=1.8, columnspacing=1.0,
            loc="lower right", bbox_to_anchor=(1.0, 0.98),
        )  # fmt: skip
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=110)
    return path
