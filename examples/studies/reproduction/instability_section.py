"""The section of the report on the instability with modal actuation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from study_tools.ledger import Ledger

from reproduction.context import Context
from reproduction.instability import MODES, StabilityJob
from trussflow.models.reporting.figures import blank, draw_cells, save
from trussflow.models.reporting.tables import markdown_table
from trussflow.models.transport.mission import CASES

FIGURE = "stability.png"

CLEAR = 0.1
"""Relative differences are taken where the pole is at least this far from the axis [1/s]."""


def section(context: Context) -> str:
    """Write the map and return the section of the report."""
    panels = {(case, o): _joined(context.maps, case, o) for case in CASES for o in (False, True)}
    pole, rate = (
        np.array([part[name].values for part in panels.values()]) for name in ("pole_real", "fitted_rate")
    )
    clear = np.abs(pole) >= CLEAR
    relative = float(np.abs(rate / pole - 1)[clear].max())
    near = np.abs(rate - pole)[~clear]
    n = context.ledger
    worst = n("stability: largest relative difference", relative, "%", digits=2)
    count = n.count("stability: points compared", int(clear.sum()))
    distance = n("stability: least distance from the axis", CLEAR, "1/s", digits=1)
    agreement = (
        f"Poles and simulated rates differ by at most {worst} at the {count} points where the pole "
        f"is at least {distance} from the imaginary axis"
    )
    if near.size:
        largest = n("stability: largest difference near the axis", float(near.max()), "1/s", digits=2)
        agreement += f", and by at most {largest} at the others"
    rows = [
        (f"Case {case}", "with" if observer else "without", *_named(n, part, case, observer))
        for (case, observer), part in panels.items()
    ]
    _draw(panels, context.folder)
    header = (
        "gains of",
        "observer",
        "fastest growth, six modes, undamped",
        "simulated",
        "six modes: stable from a damping of",
        "all mode counts: stable from",
    )
    return TEXT.format(agreement=agreement, table=markdown_table(header, rows), figure=FIGURE)


def _joined(maps: Mapping[str, xr.Dataset], case: int, observer: bool) -> xr.Dataset:
    parts = [maps[StabilityJob(modes=m, observer=observer).name].sel(case=case) for m in MODES]
    return xr.concat(parts, dim="modes").assign_coords(modes=list(MODES))


def _named(n: Ledger, part: xr.Dataset, case: int, observer: bool) -> list[str]:
    which = f"case{case}, {'with' if observer else 'without'} observer, six modes"
    first = part.isel(modes=0, damping=0)
    dampings = part["damping"].values

    def stable_from(unstable: np.ndarray, name: str) -> str:
        worst = np.flatnonzero(unstable)
        if len(worst) == len(dampings) or (len(worst) and worst[-1] == len(dampings) - 1):
            return "none of those looked at"
        value = dampings[worst[-1] + 1] if len(worst) else dampings[0]
        return n(f"stability: {which}: {name}", float(value), "%", digits=2)

    unstable = part.pole_real.values > 0
    return [
        n(f"stability: {which}: pole", float(first.pole_real), "1/s"),
        n(f"stability: {which}: simulated", float(first.fitted_rate), "1/s"),
        stable_from(unstable[0], "least stable damping"),
        stable_from(unstable.any(axis=0), "least stable damping for all mode counts"),
    ]


def _draw(panels: Mapping[tuple[int, bool], xr.Dataset], folder: Path) -> None:
    figure, cells = blank(2, 2)
    largest = max(float(np.abs(part.pole_real).max()) for part in panels.values())
    for ((case, observer), part), cell in zip(panels.items(), cells, strict=True):
        draw_cells(  # purple is stable, orange is not
            cell,
            part.pole_real.values,
            lambda value: f"{value:.1f}",
            lambda value: abs(value) > 0.6 * largest,
            [f"{100 * d:g}" for d in part["damping"].values],
            [str(m) for m in part["modes"].values],
            vmin=-largest,
            vmax=largest,
        )
        title = f"Case {case}, {'with' if observer else 'without'} observer"
        cell.set_title(title, loc="left", fontsize="medium")
        cell.set(xlabel="damping [%]", ylabel="modes")
    save(figure, folder / FIGURE, small=True)


TEXT = """\
By Eq. 42 the actuators do work on the modes. With that term and the published allocation (Eq. 64)
the loop that holds the truss at rest is linearized (β = 1, η = 0), and its rightmost oscillating
pole is set beside the growth of the nonlinear simulation, started along the pole's eigenvector.
{agreement}.

{table}

![Stability map]({figure})

Real part of the rightmost oscillating pole [1/s] over damping ratio and number of modes; bold and
orange: unstable. The forces act at the grasps while the pose is measured at the clamped root, and
the feedback excites what it does not see (control spillover). With feedback allocated so that it
does no work on the modes the `consistent` plant is stable in both cases: see the last rows of the
sensitivity tables.
"""
