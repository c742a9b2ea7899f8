"""Missions of the study: mission files of the paper's cases with a few values changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from study_tools.data_files import data_beside

from reproduction.measures import measured
from reproduction.trusses import frame_modes, mirrored, truss_modes
from trussflow.blocks.simulation.simulator import Simulator
from trussflow.blocks.sweeps.sweep import sweep
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.transport.mission import CASES
from trussflow.models.transport.mission_file import MissionFile
from trussflow.models.truss.paper_truss import with_printed_frequencies

Tables = dict[str, dict[str, Any]]
"""Tables of a mission file."""

PUSH_SPEED = 0.05
"""Initial speed of the truss along z in a pushed run [m/s]."""

LONG = "-long"
"""Suffix of the runs that last five times as long."""

_DATA = data_beside(__file__, "runs.toml")

OVERRIDES: dict[str, Tables] = _DATA["overrides"]
"""Changed values of each run, keyed by the suffix of its name."""

BASE_OFFSETS: dict[str, float] = _DATA["base_offsets"]
"""Displacement of the base along z of the last link [m], which a mission file cannot state."""

RUNS = tuple(
    f"case{case}{suffix}"
    for case in CASES
    for suffix in OVERRIDES
    if case == 1 or not suffix.startswith(("-equal-weights", "-L-"))
)

BANDWIDTH_RUNS = (
    "case1-L-1-fine",
    "case1-L-2-fine",
    "case1-fine",
    "case1-L-8-fine",
    "case1-L-16-fine",
)
"""Runs of Case 1 with increasing bandwidth of the observer."""


def changes(run: str) -> str:
    """Return the changed values of a run as text."""
    suffix = run[5:]
    listed = [
        f"{table}.{key} = {value['value'] if isinstance(value, dict) else value}"
        for table, row in OVERRIDES[suffix].items()
        for key, value in row.items()
    ]
    if suffix in BASE_OFFSETS:
        listed.append(f"base displaced by `{BASE_OFFSETS[suffix]} m`")
    return ", ".join(listed) or suffix.lstrip("-").replace("-", " ")


def mission(run: str, folder: Path) -> MissionFile:
    """Return the mission of a run.

    Parameters
    ----------
    run : str
        Name, one of `RUNS`.
    folder : pathlib.Path
        Folder of the computed modes.
    """
    suffix = run[5:]
    file = MissionFile.of_case(int(run[4]), **OVERRIDES[suffix])
    truss = _changed(file.truss, suffix, folder)
    return replace(file, truss=truss, believed=truss)


def _changed(truss: SpaceTruss, suffix: str, folder: Path) -> SpaceTruss:
    """Return the plant with the changes that a mission file cannot state."""
    dynamics = truss.dynamics
    modes = dynamics.modes
    if suffix == "-other-side":
        modes = mirrored(modes, 2)
    if suffix == "-inner-edge":
        modes = with_printed_frequencies(frame_modes("inner edge", folder).truncated(6))
    if suffix in ("-12-modes", "-20-modes"):
        modes = truss_modes(int(suffix[1:3]), folder)
    offset = np.array([0.0, 0.0, BASE_OFFSETS.get(suffix, 0.0)])
    arms = tuple(
        replace(arm, base_origin=arm.base_origin + offset) for arm in dynamics.arms
    )
    dynamics = replace(dynamics, arms=arms, modes=modes)
    speeds = np.zeros(dynamics.freedoms)
    speeds[2] = PUSH_SPEED if suffix == "-pushed" else 0.0
    return SpaceTruss(dynamics, modal_actuation=truss.modal_actuation, speeds=speeds)


def simulator(folder: Path, run: str) -> Simulator:
    """Return the simulator of a run.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the computed modes.
    run : str
        Name, one of `RUNS`.
    """
    file = mission(run, folder)
    return file.simulator(file.diagram())


def measure_all(
    runs: Sequence[str], duration: float, folder: Path, *, workers: int | None = None
) -> dict[str, dict[str, Any]]:
    """Simulate runs and return the measures of each by name.

    Parameters
    ----------
    runs : sequence of str
        Names, some of `RUNS`.
    duration : float
        Simulated time [s]; long runs last five times as long.
    folder : pathlib.Path
        Folder of the finished runs and of the computed modes.
    workers : int, optional
        As for `sweep` [-].

    Raises
    ------
    ModelError
        If a run failed.
    """
    found: dict[str, dict[str, Any]] = {}
    for long, span in ((False, duration), (True, 5 * duration)):
        names = [run for run in runs if run.endswith(LONG) == long]
        if not names:
            continue
        swept = sweep(
            partial(simulator, folder),
            span,
            vary={"run": names},
            keep=measured,
            path=folder / f"{span:g}-s",
            workers=workers,
        )
        failed = swept.isel(sample=(swept["status"] != "complete").values)
        if failed.sizes["sample"]:
            reasons = zip(failed["run"].values, failed["message"].values, strict=True)
            listed = "\n  ".join(f"{run}: {message}" for run, message in reasons)
            raise ModelError(
                f"{failed.sizes['sample']} of {len(names)} runs failed:\n  {listed}"
            )
        for i, run in enumerate(names):
            one = swept.isel(sample=i)
            found[run] = {
                "duration": span,
                **{str(name): one[name].values for name in one.data_vars},
            }
    return found
