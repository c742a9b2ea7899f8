"""The page of a mission: how it went, what flew, and all that is needed to fly it again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from trussflow.models.parameter_files import ParameterTable
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.reporting.tables import html_table
from trussflow.models.transport.figures import DRAWINGS
from trussflow.models.transport.mission import Mission
from trussflow.models.transport.summary import TITLES, FigureOfMerit, cells
from trussflow.models.viewer.page import Section, replay

if TYPE_CHECKING:
    import xarray as xr


def write_index(
    result: xr.Dataset,
    mission: Mission,
    truss: SpaceTruss,
    figures: list[FigureOfMerit],
    folder: Path,
    *,
    drawing: str = "",
) -> Path:
    """Write ``index.html``: the replay, and below it summary, figures, parameters, provenance.

    Parameters
    ----------
    result : xarray.Dataset
        From `tidy`, with two instants or more.
    mission : Mission
        What was flown.
    truss : SpaceTruss
        The plant.
    figures : list of FigureOfMerit
        From `summarize`.
    folder : pathlib.Path
        Where to write it.
    drawing : str
        The diagram as SVG; by default there is no such section.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ModelError
        If the result is not that of a transport by `truss`, or the file cannot be written.
    """
    about = dict(result.attrs)
    for long in ("parameters", "initial_states"):  # the result has them; those of the files are listed below
        about.pop(long, None)
    ended = "" if about.get("status") == "complete" else f", {about.get('status')}"
    sections = [
        Section("Summary", html_table(TITLES, cells(figures))),
        Section("Figures", _charts(result)),
        *([Section("Diagram", drawing)] if drawing else []),
        Section("Parameters", html_table(("where", "value", "unit", "source"), _parameters(mission, result))),
        Section("Provenance", html_table(("what", "value"), [(str(k), str(v)) for k, v in about.items()])),
    ]
    return replay(
        result,
        truss,
        folder / "index.html",
        target=truss.dynamics.rest[: truss.rigid] + mission.displacement(truss.rigid),
        title=f"Transport, case {mission.case}: {about.get('plant')} plant, {about.get('controller')}{ended}",
        sections=sections,
    )


def _charts(result: xr.Dataset) -> str:
    names = [name for group in DRAWINGS.values() for name in group if name in result]
    chart = '<div class="chart"><h3>{}</h3><div class="plot" data-signal="{}"></div></div>'
    return f'<div class="figures">{"".join(chart.format(n.replace("_", " "), n) for n in names)}</div>'


def _parameters(mission: Mission, result: xr.Dataset) -> list[tuple[str, ...]]:
    """Return what the files say, without the other missions."""
    files = ("transport.toml", "space_truss.toml", f"robot_arm_{result.attrs['arm']}.toml")
    rows = [row for file in files for row in ParameterTable.shipped(file).listed()]
    return [r for r in rows if ", case_" not in r[0] or f", case_{mission.case}," in r[0]]
