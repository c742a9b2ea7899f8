"""Self-contained HTML page of a run, without network, server or other files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from trussflow.blocks.support.files import written
from trussflow.blocks.support.packing import compressed
from trussflow.blocks.support.texts import package_text, page_text, script_json
from trussflow.models.errors import ModelError
from trussflow.models.plant.space_truss import SpaceTruss
from trussflow.models.viewer.motion import Motion, opened
from trussflow.models.viewer.scene import plant_of, scene_of, target_of

if TYPE_CHECKING:
    import xarray as xr

INITIAL_CHARTS = 4
"""Number of charts that are not chosen [-]."""
MAX_PAGE_BYTES = 4_000_000
"""Largest size of a page [byte]."""
NO_ROOM = 1e-9
"""Share of numbers per page with only the first and the last instant [-]."""


def replay(
    result: xr.Dataset | str | Path,
    truss: SpaceTruss | str | None,
    path: str | Path,
    *,
    target: npt.ArrayLike | None = None,
    rods: npt.ArrayLike | None = None,
    title: str = "Replay",
    charts: Sequence[str] | None = None,
    sections: Mapping[str, str] | None = None,
) -> Path:
    """Write a page of a run, with the moving truss and charts of all logged signals.

    Parameters
    ----------
    result : xarray.Dataset, str or pathlib.Path
        Result of `simulate`, or its file.
    truss : SpaceTruss, str or None
        Plant of the run, or its name: ``"published"``, ``"consistent"``, ``"accurate"``; None for the name in
        the result of a mission.
    path : str or pathlib.Path
        File to write.
    target : array_like, optional
        Task coordinates of the target pose, drawn transparently [m, rad]; by default the attribute ``target``
        of the result.
    rods : array_like, shape (k, 2), optional
        Pairs of point masses connected by a rod [-]; required except for the shipped trusses.
    title : str
        Title of the page.
    charts : sequence of str, optional
        Signals of the first charts; by default the first four. The reader may choose others.
    sections : mapping of str to str, optional
        Further sections below the picture: HTML texts by title.

    Returns
    -------
    pathlib.Path
        Path of the page.

    Raises
    ------
    ModelError
        If a result is no run of that truss, or lacks ports: log its ``coordinates``, or ``task_position`` and
        ``modal_coordinate``; ``base_force`` and ``base_torque`` are the arrows. If a chart is of another
        signal than those logged, or the page cannot be written.

    Examples
    --------
    ::

        log = [truss.task_position, truss.modal_coordinate, truss.base_force, truss.base_torque]
        replay(simulate(loop, 80.0, step=1e-3, log=log, log_step=0.02), truss, "replay.html")
    """
    data = opened(result)
    motion = Motion(data, plant_of(truss, data.attrs))
    names, geometry = [*motion.signals], scene_of(motion.truss, rods)
    given = data.attrs.get("target") if target is None else target
    goal = target_of(motion.truss, given)
    shown = names[:INITIAL_CHARTS] if charts is None else [*charts]
    for name in shown:
        if name not in names:
            raise ModelError(
                f"cannot show a chart of '{name}': the run has {', '.join(names)}"
            )

    fixed = {
        "truss": geometry,
        "target": goal,
        "charted": shown,
        "exaggeration": motion.exaggeration(),
    }

    def content(room: float) -> str:
        """Return the page with a share `room` of the numbers of a page that compresses well."""
        return _text(title, {**motion.data(room), **fixed}, sections or {})

    room = 1.0
    while (
        len((page := content(room)).encode("utf-8")) > MAX_PAGE_BYTES
    ):  # noise hardly compresses
        if room < NO_ROOM:
            raise ModelError(
                f"cannot show the run in a page of {MAX_PAGE_BYTES / 1e6:g} MB: truss, sections and names of "
                f"signals alone take {len(page) / 1e6:.1f} MB; use a truss with fewer points or modes"
            )
        room *= 0.9 * MAX_PAGE_BYTES / len(page)
    return written(path, page, ModelError, "cannot write the page to")


def _text(title: str, head: dict[str, Any], sections: Mapping[str, str]) -> str:
    arms = head["truss"]["arms"]
    troubles = dict.fromkeys(t for arm in arms for t in arm["solid"]["troubles"])
    note = (
        f"{head['logged']} logged instants, {head['shown']} of them shown. The numbers in charts have four digits; "
        "the result file has all."
    )
    if troubles:
        note += f" Incomplete shapes: {'; '.join(troubles)}."
    return page_text(
        "trussflow.models.viewer",
        title,
        note=escape(note),
        scene=package_text("scene3d.js", "trussflow.models.viewer"),
        sections="".join(
            f"<section><h2>{escape(name)}</h2>{text}</section>\n"
            for name, text in sections.items()
        ),
        head=compressed(script_json(head, allow_nan=False).encode()),
    )
