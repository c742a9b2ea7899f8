"""Web page of a mission: replay, figures of merit, parameters, provenance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from trussflow.models.parameter_files import ParameterTable
from trussflow.models.plant.space_truss import ARMS, STRUCTURES
from trussflow.models.reporting.quantities import shortened
from trussflow.models.reporting.tables import html_table
from trussflow.models.transport.figures import DRAWINGS
from trussflow.models.transport.mission_file import MissionFile
from trussflow.models.transport.summary import TITLES, FigureOfMerit, cells
from trussflow.models.viewer.page import replay

if TYPE_CHECKING:
    import xarray as xr


def write_index(
    result: xr.Dataset,
    mission_file: MissionFile,
    figures: list[FigureOfMerit],
    folder: Path,
    *,
    drawing: str = "",
) -> Path:
    """Write ``index.html`` with replay, summary, figures, parameters and provenance.

    Parameters
    ----------
    result : xarray.Dataset
        Result with the signals of `logged`, with two or more instants.
    mission_file : MissionFile
        Simulated mission.
    figures : list of FigureOfMerit
        Figures of merit by `summarize`.
    folder : pathlib.Path
        Output folder.
    drawing : str
        Diagram as SVG; by default the section is omitted.

    Returns
    -------
    pathlib.Path
        Path of the page.

    Raises
    ------
    ModelError
        If the result is not that of this mission, or the file cannot be written.
    """
    # too long; parameters have their own section
    long = ("parameters", "initial_states", "target")
    about = {key: value for key, value in result.attrs.items() if key not in long}
    ended = "" if about.get("status") == "complete" else f", {about.get('status')}"
    live = (
        '<p><a href="live.html">Simulate with other parameters in this browser</a></p>'
    )
    sections = {"Live": live} if (folder / "live.html").is_file() else {}
    sections["Summary"] = html_table(TITLES, cells(figures))
    if drawing:
        sections["Diagram"] = drawing
    sections["Parameters"] = html_table(
        ("where", "value", "source"), _parameters(mission_file, result)
    )
    sections["Provenance"] = html_table(
        ("what", "value"), [(str(k), str(v)) for k, v in about.items()]
    )
    charts = (name for group in DRAWINGS.values() for name in group)
    return replay(
        result,
        mission_file.truss,
        folder / "index.html",
        rods=mission_file.rods,
        title=f"{mission_file.title}: {about.get('plant')} plant, {about.get('controller')}{ended}",
        charts=[name for name in charts if name in result and result[name].size],
        sections=sections,
    )


def _parameters(mission_file: MissionFile, result: xr.Dataset) -> list[tuple[str, ...]]:
    """Return the values of the mission file and of the parameter files of truss and arms."""
    rows: list[tuple[str, ...]] = [
        (f"{told.place}, {told.key}", told.value, told.source)
        for told in mission_file.told
    ]
    files = ["space_truss.toml"] * (result.attrs["plant"] in STRUCTURES)
    files += [f"robot_arm_{arm}.toml" for arm in ARMS if arm in result.attrs["arm"]]
    listed = [row for file in files for row in ParameterTable.shipped(file).listed()]
    rows += [
        (where, f"{value} {unit}", source) for where, value, unit, source in listed
    ]
    return [
        (where, shortened(value.removesuffix(" 1")), source)
        for where, value, source in rows
    ]
